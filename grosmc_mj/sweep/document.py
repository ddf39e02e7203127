"""results.json, worst.json, radius.json and a replay's JSON: what a campaign says, as results."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from grosmc_mj.arrays import Array
from grosmc_mj.experiments.metrics import METRICS
from grosmc_mj.results.result import (
    KEPT,
    MEASURED,
    NOT_KEPT,
    OPEN,
    Answer,
    LineChart,
    Series,
    Sheet,
    Value,
    finite,
    result,
)
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.findings import ALL, NO_PROOF, Findings
from grosmc_mj.sweep.manifest import configuration_of
from grosmc_mj.sweep.radius import Radius
from grosmc_mj.sweep.replay import ReplayedRun
from grosmc_mj.sweep.runs import MARGIN
from grosmc_mj.sweep.statistics import PassRate
from grosmc_mj.sweep.tables import findings_tables, radius_table, worst_table
from grosmc_mj.sweep.worst import Worst

RESULTS = "results.json"


def results_document(campaign: Campaign, found: Findings) -> dict[str, Any]:
    """What the runs say; a margin without bound is that of a run that did not complete."""
    complete = found.sampled.runs == found.sampled.planned
    # Where nothing is required, the rates are those of the runs that complete.
    rates = [(law, rate) for (of, law), rate in found.rates.items() if of == ALL] or [
        (law, rate) for (_, law), rate in found.rates.items()
    ]
    kept = all(rate.kept == rate.runs for _, rate in rates)
    answer = Answer(
        question=f"Campaign {campaign.specification.name}",
        verdict=NOT_KEPT if not kept else KEPT if complete else OPEN,
        words="; ".join(f"{law}: {_rate_words(rate)}" for law, rate in rates),
    )
    return _result(
        campaign,
        "campaign",
        complete=complete,
        answers=[answer],
        sheets=[Sheet(table=table) for table in findings_tables(campaign, found)],
        sampled={**found.sampled._asdict(), "words": found.sampled.words},
        says=found.sampled.footnote,
        intervals=found.sampled.intervals,
        distributions_from=found.looked_at.runs,
        pass_rates=[
            {"requirement": requirement, "controller": law, **rate._asdict()}
            for (requirement, law), rate in found.rates.items()
        ],
        ended_early=dict(found.cut_short),
        judged={
            law: {**judge._asdict(), "wrong_at_most": judge.wrong_at_most}
            for law, judge in found.judges.items()
        },
        margins=[
            {
                "requirement": requirement,
                "controller": law,
                "unit": found.units[requirement],
                **summary._asdict(),
            }
            for (requirement, law), summary in found.summaries.items()
        ],
        differences=[
            {"requirement": requirement, "first": first, "second": second, **pair._asdict()}
            for (requirement, first, second), pair in found.differences.items()
        ],
        drivers={
            law: [driver._asdict() for driver in drivers]
            for law, drivers in found.sensitivities.items()
        },
        worst_runs=dict(found.worst),
        units={number.name: number.unit for number in campaign.family.quantities},
    )


def _rate_words(rate: PassRate) -> str:
    """A share of runs with its interval."""
    if rate.low is None or rate.high is None:
        return f"{rate.kept} of {rate.runs}"
    return f"{rate.kept} of {rate.runs} [{100 * rate.low:.4g} to {100 * rate.high:.4g} %]"


def worst_document(campaign: Campaign, found: Sequence[Worst]) -> dict[str, Any]:
    """The worst plants, by controller."""
    failing = [plant.controller for plant in found if plant.fails]
    answer = Answer(
        question=f"Worst plants of {campaign.specification.name}",
        verdict=NOT_KEPT if failing else MEASURED,
        words=f"a failing plant was found for {', '.join(failing)}" if failing else "none fails",
    )
    return _result(
        campaign,
        "worst",
        answers=[answer],
        sheets=[Sheet(table=worst_table(campaign, found))],
        values=[
            Value(name=f"{plant.controller}: least margin", value=finite(plant.relative), better=1)
            for plant in found
        ],
        says=NO_PROOF,
        controllers={
            plant.controller: {
                "fails": plant.fails,
                "relative": plant.relative,
                "worst": _named(campaign, plant.values),
                "worst_by": plant.winner,
                "worst_of_the_samples": plant.samples,
                "worst_of_the_search": plant.search,
                "worst_of_as_many_random_plants": plant.random,
                "evaluations": plant.evaluations,
                "shrunk": _named(campaign, plant.shrunk),
                "shrunk_relative": plant.shrunk_relative,
                "not_nominal": list(plant.changed),
            }
            for plant in found
        },
    )


def radius_document(campaign: Campaign, found: Sequence[Radius]) -> dict[str, Any]:
    """How far each controller keeps what is required."""
    charts = [_radius_chart(search) for search in found]
    reached = [f"{search.controller}: no failure up to {search.found:.3g}" for search in found]
    question = f"How far the uncertainty of {campaign.specification.name} may grow"
    return _result(
        campaign,
        "radius",
        answers=[Answer(question=question, verdict=MEASURED, words="; ".join(reached))],
        sheets=[Sheet(table=radius_table(campaign, found), charts=charts)],
        values=[
            Value(name=f"{search.controller}: no failure up to", value=search.found, better=1)
            for search in found
        ],
        says=NO_PROOF,
        controllers={
            search.controller: {
                "found": search.found,
                "largest_looked_at": search.largest,
                "plants_at_each_scale": search.plants,
                "outside": search.outside and _named(campaign, search.outside.values),
                "outside_scale": search.outside and search.outside.scale,
                "promised": search.promised.scale,
                "promised_note": search.promised.note,
                "surface_band": search.promised.band,
                "surface_kept": search.stayed,
                "surface_left_scale": search.left and search.left.scale,
                "surface_left": search.left and _named(campaign, search.left.leaver),
                "looks": [
                    {
                        "scale": look.scale,
                        "least": look.least,
                        "failures": look.failures,
                        "surface": look.surface,
                        "leaving": look.leaving,
                    }
                    for look in search.looks
                ],
            }
            for search in found
        },
    )


def _radius_chart(search: Radius) -> LineChart:
    """Least margin over the scale of the uncertainty."""
    looks = search.looks
    series = Series(
        name="least margin",
        x=[look.scale for look in looks],
        y=[finite(look.least) for look in looks],
        good=[look.failures == 0 for look in looks],
    )
    return LineChart(
        name=search.controller,
        titles=("scale of the uncertainty (1 as declared)", "least margin over its limit"),
        lines=[series],
        limit=0.0,
        marks=[at for at in (search.found, search.promised.scale) if at],
    )


def replay_document(campaign: Campaign, found: ReplayedRun, engine: str) -> dict[str, Any]:
    """One run that was repeated."""
    outcome, differences = found.outcome, found.differences
    law = outcome["controller"][0]
    question = f"Run {outcome['id'][0]} of {campaign.specification.name} under {law} again"
    words = "not compared" if differences is None else "as stored, bit by bit"
    verdict = MEASURED if differences is None else NOT_KEPT if differences else KEPT
    if differences:
        words = f"not as stored: {'; '.join(differences)}"
    return _result(
        campaign,
        "replay",
        answers=[Answer(question=question, verdict=verdict, words=words)],
        engine=engine,
        controller=law,
        judged_by=outcome["judged_by"][0],
        uncertain={name: outcome[name][0] for name in campaign.family.names},
        status=outcome["status"][0],
        ended=outcome["ended"][0],
        metrics={name: outcome[name][0] for name in METRICS},
        margins={limit.words: outcome[MARGIN + limit.key][0] for limit in campaign.limits_of(law)},
        as_stored=None if differences is None else not differences,
        differences=differences or [],
    )


def _result(campaign: Campaign, kind: str, **fields: Any) -> dict[str, Any]:
    seed = campaign.specification.seed
    return result(kind, configuration_of(campaign), seed=seed, **fields)


def _named(campaign: Campaign, values: Array | None) -> dict[str, float] | None:
    """The uncertain numbers by name."""
    names = campaign.family.names
    return None if values is None else dict(zip(names, values.tolist(), strict=True))
