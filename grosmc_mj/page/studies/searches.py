"""What searches found: the worst plants, how far all is kept, faults that claims notice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pydantic import BaseModel, Field

from grosmc_mj.page.documents import Number, StoredPart, Text
from grosmc_mj.page.sheets import Line, Sheet, lines_chart
from grosmc_mj.page.verdicts import BROKEN, KEPT, MEASURED, Answer
from grosmc_mj.results.tables import number


class StoredWorst(StoredPart):
    """The worst plant of a law, and the least change of the nominal one that fails as well."""

    fails: bool
    relative: Number = None
    worst: dict[str, Number]
    evaluations: int = 0
    shrunk: dict[str, Number] | None = None
    not_nominal: list[Text] = Field(default=[])


class StoredLook(StoredPart):
    """The plants at one scale."""

    scale: float
    least: Number = None
    failures: int = 0


class StoredRadius(StoredPart):
    """How far a law keeps everything, in parts of what is declared."""

    found: Number = None
    largest_looked_at: Number = None
    promised: Number = None
    promised_note: Text = ""
    looks: list[StoredLook]


class StoredSearch(StoredPart):
    """What ``campaign --worst`` or ``campaign --radius`` writes."""

    controllers: dict[Text, StoredWorst] | dict[Text, StoredRadius]

    @property
    def worst(self) -> dict[str, StoredWorst]:
        """The worst plants, by law."""
        found = self.controllers.items()
        return {law: each for law, each in found if isinstance(each, StoredWorst)}

    @property
    def radius(self) -> dict[str, StoredRadius]:
        """How far each law keeps everything."""
        found = self.controllers.items()
        return {law: each for law, each in found if isinstance(each, StoredRadius)}


class StoredSelfTest(StoredPart):
    """What ``claims --self-test`` writes: by fault the claims that notice it."""

    noticed_by: dict[Text, list[Text]]


def search_answer(content: BaseModel | None) -> Answer | None:
    """The answer of a document; None of one of another kind."""
    match content:
        case StoredSearch() if content.radius:
            words = "; ".join(
                f"{law} up to {number(each.found)} of what is declared"
                for law, each in content.radius.items()
            )
            return Answer("How far everything is kept", MEASURED, words)
        case StoredSearch():
            failing = [law for law, each in content.worst.items() if each.fails]
            words = f"{', '.join(failing)} can be made to fail" if failing else "no law fails"
            return Answer("Worst plants", BROKEN if failing else MEASURED, words)
        case StoredSelfTest():
            missed = [fault for fault, claims in content.noticed_by.items() if not claims]
            words = f"all {len(content.noticed_by)} faults are noticed"
            if missed:
                words = f"{len(missed)} of {len(content.noticed_by)} faults are not noticed"
            verdict = BROKEN if missed else KEPT
            return Answer("Faults put into laws and plants", verdict, words, "; ".join(missed))
        case _:
            return None


def search_sheets(content: BaseModel | None) -> Sequence[Sheet]:
    """The sheets of a document; none of one of another kind."""
    match content:
        case StoredSearch():
            return [_radius(content.radius) if content.radius else _worst(content.worst)]
        case StoredSelfTest():
            return [_noticed(content.noticed_by)]
        case _:
            return []


def _worst(found: Mapping[str, StoredWorst]) -> Sheet:
    """The worst plant of each law."""
    rows = [
        [
            law, "FAILS" if each.fails else "keeps all", number(each.relative),
            _plant(each.worst), _plant(each.shrunk or {}, each.not_nominal) or "-",
            str(each.evaluations),
        ]
        for law, each in found.items()
    ]  # fmt: skip
    return Sheet(
        "The worst plants that a search found",
        "Margins in parts of their limits. Least change: of the nominal plant, that still fails.",
        ["law", "", "margin", "worst plant", "least change", "plants tried"],
        rows,
    )


def _plant(values: Mapping[str, Number], named: Sequence[str] | None = None) -> str:
    """The numbers of a plant, all or those that are named."""
    names = values if named is None else [name for name in named if name in values]
    return ", ".join(f"{name} {number(values[name])}" for name in names)


def _radius(found: Mapping[str, StoredRadius]) -> Sheet:
    """How far each law keeps everything, and the least margin at each scale."""
    rows = [
        [
            law, number(each.found), number(each.largest_looked_at),
            " ".join([number(each.promised), each.promised_note]).strip(),
        ]
        for law, each in found.items()
    ]  # fmt: skip
    lines = [
        Line(
            law,
            [look.scale for look in each.looks],
            [look.least for look in each.looks],
            [f"{look.failures} fail" for look in each.looks],
            [look.failures == 0 for look in each.looks],
        )
        for law, each in found.items()
    ]
    titles = ("scale of what is declared [1]", "least margin in parts of its limit [1]")
    return Sheet(
        "How far everything is kept",
        "1 is what the file declares; promised is what the gains were designed for.",
        ["law", "kept up to", "looked at up to", "promised"],
        rows,
        [lines_chart("least margins", titles, lines, limit=0.0)],
    )


def _noticed(noticed_by: Mapping[str, Sequence[str]]) -> Sheet:
    """Which claims notice each fault, what is noticed least first."""
    rows = sorted(
        ([fault, str(len(claims)), ", ".join(claims)] for fault, claims in noticed_by.items()),
        key=lambda row: int(row[1]),
    )
    return Sheet(
        "Faults that claims notice",
        "Of the claims that were asked: one that has noticed a fault is asked no more.",
        ["fault", "noticed by", "claims"],
        rows,
    )
