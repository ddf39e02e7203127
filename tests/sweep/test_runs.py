"""Batches of runs that are not recorded: their meters, columns and margins are recorded runs'."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from campaign_cases import (
    BOTH,
    DEVIATION,
    INERTIA,
    LAWS,
    LIMITS,
    LOAD,
    LQR,
    PAIR,
    PLANT,
    campaign,
    case,
    falling,
    plain,
    servo,
)

from grosmc_mj.errors import ArgumentError, UndefinedLawError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.shipped import campaign_files
from grosmc_mj.experiments.metrics import (
    METRICS,
    NO_WINDOWS,
    Windows,
    compare_with_optimum,
    measure,
    meters_of,
    noted,
)
from grosmc_mj.experiments.requirements import judge_all
from grosmc_mj.physics.files import load_model
from grosmc_mj.simulation.disturbances import Disturbance, Pulse
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.sweep.campaign import Campaign, Specification, specification_of
from grosmc_mj.sweep.runs import Outcomes, Row, run_rows
from grosmc_mj.sweep.screening import EQUATIONS, Batch, evaluate

SYSTEMS = {
    "servo": ("rotor", "{}"),
    "cart_pendulum": ("pole", '{ "pole angle" = "-10 deg", "cart speed" = "0.3 m/s" }'),
    "arm": ("link", '{ "joint rate" = "180 deg/s" }'),
    "two_link_arm": ("lower", '{ "shoulder angle" = "0.6 rad", "elbow angle" = "-1.2 rad" }'),
}
ONSET, WINDOWS = 0.06, Windows((0.0, 0.05, 0.12))


@pytest.mark.parametrize(
    ("system", "law"),
    [
        ("servo", "lqr"),
        ("servo", "grosmc"),
        *(
            pytest.param(system, law, marks=pytest.mark.slow)
            for system, laws in (
                ("cart_pendulum", ("lqr", "grosmc")),
                ("arm", ("lqr", "grosmc")),
                ("two_link_arm", ("lqr", "grosmc")),
                # Laws with dynamics, whose matrices depend on the period.
                ("servo", ("lqi", "pid", "adrc", "adaptive")),
            )
            for law in laws
        ),
    ],
)
def test_running_meters_are_those_of_the_recorded_samples(system: str, law: str) -> None:
    """Under a push, the law sampled every other timestep; bit for bit in both engines."""
    body, start = SYSTEMS[system]
    tables = f'[[uncertain]]\nbody = "{body}"\nmass_scale = [1, 2]\n'
    declared = campaign(case(system, tables, start=start, laws=f'[[controller]]\nlaw = "{law}"\n'))
    controller = declared.laws[law]
    push = Disturbance(body, (0.3, 0, 0.2, 0, 0.1, 0), Pulse(ONSET, ONSET + 0.03))

    def run(engine: Any) -> Any:
        return simulate(
            declared.plant, controller, declared.experiment.case.x0,
            duration=0.2, control_period=0.002, timestep=0.001, disturbances=[push],
            meters=meters_of(controller, 0.001, WINDOWS, ONSET, costs=True), engine=engine,
        )  # fmt: skip

    native, python = run("native"), run("python")
    assert native.meters.tobytes() == python.meters.tobytes()
    # The state at the end is no sample of a law.
    names = ("time", "state", "command", "weighed")
    samples = replace(native, **{name: getattr(native, name)[:-1] for name in names})
    samples = replace(samples, input=samples.command)
    comparison = compare_with_optimum(samples, controller)
    recorded, running = noted(samples, comparison, ONSET, WINDOWS)[0], np.atleast_1d(native.meters)
    # Of a law with an optimum a recorded run has neither its state nor its costs.
    for name in set(recorded.dtype.names) - {"optimal", "z", "after", "still", "costs"}:
        if name == "deviation" or len(comparison.outputs) > 1:
            # One step of the optimum after another, and a norm in another order.
            assert running[name] == pytest.approx(recorded[name], rel=1e-9, abs=1e-15), name
        else:
            assert running[name].tobytes() == recorded[name].tobytes(), name
    metrics = measure(samples, controller, comparison, ONSET)
    if system == "cart_pendulum":
        assert running["travel"][0] == metrics["cart_travel"].value != 0.0
    cost = (running["costs"]["of_state"][0] + running["costs"]["of_input"][0]) / 2
    assert cost == pytest.approx(metrics["cost_whole"].value, rel=1e-12)


RATIO = "[[requirement]]\ncost_ratio_below = 1.5\n"
# A recorded run has the deviation at its end besides, so that this is compared further below.
KINDS = f"""{RATIO}
[[requirement]]
input_below = "10 A"
[[requirement]]
of = ["grosmc"]
sliding_below = "0.02 A s"
[[requirement]]
of = ["grosmc"]
no_reaching_phase = true
[[requirement]]
stays_within = "2 rad"
after = "40 ms"
[[requirement]]
stays_within = "2 rad"
"""
LATE = LOAD.replace("0.02 s", "5 s").replace("0.03 s", "5.5 s")
ACTUATOR = '[[actuator]]\nof = "current"\nlimit = "4 A"\n'
CURRENT = '[[requirement]]\ninput_below = "4.5 A"\n'
SETTLES = '[[requirement]]\nsettles_within = "4.1 s"\n'
# In a timestep it travels less than the tolerance, so that the state at the end does not count.
TRAVEL = '[[requirement]]\ncart_travel_below = "0.1 m"\n'
CART = case(
    "cart_pendulum", INERTIA.replace("rotor", "pole"), start='{ "cart speed" = "50 nm/s" }',
    limits=TRAVEL, laws=LQR,
)  # fmt: skip
LEVER = """
<mujoco model="lever">
  <option timestep="0.001" integrator="RK4"/>
  <worldbody>
    <body name="bar" pos="0 0 1">
      <joint name="hinge" axis="0 -1 0" damping="0.2"/>
      <geom type="capsule" fromto="0 0 0  0.4 0 0" size="0.03" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor name="hinge" joint="hinge" ctrllimited="true" ctrlrange="-1.5 1.5"/></actuator>
