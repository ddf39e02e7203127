"""Verdicts on laws, in sentences and tables: of each system, of each case and of studies."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from grosmc_mj.ground.wording import plural, quantity_and_unit, unit_after
from grosmc_mj.output.page.reading import CurvePanel, Curves, Document
from grosmc_mj.output.results.result import VERDICTS, Answer, Result, Standing
from grosmc_mj.output.results.tables import Column, Table, number, phrases, table, verdicts

# Kinds of results whose verdicts are those of single runs.
_OF_RUNS = ("run", "validation")
MARKS = {"kept": "✓", "not kept": "✗", "measured": "•", "not decided": "?"}

# Cell of a law that ran and is not judged.
_FREE = f"{MARKS['measured']} nothing required"

# Verdict on each law in each case.
Cases = Mapping[str, Mapping[str, Standing]]
# Laws of which nothing is required, by case.
FreeLaws = Mapping[str, Sequence[str]]


class Story(NamedTuple):
    """The case of a system that tells most about its laws.

    Attributes:
        sentence: What came out.
        curves: The curves of the case.
        panel: The quantity in which the laws differ most.
    """

    sentence: str
    curves: Curves
    panel: CurvePanel


def required_verdicts(documents: Iterable[Document]) -> Cases:
    """Return the newest verdicts of runs that requirements decide, by case and law."""
    cases: dict[str, dict[str, Standing]] = {}
    for verdict in _run_standings(documents):
        if verdict.required:
            cases.setdefault(verdict.case, {})[verdict.law] = verdict
    return dict(sorted(cases.items()))


def free_laws(documents: Sequence[Document], cases: Cases) -> FreeLaws:
    """Return the laws of which nothing is required in a case of ``cases``, by case.

    Args:
        documents: All documents: laws that are not judged have curves only.
        cases: Verdicts on the laws.
    """
    ran = [(verdict.case, verdict.law) for verdict in _run_standings(documents)]
    for document in documents:
        if isinstance(document.content, Curves):
            curves = document.content
            ran += [(f"{curves.system}/{curves.case}", law) for law in curves.laws]

    free: dict[str, list[str]] = {}
    for case, law in dict.fromkeys(ran):
        if case in cases and law not in cases[case]:
            free.setdefault(case, []).append(law)
    return free


def _run_standings(documents: Iterable[Document]) -> Iterator[Standing]:
    """Yield the verdicts of runs, without those of earlier runs that were of something else."""
    for document in documents:
        content = document.content
        if isinstance(content, Result) and document.kind in _OF_RUNS and not document.earlier:
            yield from content.standings


# -- tables --------------------------------------------------------------------------------------


def systems_table(cases: Cases, free: FreeLaws) -> Table:
    """Return the table of laws by systems: in how many cases a law keeps everything, and how."""
    verdicts_of: dict[str, dict[str, list[Standing]]] = {}
    systems: dict[str, None] = {}
    for case, laws in cases.items():
        system = _system_of(case)
        systems[system] = None
        for law, verdict in laws.items():
            on_systems = verdicts_of.setdefault(law, {})
            on_systems.setdefault(system, []).append(verdict)
        for law in free.get(case, ()):
            verdicts_of.setdefault(law, {}).setdefault(system, [])

    rows = []
    for law, on_systems in verdicts_of.items():
        cells = [_system_cell(on_systems.get(system)) for system in systems]
        rows.append([law, *cells])
    return table("", [*phrases("law"), *_verdict_columns(systems)], rows)


def _system_cell(cases: Sequence[Standing] | None) -> str:
    """Write in how many cases a law keeps everything, and the requirement that decides.

    Args:
        cases: Verdicts on the law; empty if nothing is required of it, None if it did not run.
    """
    if cases is None:
        return ""
    if not cases:
        return _FREE
    worst = max(cases, key=_severity)
    words = _verdict_words(worst)
    if len(cases) == 1:
        return f"{words} ({worst.case.partition('/')[2] or worst.case})"

    kept = sum(not verdict.breaks_at for verdict in cases)
    case = worst.case.partition("/")[2]
    return f"{words} ({case}); {kept} of {len(cases)} cases kept"


def cases_table(cases: Cases, free: FreeLaws) -> Table:
    """Return the table of laws by cases that a system's cells summarize."""
    rows = []
    for case, laws in cases.items():
        for law, verdict in laws.items():
            rows.append([case, law, _verdict_words(verdict)])
        rows += [[case, law, _FREE] for law in free.get(case, ())]
    return table("", [*phrases("case", "law"), *_verdict_columns(["requirement"])], rows)


def studies_table(results: Iterable[Document]) -> Table:
    """Return the table of where each law of a study breaks first."""
    rows = []
    for document in results:
        content = document.content
        of_study = document.kind not in _OF_RUNS and not document.earlier
        if isinstance(content, Result) and of_study:
            for verdict in content.standings:
                study = f"{verdict.case}, {document.kind}"
                place = f"{_mark(verdict)} {_breaking_words(verdict)}"
                rows.append([study, verdict.law, place, verdict.words])
    columns = [*phrases("study", "law"), *_verdict_columns(["breaks at"]), *phrases("how far")]
    return table("", columns, rows)


