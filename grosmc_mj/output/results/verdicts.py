"""Verdict on a law: the row that the tables, charts, standings and values of all studies share."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, computed_field

from grosmc_mj.ground.wording import spelled
from grosmc_mj.output.results.result import Standing, Value, finite
from grosmc_mj.output.results.tables import number

# Stands for the requirement that breaks first of a run that ended early.
ENDED = "the run ended"
# A number that may be infinite, for which JSON has null.
Unlimited = Annotated[float, BeforeValidator(lambda x: math.inf if x is None else x)]


class Verdict(BaseModel):
    """Verdict on a law at a step under a condition: of one run, of its draws, or of a search.

    Attributes:
        law: Name of the law.
        step: Name of the rung, the imperfection, the change or the disturbance.
        condition: Name of the plant with its loads.
        group: Group of steps that the step belongs to, in a study that has several.
        share: Measured over allowed value of the tightest limit, in the worst draw; above 1 it is
            not kept; infinite without a measurement. Of a search: what the loop as built has of it,
            over the largest amount that is kept.
        tightest: Name of the requirement with this share; empty for none.
        ended: How the run ended early; empty if it did not.
        impossible: Why there can be no such run; empty if there can.
        shares: Share used of each limit, in the worst draw, by the name of the requirement.
        claims: Largest share used, over the draws, of the limits of each claim about this law, by
            its id; above 1 it has fallen. No verdict depends on it.
        draws: Runs with other random numbers and phases of the encoders; 1 where nothing is drawn.
        kept_draws: Draws that keep all requirements.
        draw: Number of the draw that decides.
        turned_by: Assumed numbers, each with a change that turns the verdict.
        largest_kept: Of a search, the largest size up to which all is kept: 0 if only without it;
            None if not even then, and of no search.
        smallest_failed: Of a search, the smallest size at which a requirement is not kept; None if
            all that was tried is kept.
        kept_again: Of a search, ranges beyond that size in which all is kept again.
        physics_agrees: Whether MuJoCo gives the verdict of the equations; None if it was not run.
        text: Number in a cell of a table, without marks.
        words: Explanation.
        numbers: Further numbers, which are shown and not judged; None where there is none.
    """

    model_config = ConfigDict(frozen=True)

    law: str = ""
    step: str = ""
    condition: str = ""
    group: str = ""
    share: Unlimited = math.inf
    tightest: str = ""
    ended: str = ""
    impossible: str = ""
    shares: dict[str, Unlimited] = {}
    claims: dict[str, Unlimited] = {}
    draws: int = 1
    kept_draws: int = 0
    draw: int = 0
    turned_by: tuple[str, ...] = ()
    largest_kept: float | None = None
    smallest_failed: float | None = None
    kept_again: tuple[tuple[float, float], ...] = ()
    physics_agrees: bool | None = None
    text: str = ""
    words: str = ""
    numbers: dict[str, float | None] = {}

    @computed_field
    @property
    def kept(self) -> bool:
        """Whether all requirements are kept in all draws."""
        return self.share <= 1 and not self.impossible

    @property
    def searched(self) -> bool:
        """Whether it is the verdict of a search."""
        return self.largest_kept is not None or self.smallest_failed is not None

    @property
    def of_runs(self) -> bool:
        """Whether its share is that of a run."""
        return bool(self.shares) or not self.searched

    @property
    def partly(self) -> bool:
        """Whether some draws keep all requirements, and others do not."""
        return 0 < self.kept_draws < self.draws

    @property
    def state(self) -> Literal["kept", "partly", "failed", ""]:
        """The verdict as a word; empty if there can be no such run."""
        if self.impossible:
            return ""
        if self.kept:
            return "kept"
        return "partly" if self.partly else "failed"

    @property
    def broken(self) -> str:
        """The requirement that is not kept, or that the run ended; empty if all are kept."""
        if self.kept or self.impossible:
            return ""
        return ENDED if self.ended else self.tightest

    @property
    def marks(self) -> str:
        """Marks beside a verdict: an assumed number decides, MuJoCo differs."""
        marks = "?" if self.turned_by else ""
        if self.physics_agrees is False:
            marks += "!"
        return marks

    @property
    def cell(self) -> str:
        """Text in a cell of a table: the number, or the draws that keep all; with marks."""
        text = self.text
        if self.partly:
            text = f"{self.kept_draws} of {self.draws}"
        return f"{text}{self.marks}"

    def changed(self, **fields: Any) -> Verdict:
        """Return a copy with other fields."""
        return self.model_copy(update=fields)


class Verdicts(BaseModel):
    """Rows of a part of a study, as they are stored."""

    model_config = ConfigDict(frozen=True)

    rows: tuple[Verdict, ...]


# -- from runs to a verdict ------------------------------------------------------------------------


def share_of(margin: float, allowed: float) -> float:
    """Return measured over allowed value of a requirement; infinite without a measurement.

    It is at most 1 exactly where the margin is not negative, however small that is.

    Args:
        margin: Allowed less measured value; NaN if nothing was measured, -inf of a run that ended.
        allowed: The allowed value.
    """
    if math.isnan(margin):
        return math.inf
    share = 1 - margin / allowed
    if margin < 0 and share <= 1:
        return math.nextafter(1.0, 2.0)
    return share


def verdict_of(shares: Mapping[str, float], *, ended: str = "", draw: int = 0) -> Verdict:
    """Return the verdict on a run.

    Args:
        shares: Share that it uses of each limit, see ``share_of``.
        ended: How it ended early; empty if it did not.
        draw: Number of the draw.
    """
    share = math.inf
    tightest = ""
    if not ended:
        tightest = max(shares, key=lambda name: shares[name], default="")
        share = shares.get(tightest, 0.0)
    return Verdict(
        share=share,
        tightest=tightest,
        ended=ended,
        shares=dict(shares),
        kept_draws=int(share <= 1),
        draw=draw,
    )


def over_draws(runs: Sequence[Verdict]) -> Verdict:
    """Return the verdict on the draws of a run: the worst one's, with how many are kept."""
    worst = max(runs, key=lambda run: run.share)
    claims = {name: max(run.claims.get(name, 0.0) for run in runs) for name in worst.claims}
    kept = sum(run.kept for run in runs)
    return worst.changed(draws=len(runs), kept_draws=kept, claims=claims)


