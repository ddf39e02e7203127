"""What was asked, what came out, and where each law breaks: the first screen of the page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from grosmc_mj.page.documents import (
    StoredCampaignResults,
    StoredChange,
    StoredClaim,
    StoredClaims,
    StoredDiff,
    StoredLadder,
    StoredRequirement,
    StoredRunResults,
    StoredStanding,
    StoredTolerance,
    StoredTolerances,
    StoredValidation,
)
from grosmc_mj.page.reading import Document
from grosmc_mj.page.studies.answers import study_answer
from grosmc_mj.page.verdicts import BROKEN, KEPT, MEASURED, OPEN, VERDICTS, Answer
from grosmc_mj.results.tables import number, prefixed

# The rung of the chapter's misprinted equations.
_PRINTED = "printed"
# Effects of what may be chance.
_NO_CHANGE = ("noise", "not judged")


class Break(NamedTuple):
    """Where a law breaks first.

    Attributes:
        target: Of which case.
        law: The law.
        rung: Where; empty if it stands everywhere.
        number: By how much, in words.
        complete: Whether nothing was interrupted that may break it still.
    """

    target: str
    law: str
    rung: str
    number: str
    complete: bool = True


def answers(documents: Sequence[Document]) -> list[Answer]:
    """The answer of each document that answers something, what is not kept first."""
    found = [answer for each in documents if (answer := _answer(each)) is not None]
    return sorted(found, key=lambda each: VERDICTS.index(each.verdict))


def breaks(documents: Sequence[Document]) -> list[Break]:
    """Where each law breaks, of ladders, tolerances and runs."""
    found: list[Break] = []
    for each in documents:
        content = each.content
        if isinstance(content, StoredLadder):
            found += _of_ladder(target_of(each), content)
        elif isinstance(content, StoredTolerances):
            found += _of_tolerances(target_of(each), content)
        elif isinstance(content, StoredRunResults):
            found += _of_run(target_of(each), content)
    return found


def target_of(document: Document) -> str:
    """The case that a document is about, or the name of its file."""
    content = document.content
    if isinstance(content, StoredLadder | StoredTolerances):
        named = content.configuration.get("target")
        return named if isinstance(named, str) else document.path.stem
    if isinstance(content, StoredRunResults) and content.configuration.cases:
        case = content.configuration.cases[0]
        return "/".join(each for each in (case.system, case.case) if each) or document.path.stem
    return document.path.parent.name if document.path.stem == "results" else document.path.stem


def breaking(
    standings: Iterable[StoredStanding], law: str, condition: str
) -> StoredStanding | None:
    """The first rung on which a law does not keep all, going up; None if it stands.

    It is from equations that are true: what a misprint does says nothing of a law.
    """
    way = (
        x
        for x in standings
        if x.together and x.rung != _PRINTED and (x.law, x.condition) == (law, condition)
    )
    return next((each for each in way if not each.kept and not each.impossible), None)


def standing_text(standing: StoredStanding) -> str:
    """How much of the tightest limit is used, in short."""
    if standing.impossible:
        return "-"
    share = standing.share_of_the_tightest_limit
    if share is not None:
        return number(share)
    return "never" if standing.tightest == "settles_within" else "ended"


def tolerance_text(row: StoredTolerance) -> str:
    """How much a law stands, in short."""
    if row.impossible:
        return "-"
    if not row.kept_ideally:
        return "no"
    if row.largest_kept is None or row.largest_kept.factor == 0:
        return "none"
    parts = row.largest_kept.parts
    part: dict[str, Any] = parts[0] if parts else {}
    value, unit = part.get("value"), part.get("unit")
    if not isinstance(value, float) or any(each.get("unit") != unit for each in parts):
        # Of several things that are scaled together there is no one amount.
        return f"{number(row.largest_kept.factor)} x"
    if not isinstance(unit, str) or unit in ("", "1"):
        return number(value)
    shown, scale = prefixed(unit, abs(value))
    return f"{number(value * scale)} {shown}"


def _answer(document: Document) -> Answer | None:
    """What one document answers."""
    content, target = document.content, target_of(document)
    match content:
        case StoredValidation():
            return _validation(content)
        case StoredRunResults():
            return _run(target, content)
        case StoredClaims():
            return _claims(content)
        case StoredLadder():
            return _ladder(target, content)
        case StoredTolerances():
            return _tolerances(target, content)
        case StoredCampaignResults():
            return _campaign(target, content)
        case StoredDiff():
            return _diff(content)
        case _:
            return study_answer(content)


def _verdict(complete: bool, kept: bool) -> str:
    """What is kept so far may still break."""
    return BROKEN if not kept else KEPT if complete else OPEN


def so_far(complete: bool) -> str:
    """What is said of results that are not all there."""
    return "" if complete else " (interrupted: not complete)"


def _validation(content: StoredValidation) -> Answer:
    """Whether all is as recorded."""
    asked = f"Validation: {len(content.runs)} runs, {len(content.claims)} claims"
    differing = len(content.differences)
    if content.as_recorded is None:
        words = "not compared with the recorded results"
        return Answer(asked, OPEN, words + so_far(content.complete))
    words = "all is as recorded" if content.as_recorded else f"{differing} results differ"
    verdict = _verdict(content.complete, content.as_recorded)
    return Answer(asked, verdict, words + so_far(content.complete), _counts(content))


def _claims(content: StoredClaims) -> Answer:
    """How many verdicts are the expected ones."""
    claims = content.claims
    wrong = [each for each in claims if not as_expected(each)]
    words = f"{len(claims) - len(wrong)} of {len(claims)} verdicts are as expected"
    return Answer("Claims", BROKEN if wrong else KEPT, words, _counts(content))


def as_expected(claim: StoredClaim) -> bool:
    """Whether what is expected of a claim on each plant came out; an older one may not say."""
    wanted = claim.expected.verdicts
    return all(
        name not in wanted or wanted[name] == each.verdict for name, each in claim.plants.items()
    )


def _counts(content: StoredClaims | StoredValidation) -> str:
    """Sentences of the chapter by verdict; an older document has its claims only."""
    counts = Counter(each.verdict for each in content.sentences or content.claims)
    said = ", ".join(f"{count} {verdict}" for verdict, count in counts.most_common())
    return f"sentences of the chapter: {said}" if content.sentences else said


def _run(target: str, content: StoredRunResults) -> Answer:
    """Whether a case keeps its requirements, and the one that is the nearest to its limit."""
    failed = [each for each in content.requirements if not each.kept]
    ended = [run for run in content.runs if run.ended]
    if failed:
        words = f"{len(failed)} of {len(content.requirements)} requirements are not kept"
    elif content.requirements:
        words = f"all {len(content.requirements)} requirements are kept"
    else:
        words = f"nothing is required; {len(ended)} of {len(content.runs)} runs ended early"
    kept = not failed and bool(content.requirements or not ended)
    tightest = min(content.requirements, key=_share_left, default=None)
    said = "" if tightest is None else f"tightest: {_told(tightest)}"
    words += so_far(content.complete)
    return Answer(f"Run of {target}", _verdict(content.complete, kept), words, said)


def _share_left(each: StoredRequirement) -> float:
    """How much of its limit a requirement leaves."""
    limit = each.limit.get("value")
    if each.margin is None:
        return 0.0 if each.kept else -float("inf")
    return each.margin / abs(limit) if isinstance(limit, float | int) and limit else each.margin


def _told(each: StoredRequirement) -> str:
    """A requirement with what was measured."""
    unit, limit = each.limit.get("unit"), each.limit.get("value")
    end = f" {unit}" if isinstance(unit, str) and unit != "1" else ""
    of = f" of {number(limit)}" if isinstance(limit, float | int) else ""
    words = each.requirement.replace("_", " ")
    return f"{words}: {number(each.measured)}{of}{end} by {each.controller} on {each.plant}"


def _tolerances(target: str, content: StoredTolerances) -> Answer:
    """How many laws keep everything ideally, and which number is the smallest."""
    laws = dict.fromkeys(each.law for each in content.tolerances)
    weak = {each.law for each in content.tolerances if not each.kept_ideally}
    words = f"{len(laws) - len(weak)} of {len(laws)} laws keep all in every ideal loop"
    verdict = MEASURED if content.complete else OPEN
    return Answer(f"Tolerance of {target}", verdict, words + so_far(content.complete))


def _campaign(target: str, content: StoredCampaignResults) -> Answer:
    """The share of runs that keep everything, for each law."""
    rates = content.pass_rates
    chosen = [each for each in rates if each.requirement in ("everything", "all requirements")]
    if not chosen:
        laws = dict.fromkeys(each.controller for each in rates)
        own = {law: [each for each in rates if each.controller == law] for law in laws}
        chosen = [min(each, key=lambda rate: rate.kept) for each in own.values()]
    words = "; ".join(f"{each.controller}: {rate_text(each)}" for each in chosen)
    kept = all(each.kept == each.runs for each in chosen)
    return Answer(f"Campaign in {target}", BROKEN if not kept else KEPT, words)


def _diff(content: StoredDiff) -> Answer:
    """Whether something got worse, and what the most."""
    worse = [each for each in content.changes if each.effect == "worse"]
    words = f"{len(worse)} of {content.compared} compared got worse beyond noise"
    asked = f"What changed from {content.old} to {content.new}"
    return Answer(asked, BROKEN if worse else KEPT, words, worse[0].name if worse else "")


def changed(documents: Sequence[Document]) -> list[StoredChange]:
    """What comparisons found to be more than noise."""
    found = [each.content.changes for each in documents if isinstance(each.content, StoredDiff)]
    return [
        change for each in found for change in each if change.effect not in ("noise", "not judged")
    ]


def rate_text(rate: Any) -> str:
    """A share of runs with its interval."""
    said = f"{rate.kept} of {rate.runs}"
    if rate.low is None or rate.high is None:
        return said
    return f"{said} [{100 * rate.low:.4g} to {100 * rate.high:.4g} %]"


def _ladder(target: str, content: StoredLadder) -> Answer:
    """How many laws keep everything on the last rung, under each condition."""
    climbed = [each for each in content.standings if each.together]
    top = climbed[-1].rung if climbed else ""
    counts, all_kept = [], bool(climbed)
    for condition in dict.fromkeys(each.condition for each in climbed):
        rows = [each for each in climbed if (each.rung, each.condition) == (top, condition)]
        kept = sum(each.kept for each in rows)
        counts.append(f"{condition} {kept} of {len(rows)}")
        all_kept = all_kept and kept == len(rows)
    words = f"laws that keep everything at {top}: {', '.join(counts)}{so_far(content.complete)}"
    return Answer(f"Ladder of {target}", _verdict(content.complete, all_kept), words)


def _of_ladder(target: str, content: StoredLadder) -> Iterator[Break]:
    """The first rung on which each law breaks, under the first condition."""
    for law in dict.fromkeys(each.law for each in content.standings):
        first = breaking(content.standings, law, content.standings[0].condition)
        if first is None:
            tried = "every rung" if content.complete else "every rung so far"
            yield Break(target, law, "", f"stands on {tried}", content.complete)
        else:
            limit = (first.tightest or "its limit").replace("_", " ")
            by = standing_text(first)
            if first.share_of_the_tightest_limit is not None:
                by += " times the limit"
            yield Break(target, law, first.rung, f"{limit}: {by} ({first.condition})")


def _of_tolerances(target: str, content: StoredTolerances) -> Iterator[Break]:
    """Of what each law stands the least, as a multiple of what the bench has."""
    for law in dict.fromkeys(each.law for each in content.tolerances):
        own = [x for x in content.tolerances if x.law == law and x.kept_ideally]
        asked = [x for x in own if x.largest_kept is not None and x.smallest_failed is not None]
        if not own:
            yield Break(target, law, "ideal loop", "not kept even in an ideal loop")
        elif not asked:
            yield Break(target, law, "", "stands all that was tried")
        else:
            least = min(asked, key=lambda x: x.largest_kept.factor if x.largest_kept else 0.0)
            limit = (least.breaks or "").replace("_", " ")
            words = f"kept up to {tolerance_text(least)}, then {limit} ({least.condition})"
            rung = "all of them" if least.imperfection == "all" else least.imperfection
            yield Break(target, law, rung, words)


def _of_run(target: str, content: StoredRunResults) -> Iterator[Break]:
    """The requirement of which each law is the furthest beyond its limit."""
    failed = [each for each in content.requirements if not each.kept]
    for law in dict.fromkeys(each.controller for each in failed):
        worst = min((each for each in failed if each.controller == law), key=_share_left)
        yield Break(target, law, worst.plant, _told(worst))


def where(path: Path) -> str:
    """A path as text that can be printed."""
    return str(path).encode("utf-8", "replace").decode()
