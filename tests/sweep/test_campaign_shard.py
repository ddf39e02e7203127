"""One part of a campaign: its rows against single runs, and who computes them plays no part."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from campaign_cases import BOTH, LAWS, LOAD, LQR, PLANT, campaign, falling, servo

from grosmc_mj.errors import UndefinedLawError
from grosmc_mj.experiments.metrics import (
    METRICS,
    NO_WINDOWS,
    Recording,
    compare_with_optimum,
    folded,
    measure,
    meters_of,
)
from grosmc_mj.experiments.requirements import Limit, margins_of, required, windows
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.sweep.screening import Batch, evaluate


@pytest.mark.parametrize("law", ["lqr", "grosmc"])
def test_rows_are_those_of_single_runs(law: str) -> None:
    asked = campaign(servo())
    values = asked.values(range(4))
    found = evaluate(asked, law, values)
    for i, row in enumerate(values):
        plant_sample = asked.plant_sample(row)
        run = simulate(
            plant_sample.plant(asked.plant),
            asked.laws[law],
            plant_sample.case.x0,
            duration=0.05,
            control_period=0.001,
            timestep=0.001,
            disturbances=plant_sample.case.disturbances,
            meters=meters_of(asked.laws[law], 0.001, NO_WINDOWS, plant_sample.case.onset),
            engine="native",
        )
        meters: Any = run.meters
        assert found["deviation"][i] == meters["deviation"]
        assert found["max_input"][i] == np.abs(run.command).max()
        assert found["margin deviation_below"][i] == 3e-3 - meters["deviation"]
        assert found["margin input_below"][i] == 10 - np.abs(run.command).max()
        if law == "grosmc":
            assert run.sliding is not None
            assert found["max_sliding"][i] == np.abs(run.sliding).max()
            assert found["margin sliding_below"][i] == 0.02 - np.abs(run.sliding).max()
        else:
            assert np.isnan(found["margin sliding_below"][i])
    assert found["status"].tolist() == ["completed"] * 4
    assert found["ended"].tolist() == [0.05] * 4


@pytest.mark.parametrize("law", ["lqr", "grosmc"])
def test_a_row_does_not_depend_on_its_neighbours_or_threads(law: str) -> None:
    asked = campaign(servo())
    values = asked.values(range(6))
    together = Batch(asked, values, [0] * 6, threads=1).run(law)
    alone = [Batch(asked, values[i : i + 1], [0], threads=2).run(law) for i in range(6)]
    for name in (*METRICS, "margin deviation_below", "margin sliding_below", "relative", "order"):
        own = np.array([one[name][0] for one in alone])
        assert together[name].tobytes() == own.tobytes()


def test_relative_is_the_least_margin_in_parts_of_its_limit() -> None:
    asked = campaign(servo())
    found = evaluate(asked, "grosmc", asked.values(range(8)))
    limits = {"deviation_below": 3e-3, "input_below": 10.0, "sliding_below": 0.02}
    shares = np.stack([found["margin " + key] / limit for key, limit in limits.items()])
    assert np.array_equal(found["relative"], shares.min(axis=0))


def test_runs_that_end_early_fail_with_their_cause() -> None:
    asked = falling()
    values = asked.values(range(16))
    found = evaluate(asked, "fl-lqr", values)
    ended = np.array(found["status"]) != "completed"
    assert 0 < ended.sum() < 16
    assert set(np.array(found["status"])[ended]) == {"undefined_law"}
    assert np.all(np.isneginf(found["margin deviation_below"][ended]))
    assert np.all(np.isneginf(found["relative"][ended]))
    assert np.all(np.isnan(found["deviation"][ended]))
    assert np.all(found["ended"][ended] < 0.3)
    assert np.all(found["ended"][~ended] == 0.3)
    assert np.all(np.isfinite(found["margin deviation_below"][~ended]))
    first = int(np.flatnonzero(ended)[0])
    plant_sample = asked.plant_sample(values[first])
    with pytest.raises(UndefinedLawError) as why:
        simulate(
            plant_sample.plant(asked.plant),
            asked.laws["fl-lqr"],
            plant_sample.case.x0,
            duration=0.3,
            control_period=0.001,
            engine="native",
        )
    assert float(why.value.trajectory.valid_until) == found["ended"][first]


def test_without_requirements_a_run_keeps_everything_if_it_completes() -> None:
    asked = campaign(servo(laws=LQR, limits=""))
    found = evaluate(asked, "lqr", asked.values(range(2)))
    assert not any(name.startswith("margin") for name in found.columns)
    assert found["relative"].tolist() == [1.0, 1.0]


def test_requirements_of_a_kind_have_columns_of_their_own() -> None:
    more = '[[requirement]]\nof = ["lqr"]\ndeviation_below = "{} mrad"\n'
    asked = campaign(servo(BOTH, laws=LAWS) + more.format(4) + more.format(5))
    found = evaluate(asked, "lqr", asked.values(range(2)))
    assert [name for name in found.columns if name.startswith("margin")][-2:] == [
        "margin deviation_below 2",
        "margin deviation_below 3",
    ]
    for number, wider in ((2, 1e-3), (3, 2e-3)):
        margins = found[f"margin deviation_below {number}"]
        np.testing.assert_allclose(margins - found["margin deviation_below"], wider, rtol=1e-12)


def test_errors_after_an_instant_are_measured_from_then_on() -> None:
    asked = campaign(
        servo(laws=LQR, limits="")
        + '[[requirement]]\nstays_within = "2 rad"\nafter = "40 ms"\n'
        + '[[requirement]]\nstays_within = "2 rad"\n'
    )
    found = evaluate(asked, "lqr", asked.values(range(2)))
    # The rotor starts 1 rad away and moves towards its goal.
    assert found["margin stays_within 2"].tolist() == [1.0, 1.0]
    assert np.all(found["margin stays_within"] > 1.0)


RATIO = "[[requirement]]\ncost_ratio_below = {}\n"


@pytest.mark.parametrize("law", ["lqr", "grosmc"])
def test_a_cost_ratio_is_that_of_the_recorded_run(law: str) -> None:
    asked = campaign(servo(limits=RATIO.format(1.5)))
    values = asked.values(range(4))
    margins = evaluate(asked, law, values)["margin cost_ratio_below"]
    for row, margin in zip(values, margins, strict=True):
        plant_sample = asked.plant_sample(row)
        run = simulate(
            plant_sample.plant(asked.plant),
            asked.laws[law],
            plant_sample.case.x0,
            duration=0.05,
            control_period=0.001,
            timestep=0.001,
            disturbances=plant_sample.case.disturbances,
            engine="native",
        )
        own = measure(run, asked.laws[law], compare_with_optimum(run, asked.laws[law]))
        whole, least = own["cost_whole"].value, own["cost_optimal"].value
        assert whole is not None
        assert least is not None
        assert margin == pytest.approx(1.5 - whole / least, rel=1e-9)
    assert len({*margins}) == 4


def test_a_run_without_any_cost_to_compare_with_fails() -> None:
    start = PLANT.format(system="servo", duration=0.05, start='{ "rotor angle" = "1 rad" }')
    asked = campaign(start + LOAD + BOTH + LQR + RATIO.format(1e6))
    found = evaluate(asked, "lqr", asked.values(range(2)))
    assert found["status"].tolist() == ["completed"] * 2
    assert np.all(np.isneginf(found["margin cost_ratio_below"]))
    assert np.all(found["relative"] < 0)


def test_every_requirement_and_metric_is_of_its_own_meter() -> None:
    kinds = {
        "deviation_below": 0.1,
        "input_below": 0.2,
        "sliding_below": 0.3,
        "cart_travel_below": 0.4,
        "no_reaching_phase": 0.5,
        "settles_within": 0.75,
        "cost_ratio_below": 0.6,
        "stays_within": 0.7,
    }
    limits = [Limit(kind, "1", 1.0, "", 0.0, ("lqr",), ("physics",)) for kind in kinds]
    named = ["deviation", "input", "sliding", "travel", "sliding_start"]
    meters = {name: np.array([value]) for name, value in zip(named, kinds.values(), strict=False)}
    # Outside of the band until 0.5 s of 0.6 s: nothing to be sure of, but something to compare.
    meters |= {"outside": np.array([[0.5]]), "left": np.array([0.8])}
    meters |= {
        "error": np.array([[0.7]]),
        "squares": np.array([[3.0]]),
        "count": np.full((1, 1), 4),
    }
    meters |= {"start": np.ones(1), "beyond": np.zeros(1)}
    recording = Recording.sampled(0.25, 0.6, np.array([np.inf]), windows(limits))
    found = {**folded(meters, recording), "cost_ratio": np.array([0.6])}
    margins = margins_of(required(limits, ["lqr"]), found, np.array([True]))
    assert {key: margin.item() for key, margin in margins.items()} == {
        kind: 1 - measured for kind, measured in kinds.items()
    }
    assert {name: found[name].item() for name in METRICS} == {
        "deviation": 0.1,
        "max_input": 0.2,
        "max_sliding": 0.3,
        "cart_travel": 0.4,
        "sliding_start": 0.5,
        "settling_time": np.inf,
    }
