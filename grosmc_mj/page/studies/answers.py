"""What studies, sweeps and premises answer, in a line each."""

from __future__ import annotations

from pydantic import BaseModel

from grosmc_mj.page.studies.documents import (
    StoredPremises,
    StoredRegion,
    StoredSweeps,
    StoredSwitching,
)
from grosmc_mj.page.studies.searches import search_answer
from grosmc_mj.page.verdicts import BROKEN, KEPT, MEASURED, Answer
from grosmc_mj.results.tables import number

_FEW = 3


def study_answer(content: BaseModel | None) -> Answer | None:
    """The answer of a document; None of one of another kind."""
    match content:
        case StoredRegion():
            return _region(content)
        case StoredSwitching():
            return _switching(content)
        case StoredSweeps():
            return _sweeps(content)
        case StoredPremises():
            return _premises(content)
        case _:
            return search_answer(content)


def _region(content: StoredRegion) -> Answer:
    """The least share of starts from which each law converges."""
    converged = content.outcomes["c"].name if "c" in content.outcomes else ""
    least: dict[str, tuple[float, str]] = {}
    for each in content.maps:
        starts = sum(each.counts.values())
        share = 100 * each.counts.get(converged, 0) / starts if starts > 0 else 0.0
        found = (share, each.case)
        least[each.controller] = min(least.get(each.controller, found), found)
    words = [
        f"{law} converges from "
        + ("every start" if share == 100 else f"{number(share)} % of the starts in {case}")
        for law, (share, case) in least.items()
    ]
    cases = ", ".join(dict.fromkeys(each.case for each in content.maps))
    said = f"the worst of {cases}" if cases else ""
    return Answer(f"Region of {content.system}", MEASURED, "; ".join(words) or "no maps", said)


def _switching(content: StoredSwitching) -> Answer:
    """The most accurate law at the shortest sample time, and the orders of all."""
    samples = [x for x in content.benchmark.sample_times if x.max_sliding is not None]
    best = min(samples, key=lambda x: (x.h, x.max_sliding), default=None)
    words = "every law diverges"
    if best is not None:
        size = f"max |s| = {number(best.max_sliding)} at {number(best.h * 1e3)} ms"
        words = f"the most accurate is {best.law}: {size}"
    orders = [f"{law} {number(order)}" for law, order in content.benchmark.orders.items()]
    return Answer("Switching laws", MEASURED, words, f"orders: {', '.join(orders)}")


def _sweeps(content: StoredSweeps) -> Answer:
    """How many choices turn an answer."""
    turning = [each for each in content.sweeps if each.flips]
    words = f"{len(turning)} of {len(content.sweeps)} choices turn a claim's answer"
    few = "; ".join(f"{x.claim} by {x.choice}" for x in turning[:_FEW])
    more = f"; {len(turning) - _FEW} more" if len(turning) > _FEW else ""
    return Answer("Claims over what the chapter leaves open", MEASURED, words, few + more)


def _premises(content: StoredPremises) -> Answer:
    """How many premises fail."""
    judged = [(audit, each) for audit in content.premises for each in audit.premises]
    failed = [(audit, each) for audit, each in judged if not each.holds]
    systems = ", ".join(dict.fromkeys(each.system for each in content.premises))
    asked = f"Premises of the theorems on {systems}"
    if not failed:
        return Answer(asked, KEPT, f"all {len(judged)} premises hold")
    audit, first = failed[0]
    words = f"{len(failed)} of {len(judged)} premises fail"
    return Answer(asked, BROKEN, words, f"{first.name} of {audit.controller} in {audit.case}")
