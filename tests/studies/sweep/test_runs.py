"""Batches of runs that are not recorded: their metrics, columns and margins are recorded runs'."""

from __future__ import annotations

import tomllib
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
from campaigns import (
    LAWS,
    LIMITS,
    LQR,
    MASS,
    PAIR,
    campaign,
    falling,
    part,
    plain,
    servo,
    uncertain,
)

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.shipped import campaign_files
from grosmc_mj.experiments.file.text import text_of
from grosmc_mj.experiments.requirements.judging import judge_runs
from grosmc_mj.experiments.requirements.verdict import verdict_of_judgements
from grosmc_mj.ground.errors import UndefinedLawError
from grosmc_mj.mechanics.physics.files import load_model
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.studies.campaign.batch import Batch, evaluate
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.specification import specification_of
from grosmc_mj.studies.sweep.runs import Outcomes, Row, plant_of, run_rows

RATIO = {"cost_ratio_below": 1.5}


def kinds() -> str:
    """A servo of which all kinds of things are required."""
    limits = [
        RATIO,
        {"input_below": "10 A"},
        {"of": ["grosmc"], "sliding_below": "0.02 A s"},
        {"of": ["grosmc"], "no_reaching_phase": True},
        {"stays_within": "2 rad", "after": "40 ms"},
        {"stays_within": "2 rad"},
    ]
    return servo(MASS, limits=limits)


def behind_an_actuator() -> str:
    """A loop's actuator gives less than the law's command."""
    amplifier = {"of": "current", "limit": "4 A"}
    return servo(MASS, laws=LQR, limits=[{"input_below": "4.5 A"}], actuator=amplifier)


def travelling() -> str:
    """The cart is the furthest away at the end of the run."""
    return part(
        uncertain("edit.pole.mass_scale", 1, 3),
        system="cart_pendulum",
        run={"start": {"cart speed": "50 nm/s"}},
        requirement={"state": "cart position", "stays_within": "0.1 m"},
    )


def settling() -> str:
    """The servo settles at 4.02 s, before it is pushed."""
    push = {"body": "rotor", "torque": ["0 N m", "1 N m", "0 N m"], "profile": "pulse"}
    return part(
        MASS,
        run={"duration": "6 s"},
        disturbance={**push, "start": "5 s", "stop": "5.5 s"},
        requirement={"settles_within": "4.1 s"},
    )


def four_steps(**tables: Any) -> str:
    """The optimum moves on by a timestep between two samples of the law."""
    run = {"duration": "0.2 s", "control_period": "4 ms", "timestep": "1 ms"}
    return part(MASS, laws=PAIR, run=run, requirement={"input_below": "9 A"}, **tables)


def two_links() -> str:
    start = {"shoulder angle": "0.6 rad", "elbow angle": "-1.2 rad"}
    return part(
        uncertain("edit.lower.mass_scale", 1, 3),
        system="two_link_arm",
        run={"start": start},
        requirement=RATIO,
    )


def uneven() -> str:
    """It ends within a timestep."""
    limit = {"state": "rotor speed", "rms_below": "10 rad/s", "after": "0.1 s"}
    return part(MASS, run={"duration": "0.3003 s"}, requirement=limit)


EACH_CASE = pytest.mark.parametrize(
    ("text", "law"),
    [
        (kinds(), "lqr"),
        (kinds(), "grosmc"),
        (travelling(), "lqr"),
        (settling(), "lqr"),
        (behind_an_actuator(), "lqr"),
        (four_steps(), "stiff"),
        (four_steps(computing={"delay": "1 ms"}), "stiff"),
        (two_links(), "lqr"),
        (uneven(), "lqr"),
    ],
    ids=[
        "kinds, lqr",
        "kinds, grosmc",
        "travel",
        "settling",
        "actuator",
        "four steps",
        "four steps, delayed",
        "two links",
        "uneven",
    ],
)


@cache
def nominal(text: str, law: str) -> tuple[Campaign, Outcomes]:
    """A campaign, and the row of its nominal plant."""
    declared = campaign(text, runs=2)
    return declared, evaluate(declared, law, declared.family.nominal[None])


