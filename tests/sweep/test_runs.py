"""Batches of runs that are not recorded: their meters, columns and margins are recorded runs'."""

from pathlib import Path

import campaign_cases as small
import mujoco
import numpy as np
import pytest
from campaign_cases import INERTIA, LIMITS, LOAD, LQR, PLANT, campaign, case, servo

from grosmc_mj.errors import UndefinedLawError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.shipped import campaign_files
from grosmc_mj.experiments.metrics import METRICS
from grosmc_mj.experiments.requirements import judge_all
from grosmc_mj.physics.files import load_model
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.sweep.campaign import Campaign, specification_of
from grosmc_mj.sweep.runs import Outcomes, Row, run_rows
from grosmc_mj.sweep.screening import Batch, evaluate

ARM = '{ "shoulder angle" = "0.6 rad", "elbow angle" = "-1.2 rad" }'
RATIO = "[[requirement]]\ncost_ratio_below = 1.5\n"
KINDS = RATIO + """
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
"""  # fmt: skip
LATE = LOAD.replace("0.02 s", "5 s").replace("0.03 s", "5.5 s")
# A loop's actuator gives less than the law's command.
ACTUATOR = '[[requirement]]\ninput_below = "4.5 A"\n[[actuator]]\nof = "current"\nlimit = "4 A"\n'
SETTLES = '[[requirement]]\nsettles_within = "4.1 s"\n'
# In a timestep it travels less than the tolerance, so that the state at the end does not count.
TRAVEL = '[[requirement]]\ncart_travel_below = "0.1 m"\n'
LOWER = INERTIA.replace("rotor", "lower")
BELOW = '[[requirement]]\ninput_below = "9 A"\n'
FOUR = PLANT.format(system="servo", duration=0.2, start='{}\ntimestep = "1 ms"').replace(
    'period = "1 ms"', 'period = "4 ms"'
)
LATER = '[computing]\ndelay = "1 ms"\n'


@pytest.mark.parametrize(
    ("text", "law"),
    [
        (servo(INERTIA, limits=KINDS), "lqr"),
        (servo(INERTIA, limits=KINDS), "grosmc"),
        (
            case("cart_pendulum", INERTIA.replace("rotor", "pole"), laws=LQR, limits=TRAVEL,
                 start='{ "cart speed" = "50 nm/s" }'),
            "lqr",
        ),
        # The servo settles at 4.02 s.
        (case("servo", INERTIA, duration=6, disturbances=LATE, limits=SETTLES, laws=LQR), "lqr"),
        (servo(INERTIA, limits=ACTUATOR, laws=LQR), "lqr"),
        # The optimum moves on by a timestep between two samples of the law.
        (FOUR + small.PAIR + BELOW + INERTIA, "stiff"),
        (FOUR + small.PAIR + BELOW + INERTIA + LATER, "stiff"),
        (case("two_link_arm", LOWER, start=ARM, limits=RATIO), "lqr"),
    ],
)  # fmt: skip
def test_margins_of_a_batch_are_a_recorded_runs(text: str, law: str, tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text(text)
    result = Experiment.load(tmp_path / "case.toml").run("physics", law)
    declared = Campaign.load(str(tmp_path / "case.toml"), runs=2)
    row = evaluate(declared, law, declared.family.nominal[None])
    (tmp_path / "case.toml").write_text(text.replace("[run]", '[run]\nengine = "python"'))
    python = Campaign.load(str(tmp_path / "case.toml"), runs=2)
    other = evaluate(python, law, declared.family.nominal[None])
    for name in row.columns.keys() - {"status", "controller", "judged_by"}:
        assert row[name].tobytes() == other[name].tobytes(), name
    judged = judge_all(declared.requirements, [result])
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
    # A recorded run has the deviation at its end besides.
    deviation = result.comparison.deviation[:-1]
    assert row["deviation"][0] == pytest.approx(np.abs(deviation).max(), rel=1e-9)


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
    assert len({*together["deviation"]}) == 4
    assert np.isnan(together["margin sliding_below"]).all() == (law == "lqr")


def test_runs_that_end_early_fail_with_their_cause() -> None:
    declared = small.falling()
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
    assert np.all(np.diff(rows["ended"][early[np.argsort(rows["order"][early])]]) >= 0)
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


def test_requirements_have_columns_of_their_own_and_a_run_without_cost_fails() -> None:
    rows = evaluated(small.plain())
    assert not any(name.startswith("margin") for name in rows.columns)
    assert rows["relative"].tolist() == [1.0, 1.0]
    more = '[[requirement]]\nof = ["lqr"]\ndeviation_below = "{} mrad"\n'
    rows = evaluated(servo() + more.format(4) + more.format(5))
    first = rows["margin deviation_below"]
    for number, wider in ((2, 1e-3), (3, 2e-3)):
        margins = rows[f"margin deviation_below {number}"]
        np.testing.assert_allclose(margins - first, wider, rtol=1e-12)
    # At its reference the servo has no cost to compare with.
    start = PLANT.format(system="servo", duration=0.05, start='{ "rotor angle" = "1 rad" }')
    rows = evaluated(start + LOAD + INERTIA + LQR + RATIO.replace("1.5", "1e6"))
    assert rows["status"].tolist() == ["completed"] * 2
    assert np.all(np.isneginf(rows["margin cost_ratio_below"]))
    assert np.all(rows["relative"] < 0)


def row_of(table: Outcomes, index: int) -> dict[str, str]:
    return {name: str(values[index]) for name, values in table.columns.items()}


def test_a_row_of_a_design_is_the_row_alone_and_equations_agree_with_physics() -> None:
    experiment = Experiment.load("servo/case1").varied(duration=0.1)
    design = [
        Row(law, {"body.rotor.mass_scale": scale, "start.rotor angle.value": 0.1 * scale})
        for scale in (1.0, 1.5)
        for law in ("lqr", "grosmc")
    ]
    table = run_rows(experiment, design)
    for i in (1, 2):
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


@pytest.mark.parametrize("name", campaign_files())
def test_a_shipped_campaign_steps_as_its_model_says(name: str) -> None:
    file = specification_of(name).file
    assert file.plant.system is not None
    assert load_model(file.plant.system).opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    assert file.run.integrator in (None, "RK4")