def described(row: Verdict, more: str = "") -> Verdict:
    """Return a verdict on runs with its share as the text of a cell, and in words.

    Args:
        row: The verdict.
        more: Further words about a requirement that is not kept.
    """
    if row.impossible:
        return row.changed(text="-", words=row.impossible)
    draws = ""
    if row.partly:
        draws = f", kept in {row.kept_draws} of {row.draws} draws"
    if row.ended:
        return row.changed(text="ended", words=f"{ENDED}{draws}")

    share = number(row.share)
    if row.kept:
        return row.changed(text=share, words=f"{share} of the limit")

    text = f"{share}x"
    excess = f"{share} times"
    if math.isinf(row.share):
        text = "never"
        excess = "never"
    elif share == "1":
        excess = "at its limit"
    words = f"{spelled(row.tightest)}: {excess}{draws}"
    if more:
        words += f" ({more})"
    return row.changed(text=text, words=words)


# -- rows ------------------------------------------------------------------------------------------


def first_failed(rows: Iterable[Verdict]) -> Verdict | None:
    """Return the first row that is not kept; None if all are kept."""
    for row in rows:
        if not row.kept:
            return row
    return None


def worst_of(rows: Iterable[Verdict]) -> Verdict:
    """Return the row that is the furthest beyond its limit, or the nearest to it."""
    return max(rows, key=lambda row: row.share)


def worst_failed(rows: Iterable[Verdict]) -> Verdict | None:
    """Return the row that is the furthest beyond its limit; None if all are kept."""
    worst = worst_of(rows)
    return None if worst.kept else worst


def by_law(rows: Iterable[Verdict]) -> dict[str, list[Verdict]]:
    """Return the rows of each law, in their order."""
    laws: dict[str, list[Verdict]] = {}
    for row in rows:
        laws.setdefault(row.law, []).append(row)
    return laws


def standings(
    case: str,
    rows: Iterable[Verdict],
    failed: Callable[[Sequence[Verdict]], Verdict | None],
    words: Callable[[Sequence[Verdict]], str],
    *,
    complete: bool,
) -> Iterator[Standing]:
    """Yield the standing of each law: the step at which it fails first, if it does.

    Args:
        case: Name of the case.
        rows: The verdicts.
        failed: Returns the row of a law at which it fails first; None if it keeps all.
        words: Returns words on the rows of a law.
        complete: False if an interrupted study may still find a failure.
    """
    for law, of_law in by_law(rows).items():
        row = failed(of_law)
        decides = worst_of(of_law) if row is None else row
        yield Standing(
            case=case,
            law=law,
            breaks_at="" if row is None else row.step,
            requirement=decides.tightest if decides.of_runs else "",
            words=words(of_law),
            share=finite(decides.share) if decides.of_runs else None,
            # One failure decides, whatever else is found.
            complete=complete or row is not None,
        )


def values_of(case: str, rows: Iterable[Verdict]) -> Iterator[Value]:
    """Yield the values by which two results are compared.

    They are the verdict, the share of the limit of runs, and the largest size of a search.

    Args:
        case: Name of the case.
        rows: The verdicts; those on what cannot be run have no values.
    """
    for row in rows:
        if row.impossible:
            continue
        step = f"{row.group} {row.step}".strip()
        name = f"{case} {row.condition} {row.law}, {step}"
        yield Value(name=name, value="kept" if row.kept else "not kept")
        if row.of_runs:
            share = finite(row.share)
            yield Value(name=f"{name}: share of the limit", value=share, better=-1, relative=0.1)
        if row.searched:
            largest = row.largest_kept
            yield Value(name=f"{name}: largest kept", value=largest, better=1, relative=0.1)