def in_python(text: str) -> str:
    """The text of a case whose runs are made by the engine in Python."""
    content = tomllib.loads(text)
    content["run"]["engine"] = "python"
    return text_of(content)


@EACH_CASE
def test_both_engines_give_the_same_row(text: str, law: str) -> None:
    _, row = nominal(text, law)
    _, by_python = nominal(in_python(text), law)
    for name in row.columns.keys() - {"status", "controller", "judged_by"}:
        assert row[name].tobytes() == by_python[name].tobytes(), name


@EACH_CASE
def test_metrics_and_margins_of_a_batch_are_a_recorded_run_s(text: str, law: str) -> None:
    """To the bit."""
    declared, row = nominal(text, law)
    result = declared.experiment.run("physics", law)
    judged = judge_runs(declared.requirements, [result])
    margins = {judgement.requirement.name: judgement.margin for judgement in judged}
    assert margins
    assert {name: row[f"margin {name}"][0] for name in margins} == margins
    shares = [(judgement.margin or 0.0) / judgement.requirement.number for judgement in judged]
    assert row["relative"][0] == min(shares)

    # The overshoot of a batch is a share.
    shared = row.columns.keys() & result.metrics.keys() - {"overshoot"}
    assert len(shared) > 9
    metrics = {name: result.metrics[name].value for name in shared}
    metrics = {name: value for name, value in metrics.items() if value is not None}
    assert {name: row[name][0] for name in metrics} == metrics


def test_a_margin_that_a_saturated_input_holds_at_zero_does_not_hide_the_others() -> None:
    """The load takes all that the actuator gives: the margin of the input is 0 on every plant."""
    limits = [{"deviation_below": "1 rad", "input_below": "1 mA"}]
    amplifier = {"of": "current", "limit": "1 mA"}
    declared = campaign(servo(MASS, laws=LQR, limits=limits, actuator=amplifier), runs=2)
    row = evaluate(declared, "lqr", declared.family.values(np.array([[0.1], [0.9]])))
    assert row["margin input_below"].tolist() == [0.0, 0.0]
    assert row["relative"].tolist() == row["margin deviation_below"].tolist()
    assert 0 < row["order"][0] != row["order"][1]


# Rows of a batch.

EACH_LAW = pytest.mark.parametrize("law", ["lqr", "grosmc"])


@cache
def four_servos() -> Campaign:
    """A campaign of servos, of which four are run."""
    return campaign(servo(laws=LAWS, limits=[*LIMITS, RATIO]))


@cache
def together(law: str) -> Outcomes:
    """Four servos in a batch."""
    return Batch(four_servos(), four_servos().values(range(4)), [0] * 4, threads=1).run(law)


@EACH_LAW
@pytest.mark.parametrize("i", [0, 3])
def test_a_row_depends_on_its_plant_alone(i: int, law: str) -> None:
    """It is that of a single run, whatever its neighbours and the number of threads."""
    values = four_servos().values(range(i, i + 1))
    alone = Batch(four_servos(), values, [0], threads=2).run(law)
    for name, column in together(law).columns.items():
        if column.dtype == float:
            assert column[i : i + 1].tobytes() == alone[name].tobytes(), name


@EACH_LAW
def test_rows_of_different_plants_differ(law: str) -> None:
    assert len({*together(law)["deviation"]}) == 4


@EACH_LAW
def test_laws_without_a_surface_have_no_margin_of_sliding(law: str) -> None:
    assert np.isnan(together(law)["margin sliding_below"]).all() == (law == "lqr")


# Runs that end early.


@cache
def fallen() -> Outcomes:
    """Sixteen pendulums, of which some fall."""
    return evaluate(falling(), "fl-lqr", falling().values(range(16)))