</mujoco>
"""
LEVER_CASE = """
[plant]
model = "lever.xml"
[run]
engine = "python"
start = { hinge = "-60 deg" }
duration = "0.1 s"
[task]
Q = [400, 10]
R = 1
[[controller]]
law = "lqr"
[[requirement]]
input_below = "1.6 N m"
[[uncertain]]
body = "bar"
mass_scale = [1, 1.5]
"""


@pytest.mark.parametrize(
    ("text", "law"),
    [
        (servo(INERTIA, limits=KINDS), "lqr"),
        (servo(INERTIA, limits=KINDS), "grosmc"),
        (CART, "lqr"),
        # The servo settles at 4.02 s.
        (case("servo", INERTIA, duration=6, disturbances=LATE, limits=SETTLES, laws=LQR), "lqr"),
        # A loop's actuator, and a model's, give less than the law's command.
        (servo(INERTIA, limits=CURRENT, laws=LQR) + ACTUATOR, "lqr"),
        pytest.param(LEVER_CASE, "lqr", marks=pytest.mark.slow),
    ],
)
def test_margins_of_a_batch_are_those_of_the_recorded_run(
    text: str, law: str, tmp_path: Path
) -> None:
    (tmp_path / "lever.xml").write_text(LEVER)
    (tmp_path / "case.toml").write_text(text)
    experiment = Experiment.load(tmp_path / "case.toml")
    result = experiment.run("physics", law)
    declared = Campaign.load(str(tmp_path / "case.toml"), runs=2)
    row = evaluate(declared, law, declared.family.nominal[None])
    judged = judge_all(declared.limits_of(law), [result])
    assert judged
    for judgement in judged:
        margin = row[f"margin {judgement.limit.key}"][0]
        # One step of the optimum after another; k T by adding T to (k - 1) T.
        assert margin == pytest.approx(judgement.margin, rel=1e-9, abs=1e-10), judgement.limit.key
    shares = [(judgement.margin or 0.0) / judgement.limit.value for judgement in judged]
    assert row["relative"][0] == pytest.approx(min(shares), rel=1e-9)
    for name in METRICS.keys() & result.metrics.keys() - {"deviation"}:
        value = result.metrics[name].value
        if value is not None:
            assert row[name][0] == pytest.approx(value, rel=1e-9, abs=1e-10), name


@pytest.mark.parametrize("law", ["lqr", "grosmc"])
def test_a_row_is_that_of_a_single_run_whatever_its_neighbours_and_threads(law: str) -> None:
    declared = campaign(servo(limits=LIMITS + RATIO))
    values = declared.values(range(4))
    together = Batch(declared, values, [0] * 4, threads=1).run(law)
    for i in range(4):
        alone = Batch(declared, values[i : i + 1], [0], threads=2).run(law)
        for name, column in together.columns.items():
            if column.dtype == float:
                assert column[i : i + 1].tobytes() == alone[name].tobytes(), name
        sample = declared.plant_sample(values[i])
        run = simulate(
            sample.plant(declared.plant), declared.laws[law], sample.case.x0, duration=0.05,
            control_period=0.001, timestep=0.001, disturbances=sample.case.disturbances,
        )  # fmt: skip
        comparison = compare_with_optimum(run, declared.laws[law])
        metrics = measure(run, declared.laws[law], comparison)
        largest = np.abs(comparison.deviation[:-1]).max()
        assert together["deviation"][i] == pytest.approx(largest, rel=1e-9)
        assert together["margin input_below"][i] == 10 - np.abs(run.command).max()
        whole, least = metrics["cost_whole"].value, metrics["cost_optimal"].value
        assert whole is not None
        assert least is not None
        margin = together["margin cost_ratio_below"][i]
        assert margin == pytest.approx(1.5 - whole / least, rel=1e-9)
    assert len({*together["deviation"]}) == 4
    assert np.isnan(together["margin sliding_below"]).all() == (law == "lqr")


def test_runs_that_end_early_fail_with_their_cause() -> None:
    declared = falling()
    values = declared.values(range(16))
    rows = evaluate(declared, "fl-lqr", values)
    ended = ~rows.completed
    assert 0 < ended.sum() < 16
    assert set(rows["status"][ended]) == {"undefined_law"}
    assert np.all(np.isneginf([rows["margin deviation_below"][ended], rows["relative"][ended]]))
    assert np.all(np.isnan(rows["deviation"]) == ended)
    assert np.all((rows["ended"] < 0.3) == ended)
    assert np.all(rows["ended"][~ended] == 0.3)
    # The earlier is the worse.
    early = np.flatnonzero(ended)
    by_order = rows["ended"][early[np.argsort(rows["order"][early])]]
    assert np.all(np.diff(by_order) >= 0)
    assert rows["order"][early].max() < rows["order"][~ended].min()
    sample = declared.plant_sample(values[early[0]])
    with pytest.raises(UndefinedLawError) as refusal:
        simulate(
            sample.plant(declared.plant), declared.laws["fl-lqr"], sample.case.x0,
            duration=0.3, control_period=0.001, engine="native",
        )  # fmt: skip
    assert float(refusal.value.trajectory.valid_until) == rows["ended"][early[0]]


def evaluated(text: str) -> Outcomes:
    """Two runs under LQR."""
    declared = campaign(text)
    return evaluate(declared, "lqr", declared.values(range(2)))


def test_without_requirements_a_run_keeps_everything_if_it_completes() -> None:
    rows = evaluated(plain())
    assert not any(name.startswith("margin") for name in rows.columns)
    assert rows["relative"].tolist() == [1.0, 1.0]


def test_requirements_of_a_kind_have_columns_of_their_own() -> None:
    more = '[[requirement]]\nof = ["lqr"]\ndeviation_below = "{} mrad"\n'
    rows = evaluated(servo(laws=LAWS) + more.format(4) + more.format(5))
    first = rows["margin deviation_below"]
    for number, wider in ((2, 1e-3), (3, 2e-3)):
        margins = rows[f"margin deviation_below {number}"]
        np.testing.assert_allclose(margins - first, wider, rtol=1e-12)


def test_a_run_without_any_cost_to_compare_with_fails() -> None:
    start = PLANT.format(system="servo", duration=0.05, start='{ "rotor angle" = "1 rad" }')
    rows = evaluated(start + LOAD + BOTH + LQR + RATIO.replace("1.5", "1e6"))
    assert rows["status"].tolist() == ["completed"] * 2
    assert np.all(np.isneginf(rows["margin cost_ratio_below"]))
    assert np.all(rows["relative"] < 0)


@pytest.mark.parametrize("loop", ["", '[computing]\ndelay = "1 ms"\n'], ids=["ideal", "loop"])
@pytest.mark.parametrize("period", ["1 ms", "4 ms"])
def test_the_optimum_moves_on_by_a_timestep_between_two_comparisons(period: str, loop: str) -> None:
    text = PLANT.format(system="servo", duration=0.2, start='{}\ntimestep = "1 ms"')
    text = text.replace('control_period = "1 ms"', f'control_period = "{period}"')
    declared = campaign(text + loop + PAIR + DEVIATION + INERTIA)
    values = declared.values(range(1))
    sample, row = declared.plant_sample(values[0]), evaluate(declared, "stiff", values)
    plant: Any = sample.plant(declared.plant)
    run = simulate(
        plant.analytic() if row["judged_by"][0] == EQUATIONS else plant, declared.laws["stiff"],
        sample.case.x0, duration=0.2, timestep=1e-3,
        control_period=declared.experiment.settings.control_period,
    )  # fmt: skip
    deviation = compare_with_optimum(run, declared.laws["stiff"]).deviation[:-1]
    assert row["deviation"][0] == pytest.approx(np.abs(deviation).max(), rel=1e-9)


def test_one_law_measures_many_batches_without_compiling_again_and_needs_an_optimum() -> None:
    law = campaign(servo()).laws["grosmc"]
    other = meters_of(law, 0.001, Windows((0.5,)), 0.5)
    assert meters_of(law, 0.001, NO_WINDOWS, 0.02).note is other.note
    with pytest.raises(ArgumentError, match="grosmc has no error coordinates and no optimum"):
        meters_of(replace(law, design=None), 0.001, NO_WINDOWS, 0.0)


# Rows of a design, with values by their paths.


def row_of(table: Outcomes, index: int) -> dict[str, str]:
    return {name: str(values[index]) for name, values in table.columns.items()}


def test_a_row_of_a_design_is_the_row_alone_and_equations_agree_with_physics() -> None:
    experiment = Experiment.load("servo/case1").varied(duration=0.1)
    design = [
        Row(law, {"body.rotor.mass_scale": scale, "start.rotor angle.value": 0.1 * scale})
        for scale in (1.0, 1.5, 2.0)
        for law in ("lqr", "grosmc")
    ]
    table = run_rows(experiment, design)
    for i in (1, 4):
        assert row_of(run_rows(experiment, [design[i]]), 0) == row_of(table, i)
    by_equations = run_rows(experiment, design, plant="corrected")
    np.testing.assert_allclose(by_equations["deviation"], table["deviation"], rtol=1e-6, atol=1e-9)


def test_numbers_of_a_loop_are_as_run_and_an_impossible_row_is_an_outcome() -> None:
    bench, delay = Experiment.load("servo/bench").varied(duration=0.05), "sensor.rotor angle.delay"
    design = [Row("grosmc", {delay: seconds}) for seconds in (0.002, 0.0021, 0.004)]
    impossible = Row("grosmc", {"sensor.no state.delay": 0.0})
    # Chance of a run depends on its number alone, and not on the run before it.
    design += [impossible, *(Row("grosmc", number=number) for number in (1, 1, 2))]
    table = run_rows(bench, design, [], keep_impossible=True, threads=2)
    assert table["status"].tolist() == ["completed"] * 3 + ["impossible"] + ["completed"] * 3
    assert "no state" in table.impossible[3]
    first, rounded, later = table["deviation"][:3]
    assert first == rounded != later
    once, again, other = table["left"][4:]
    assert once == again != other
    assert row_of(run_rows(bench, design[6:], [], threads=1), 0) == row_of(table, 6)
    with pytest.raises(ValueError, match="no state"):
        run_rows(bench, [impossible], [])


# The integrator.


@pytest.mark.parametrize("name", campaign_files())
def test_a_shipped_campaign_steps_as_its_model_says(name: str) -> None:
    file = specification_of(name).file
    assert file.plant.system is not None
    assert load_model(file.plant.system).opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    assert file.run.integrator in (None, "RK4")


# Of 256 arms drawn with seed 7, those of which GROSMC keeps more under implicitfast at 1 ms.
NEAR_A_LIMIT = [2, 20, 75, 76, 131, 154, 165, 232]


@pytest.mark.slow
def test_the_arm_is_judged_by_rk4_as_in_fine_steps_and_by_implicitfast_more_kindly() -> None:
    """Steps a tenth as long; but for margins that are smaller than RK4's own error."""

    def margins(specification: Specification) -> tuple[Any, Any]:
        declared = Campaign.of(specification)
        rows = evaluate(declared, "grosmc", declared.values(range(256))[NEAR_A_LIMIT])
        names = [name for name in rows.columns if name.startswith("margin ")]
        return np.array([rows[name] >= 0 for name in names]).T, rows["margin deviation_below"]

    arm = specification_of("arm", runs=256, seed=7, controllers=("grosmc",))
    fine = replace(arm, text=arm.text.replace("[run]\n", '[run]\ntimestep = "0.1 ms"\n'))
    assert fine.file.run.timestep == 1e-4
    (expected, exact), (kept, own) = margins(fine), margins(arm)
    kinder, fast = margins(replace(arm, integrator="implicitfast"))
    assert np.abs(own - exact).max() < 0.5e-3
    assert (kept != expected).sum() <= 1
    assert np.all(fast - exact > np.abs(own - exact))
    assert np.all(kinder >= kept)
    assert (kinder != kept).sum(axis=1).tolist() == [1, 1, 1, 1, 1, 2, 1, 1]