def answers_table(answers: Iterable[Answer]) -> Table:
    """Return the table of answers, those that are not kept first."""
    rows = []
    for answer in sorted(answers, key=lambda answer: VERDICTS.index(answer.verdict)):
        words = ". ".join(filter(None, (answer.words.rstrip("."), answer.more)))
        rows.append([answer.question, f"{MARKS[answer.verdict]} {answer.verdict_words}", words])
    columns = [*phrases("question"), *_verdict_columns(["verdict"]), *phrases("answer")]
    return table("", columns, rows)


def _verdict_columns(headers: Iterable[str]) -> list[Column]:
    return [column for header in headers for column in verdicts(header)]


def _system_of(case: str) -> str:
    return case.partition("/")[0]


def _severity(verdict: Standing) -> tuple[bool, float]:
    """Return a key by which verdicts are sorted: the worst is the largest."""
    share = math.inf if verdict.share is None else verdict.share
    return bool(verdict.breaks_at), share


def _mark(verdict: Standing) -> str:
    if verdict.breaks_at:
        return MARKS["not kept"]
    return MARKS["kept"] if verdict.complete else MARKS["not decided"]


def _verdict_words(verdict: Standing) -> str:
    return f"{_mark(verdict)} {verdict.words}"


def _breaking_words(verdict: Standing) -> str:
    if verdict.breaks_at:
        return verdict.breaks_at
    return "nowhere" if verdict.complete else "nowhere so far"


# -- the first screen ----------------------------------------------------------------------------


def stories(newest: Mapping[tuple[str, str], Curves], cases: Cases) -> list[Story]:
    """Return for each system the case that tells most about its laws.

    Args:
        newest: Newest curves by system and case.
        cases: Verdicts on the laws.
    """
    best: dict[str, tuple[tuple[int, float], Story]] = {}
    for (system, name), curves in sorted(newest.items()):
        verdicts_of = cases.get(f"{system}/{name}", {})
        panel, ratio = _telling_panel(curves, verdicts_of)
        broken = sum(bool(verdict.breaks_at) for verdict in verdicts_of.values())
        telling = 2 if 0 < broken < len(verdicts_of) else int(bool(verdicts_of))
        rank = (telling, ratio)
        if system not in best or rank > best[system][0]:
            best[system] = rank, Story(_sentence(panel, verdicts_of), curves, panel)
    return [story for _, story in best.values()]


def _telling_panel(curves: Curves, verdicts_of: Mapping[str, Standing]) -> tuple[CurvePanel, float]:
    """Return the panel to show of a case, and the ratio of the largest curve to the smallest.

    It is that of a requirement that is not kept, else that in which laws differ most.
    """
    ratios = []
    for panel in curves.panels:
        sizes = [size for size in largest_values(panel).values() if size > 0]
        ratio = max(sizes) / min(sizes) if len(sizes) > 1 else 1.0
        limits = [limit.words for limit in panel.limits]
        for verdict in verdicts_of.values():
            if verdict.breaks_at and verdict.requirement in limits:
                return panel, ratio
        ratios.append(ratio)
    most = max(range(len(ratios)), key=ratios.__getitem__)
    return curves.panels[most], ratios[most]


def largest_values(panel: CurvePanel) -> dict[str, float]:
    """Return the largest magnitude of each law's curve on the first plant that has curves."""
    plant = main_plant(panel)
    sizes: dict[str, float] = {}
    for curve in panel.curves:
        if curve.plant == plant and curve.y:
            values = curve.y
            if curve.range is not None:
                values = [*curve.range[0], *curve.range[1]]
            sizes[curve.law] = max(abs(value) for value in values)
    return sizes


def main_plant(panel: CurvePanel) -> str:
    """Return the plant that judges: MuJoCo, or else the last one."""
    plants = [curve.plant for curve in panel.curves]
    return "physics" if "physics" in plants else plants[-1] if plants else ""


def _sentence(panel: CurvePanel, verdicts_of: Mapping[str, Standing]) -> str:
    """Say which laws keep the requirements of a case, or else how far the laws are apart."""
    kept = [law for law, verdict in verdicts_of.items() if not verdict.breaks_at]
    broken = [law for law, verdict in verdicts_of.items() if verdict.breaks_at]
    if broken:
        worst = max(broken, key=lambda law: _severity(verdicts_of[law]))
        words = f"{worst} breaks a requirement ({verdicts_of[worst].words})"
        if len(broken) > 1:
            more = len(broken) - 1
            words += f", and so {plural(more, 'does', 'do')} {more} more"
        return f"{words}; {_laws_words(kept)} keeps everything."

    sizes = largest_values(panel)
    if not sizes:
        return _begun(f"{_laws_words(kept)} keeps everything; there are no curves.", kept)

    words = f"{_laws_words(kept)} keeps everything; " if kept else ""
    least = min(sizes, key=sizes.__getitem__)
    most = max(sizes, key=sizes.__getitem__)
    name, unit = quantity_and_unit(panel.label)
    words += f"largest {name}: {number(sizes[least])}{unit_after(unit)} under {least}"
    if most != least:
        words += f", {number(sizes[most])}{unit_after(unit)} under {most}"
    return _begun(f"{words}.", kept)


def _laws_words(laws: Sequence[str]) -> str:
    """Name a single law; of several, write how many they are."""
    if len(laws) == 1:
        return laws[0]
    return f"each of {len(laws)} laws" if laws else "no law"


def _begun(sentence: str, laws: Sequence[str]) -> str:
    """Return a sentence with a capital letter, unless it begins with the name of the one law."""
    if len(laws) == 1:
        return sentence
    return f"{sentence[0].upper()}{sentence[1:]}"