def test_runs_that_end_early_fail_with_their_cause() -> None:
    rows = fallen()
    ended = ~rows.completed
    assert 0 < ended.sum() < 16
    assert set(rows["status"][ended]) == {"undefined_law"}
    assert np.all(np.isneginf(rows["margin deviation_below"][ended]))
    assert np.all(np.isneginf(rows["relative"][ended]))


def test_runs_that_end_early_have_no_metrics() -> None:
    rows = fallen()
    assert np.array_equal(np.isnan(rows["deviation"]), ~rows.completed)
    assert np.array_equal(rows["ended"] < 0.3, ~rows.completed)
    assert np.all(rows["ended"][rows.completed] == 0.3)


def test_of_runs_that_end_early_the_earlier_is_the_worse() -> None:
    rows = fallen()
    order = rows["order"][~rows.completed]
    ended = rows["ended"][~rows.completed]
    assert np.all(np.diff(ended[np.argsort(order)]) >= 0)
    assert order.max() < rows["order"][rows.completed].min()


def test_a_run_that_ends_early_ends_when_a_single_one_does() -> None:
    first = int(np.flatnonzero(~fallen().completed)[0])
    (values,) = falling().values(range(first, first + 1))
    sample = falling().plant_sample(values)
    with pytest.raises(UndefinedLawError) as refusal:
        simulate(
            plant_of(sample, falling().plant),
            falling().laws["fl-lqr"],
            sample.x0,
            duration=0.3,
            control_period=0.001,
            engine="native",
        )
    assert float(refusal.value.trajectory.valid_until) == fallen()["ended"][first]


# Margins.


def evaluated(text: str) -> Outcomes:
    """Two runs under LQR."""
    declared = campaign(text)
    return evaluate(declared, "lqr", declared.values(range(2)))


def test_without_a_requirement_there_is_no_margin() -> None:
    rows = evaluated(plain())
    assert not any(name.startswith("margin") for name in rows.columns)
    assert rows["relative"].tolist() == [1.0, 1.0]


def test_requirements_of_one_kind_have_columns_of_their_own() -> None:
    wider = [{"of": ["lqr"], "deviation_below": limit} for limit in ("4 mrad", "5 mrad")]
    rows = evaluated(servo(limits=[*LIMITS, *wider]))
    first = rows["margin deviation_below"]
    np.testing.assert_allclose(rows["margin deviation_below 2"] - first, 1e-3, rtol=1e-12)
    np.testing.assert_allclose(rows["margin deviation_below 3"] - first, 2e-3, rtol=1e-12)


def test_a_run_without_a_cost_to_compare_with_fails() -> None:
    """It starts at its reference."""
    start = {"rotor angle": "1 rad"}
    limits = [{"cost_ratio_below": 1e6}]
    rows = evaluated(servo(MASS, laws=LQR, limits=limits, run={"start": start}))
    assert rows["status"].tolist() == ["completed"] * 2
    assert np.all(np.isneginf(rows["margin cost_ratio_below"]))
    assert np.all(rows["relative"] < 0)


# Designs of experiments: rows of their own cases and laws.


def row_of(table: Outcomes, index: int) -> dict[str, str]:
    """A row of a table as texts."""
    return {name: str(values[index]) for name, values in table.columns.items()}


EXPERIMENT = Experiment.load("servo/case1").changed(duration=0.1)


def heavier(scale: float) -> Experiment:
    """The case with a heavier rotor and another start."""
    return EXPERIMENT.changed(
        {"edit.rotor.mass_scale": scale, "run.start.rotor angle": 0.1 * scale}
    )


DESIGN = [Row(law, case=heavier(scale)) for scale in (1.0, 1.5) for law in ("lqr", "grosmc")]


@cache
def designed() -> Outcomes:
    """The rows of a design."""
    return run_rows(EXPERIMENT, DESIGN)


@pytest.mark.parametrize("index", [1, 2])
def test_a_row_of_a_design_is_the_row_alone(index: int) -> None:
    alone = run_rows(EXPERIMENT, [DESIGN[index]])
    assert row_of(alone, 0) == row_of(designed(), index)


@pytest.mark.parametrize("index", [0, 1])
def test_each_design_of_a_law_in_one_batch_is_measured_by_its_own_optimum(index: int) -> None:
    """LQR for a cheap input, and for a dear one."""
    laws = [EXPERIMENT.changed({"task.R": weight}).law("physics", "lqr") for weight in (0.1, 10.0)]
    rows = [Row(law) for law in laws]
    alone = run_rows(EXPERIMENT, [rows[index]])
    assert row_of(alone, 0) == row_of(run_rows(EXPERIMENT, rows), index)


@pytest.mark.parametrize("index", [2, 3])
def test_a_verdict_on_a_row_is_that_on_its_recorded_run(index: int) -> None:
    row: Any = DESIGN[index]
    limits = [limit for limit in designed().limits if row.law in limit.laws]
    verdict = designed().verdict(index, limits)
    recorded = verdict_of_judgements(row.case.run("physics", row.law).requirements)
    assert (verdict.kept, verdict.tightest) == (recorded.kept, recorded.tightest)
    assert verdict.shares == pytest.approx(recorded.shares, rel=1e-9)


def test_rows_by_equations_agree_with_physics() -> None:
    by_equations = run_rows(EXPERIMENT, DESIGN, plant="corrected")
    np.testing.assert_allclose(
        by_equations["deviation"], designed()["deviation"], rtol=1e-6, atol=1e-9
    )


BENCH = Experiment.load("servo/bench").changed(duration=0.05)


def delayed(delay: float) -> Experiment:
    """The bench whose angle is measured some time [s] late."""
    assert BENCH.loop is not None
    return BENCH.changed(loop=BENCH.loop.changed("sensor", "rotor angle", delay=delay))


# A delay that is no whole number of timesteps.
IMPOSSIBLE = Row("grosmc", case=delayed(0.00015))
LOOP_DESIGN = [
    Row("grosmc", case=delayed(0.002)),
    Row("grosmc", case=delayed(0.004)),
    IMPOSSIBLE,
    Row("grosmc", number=1),
    Row("grosmc", number=1),
    Row("grosmc", number=2),
]


@cache
def looped() -> Outcomes:
    """The rows of a design of loops."""
    return run_rows(BENCH, LOOP_DESIGN, [], keep_impossible=True, threads=2)


def test_an_impossible_row_is_an_outcome_if_that_is_wanted() -> None:
    table = looped()
    assert table["status"].tolist() == ["completed"] * 2 + ["impossible"] + ["completed"] * 3
    assert "delay = 0.00015 s is no multiple" in table.impossible[2]
    with pytest.raises(ValueError, match="is no multiple"):
        run_rows(BENCH, [IMPOSSIBLE], [])


def test_a_delay_reaches_its_run() -> None:
    first, later = looped()["deviation"][:2]
    assert first != later


def test_chance_of_a_run_depends_on_its_number_alone() -> None:
    once, again, other = looped()["left"][3:]
    assert once == again != other
    alone = run_rows(BENCH, LOOP_DESIGN[5:], [], threads=1)
    assert row_of(alone, 0) == row_of(looped(), 5)


@pytest.mark.parametrize("name", campaign_files())
def test_a_shipped_campaign_steps_as_its_model_says(name: str) -> None:
    file = specification_of(name).file
    assert file.plant.system is not None
    assert load_model(file.plant.system).opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    assert file.run.integrator in (None, "RK4")


@pytest.mark.parametrize("durations", [(0.05, 0.02), (0.02, 0.05)])
def test_rows_of_two_durations_are_each_run_to_their_own_end(
    durations: tuple[float, float],
) -> None:
    experiment = Experiment.load("servo/nominal")
    ones = [experiment.changed(duration=duration) for duration in durations]
    outcomes = run_rows(experiment, [Row("lqr", case=case) for case in ones], limits=[])
    assert outcomes["ended"].tolist() == list(durations)
    ends = [case.run("physics", "lqr").trajectory.state[-1] for case in ones]
    np.testing.assert_array_equal(outcomes["last"], ends)
