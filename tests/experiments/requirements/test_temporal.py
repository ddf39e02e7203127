"""Temporal formulas: margins equal rtamt's at every instant, and those of the other kinds."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest
from cases import case
from steps import step

from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.requirements.always import Always
from grosmc_mj.experiments.requirements.judging import judge_run
from grosmc_mj.experiments.requirements.temporal_text import read_formula
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.studies.sweep.runs import Row, run_rows

UNITS = {"t": "s", "x": "1", "y": "1"}
# A formula here, and in rtamt's words with samples of 1 s.
FORMULAS = [
    ("always (x < 1)", "always(x < 1)"),
    ("eventually (y > 0.5)", "eventually(y > 0.5)"),
    ("always[0 s, 5 s] (abs(x) < 1.2)", "always[0,5](abs(x) < 1.2)"),
    ("always[2 s, 7 s] x - y < 2", "always[2,7](x - y < 2)"),
    ("eventually[3 s, 9 s] (y >= x)", "eventually[3,9](y >= x)"),
    ("eventually[0 s, 5 s] always abs(x) < 2", "eventually[0,5](always(abs(x) < 2))"),
    (
        "eventually[0 s, 5 s] always[0 s, 10 s] (abs(x) < 1)",
        "eventually[0,5](always[0,10](abs(x) < 1))",
    ),
    (
        "always (x > 1 implies eventually[0 s, 4 s] x < 0)",
        "always((x > 1) -> (eventually[0,4](x < 0)))",
    ),
    ("always (not (x > 2 and y > 2))", "always(not((x > 2) and (y > 2)))"),
    ("(x < 1) until (y > 1)", "(x < 1) until (y > 1)"),
    ("x < 1 until[2 s, 6 s] y > 1", "(x < 1) until[2,6] (y > 1)"),
    ("(x < 1) until[0 s, 12 s] (y > 1)", "(x < 1) until[0,12] (y > 1)"),
    (
        "always[0 s, 10 s] ((abs(x) < 2) until[1 s, 3 s] (y < 0))",
        "always[0,10]((abs(x) < 2) until[1,3] (y < 0))",
    ),
    (
        "eventually[1 s, 1 s] (x < 0) or always[4 s, 4 s] (y > 0)",
        "(eventually[1,1](x < 0)) or (always[4,4](y > 0))",
    ),
    (
        "always[5 s, 9 s] (2*x + 0.5*y < 3) and eventually[0 s, 3 s] (y < -0.2)",
        "(always[5,9](2*x + 0.5*y < 3)) and (eventually[0,3](y < -0.2))",
    ),
    ("not eventually[2 s, 8 s] (x > 1.5)", "not(eventually[2,8](x > 1.5))"),
    (
        "always[0 s, 3 s] eventually[0 s, 3 s] always[0 s, 3 s] (x < y)",
        "always[0,3](eventually[0,3](always[0,3](x < y)))",
    ),
    ("x > 0 implies (y > 0 implies x > y)", "(x > 0) -> ((y > 0) -> (x > y))"),
    ("x > 0 implies y > 0 implies x > y", "(x > 0) -> ((y > 0) -> (x > y))"),
    ("always[40 s, 60 s] (x < 1)", "always[40,60](x < 1)"),
    (
        "eventually[0 s, 30 s] ((x < 0.5) until[0 s, 5 s] (y > 1.5 or x < -1))",
        "eventually[0,30]((x < 0.5) until[0,5] ((y > 1.5) or (x < -1)))",
    ),
]
# Random walks of 50 and of 7 samples: formulas reach beyond the end of the short ones.
LENGTHS = (50, 50, 7)


def of_rtamt(text: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Margins by rtamt at each sample."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import rtamt

        specification = rtamt.StlDiscreteTimeSpecification()
        for name in ("x", "y", "out"):
            specification.declare_var(name, "float")
        specification.spec = f"out = {text}"
        specification.parse()
        data = {"time": list(range(len(x))), "x": x.tolist(), "y": y.tolist()}
        return np.array([value for _, value in specification.evaluate(data)], float)


@pytest.mark.parametrize("trace", range(len(LENGTHS)))
@pytest.mark.parametrize(("text", "theirs"), FORMULAS)
def test_margins_equal_those_of_rtamt_at_every_instant(text, theirs, trace) -> None:
    steps = np.random.default_rng(trace).normal(size=(2, LENGTHS[trace]))
    x, y = np.cumsum(steps, axis=1) * 0.5
    signals = {"t": np.arange(float(len(x))), "x": x, "y": y}
    margins = read_formula(text, UNITS).formula.margins(signals, 1.0)
    np.testing.assert_allclose(margins, of_rtamt(theirs, x, y), rtol=0, atol=1e-12)


# Intervals in intervals, and the time after an instant that they need [s].
HORIZONS = {
    "eventually[2 s, 3 s] always[1 s, 5 s] x < 1": 8.0,
    "always[0 s, 1 s] (always[2 s, 3 s] x < 1 and always[0 s, 7 s] always[1 s, 2 s] y < 1)": 10.0,
    "not always[0 s, 2 s] (x < 1 until[1 s, 4 s] y < 1)": 6.0,
    "always eventually[0 s, 3 s] x < 1": 3.0,
}


@pytest.mark.parametrize("text", HORIZONS)
def test_a_formula_needs_the_sum_of_its_nested_intervals(text) -> None:
    assert read_formula(text, UNITS).formula.horizon == HORIZONS[text]


def test_margins_of_different_units_are_parts_of_the_constants_that_they_are_compared_with() -> (
    None
):
    """1 - 1.5/2 = 0.25 of the angle, 1 - 300/500 = 0.4 of the current."""
    units = {"t": "s", "angle": "rad", "current": "mA"}
    text = "abs(angle) < 2 rad and abs(current) < 0.5 A"
    signals = {"t": np.zeros(2), "angle": np.array([-1.5, 0]), "current": np.array([0, 300.0])}
    specification = read_formula(text, units)
    assert specification.formula.margins(signals, 1.0) == pytest.approx([0.25, 0.4])
    assert (specification.unit, specification.number) == ("1", 1.0)


def test_the_number_of_a_formula_is_the_smallest_constant_in_it() -> None:
    specification = read_formula("x < 30 and (y > -0.5 or x > 7)", UNITS)
    assert specification.number == 0.5


# -- beside the other kinds ------------------------------------------------------------------------

# A requirement of servo/case1, and the same one as a text.
SAME = [
    (
        {"stays_within": "20 mrad", "after": "5 s"},
        {"always": "abs(error) < 20 mrad", "after": "5 s"},
    ),
    (
        {"stays_within": "9 mrad", "after": "5 s"},
        {"always": "abs(rotor angle - 1 rad) < 9 mrad", "after": "5 s"},
    ),
    (
        {"state": "rotor speed", "stays_within": "3 rad/s"},
        {"always": "-3 rad/s < rotor speed < 3 rad/s"},
    ),
    (
        {"final_error_below": "1 mrad"},
        {"always": "abs(rotor angle error) < 1 mrad", "after": "16.2 s"},
    ),
    ({"deviation_below": "2 mrad"}, {"always": "abs(deviation) < 2 mrad"}),
    ({"input_below": "15 A"}, {"always": "abs(current) < 15 A"}),
    ({"sliding_below": "0.1 A s"}, {"always": "abs(s) < 100 mA s"}),
]
TORQUE = {
    "body": "rotor",
    "torque": ["0 N m", "1 N m", "0 N m"],
    "profile": "pulse",
    "start": "10 s",
    "stop": "13 s",
}


def servo(*requirements: dict[str, Any]) -> Experiment:
    """servo/case1 without MuJoCo, with these requirements."""
    return case(
        "servo",
        plant={"compare": ["corrected"]},
        run={"duration": "18 s"},
        disturbance=TORQUE,
        controller=[{"law": "lqr"}, {"law": "grosmc"}],
        requirement=list(requirements),
    )


def always(text: str) -> Experiment:
    return servo({"always": text})


@pytest.fixture(scope="module")
def loaded() -> RunResult:
    """A run of GROSMC, which a load pushes."""
    return servo().run("corrected", "grosmc")


@pytest.mark.parametrize(("requirement", "same"), SAME)
def test_a_text_has_the_margin_of_the_kind_that_says_the_same(loaded, requirement, same) -> None:
    kind, text = servo(requirement, same).limits
    expected = judge_run(kind, loaded)
    judgement = judge_run(text, loaded)
    assert judgement.margin == pytest.approx(expected.margin, rel=1e-9, abs=1e-12)
    assert judgement.measured == pytest.approx(expected.measured, rel=1e-9, abs=1e-12)
    assert judgement.share == pytest.approx(expected.share, rel=1e-9, abs=1e-12)
    assert text.unit == kind.unit


def test_a_text_has_the_overshoot_of_a_step() -> None:
    experiment = step({"overshoot_below": 0.5}, {"always": "-error / start(error) < 0.5"})
    run = experiment.run("corrected", "pd")
    overshoot, text = (judge_run(limit, run) for limit in experiment.limits)
    assert text.margin == pytest.approx(overshoot.margin, rel=1e-9)


@pytest.mark.parametrize(("seconds", "kept"), [(4.3, True), (2.5, False)])
def test_a_text_settles_as_settles_within_says(seconds, kept) -> None:
    text = f"eventually[0 s, {seconds} s] always[0 s, 4 s] abs(error) < 20 mrad"
    experiment = servo({"settles_within": f"{seconds} s"}, {"always": text})
    # Evaluated at the start alone: the load comes later.
    run = experiment.changed(duration=8.5).run("corrected", "grosmc")
    assert [judge_run(limit, run).kept for limit in experiment.limits] == [kept, kept]


def test_batches_have_the_margins_of_recorded_runs() -> None:
    """More runs than are recorded at once, of two laws, one of which has no surface."""
    experiment = servo(
        {"always": "abs(s) < 0.1 A s"},
        {"always": "abs(error) < 0.5 rad or abs(current) < 4 A"},
        {"deviation_below": "1 rad"},
    ).changed(duration=0.3)
    starts = [experiment.changed(x0=(0.01 * i, 0.0)) for i in range(70)]
    rows = [Row(law, case=start) for law in ("lqr", "grosmc") for start in starts]
    outcomes = run_rows(experiment, rows, plant="corrected")

    of_surface = outcomes["margin always"]
    assert np.isnan(of_surface[:70]).all()
    assert np.isfinite(of_surface[70:]).all()
    run = starts[69].run("corrected", "grosmc")
    for limit in outcomes.limits:
        assert outcomes[f"margin {limit.name}"][139] == pytest.approx(judge_run(limit, run).margin)


# -- measured values -------------------------------------------------------------------------------

# Plain numbers: of a text, the value of the angle y of a run that is nearest to its bound.
PLAIN = {
    "rotor angle > -0.5 rad": np.min,
    "rotor angle < 2 rad": np.max,
    "rotor angle < 0.5 rad": np.max,
    "0 < rotor angle": np.min,
    "-10 rad < rotor angle < 1.5 rad": np.max,
    "rotor angle > -0.1 rad and rotor angle < 20 rad": np.min,
    "abs(rotor angle) > 1 mrad": lambda y: np.abs(y).min(),
    "2 * abs(rotor angle) < 20 mrad": lambda y: 2 * np.abs(y).max(),
}


@pytest.mark.parametrize("text", PLAIN)
def test_a_bound_measures_the_extreme_itself(text) -> None:
    experiment = always(text).changed(duration=3.0)
    run = experiment.run("corrected", "lqr")
    (limit,) = experiment.limits
    judgement = judge_run(limit, run)
    measured = judgement.measured
    assert measured == pytest.approx(PLAIN[text](run.trajectory.state[:, 0]), rel=1e-12)
    signals = {"t": run.trajectory.time, "rotor angle": run.trajectory.state[:, 0]}
    assert isinstance(limit, Always)
    least = limit.specification.formula.margins(signals, 1e-3).min()
    assert judgement.margin == pytest.approx(least, rel=1e-12, abs=1e-15)


MARGIN_ALONE = [
    "abs(rotor angle) < 2 * abs(start(error))",
    "rotor angle > 0.5 rad or t > 0.1 s",
    "abs(current) > 2 A implies eventually[0 s, 200 ms] abs(current) < 2 A",
    "not rotor angle > 3 rad",
    "abs(rotor angle) < 2 rad and abs(error) < 2 rad",
    "rotor angle < current * 1 rad / 1 A + 5 rad",
]


@pytest.mark.parametrize("text", MARGIN_ALONE)
def test_a_formula_that_bounds_no_one_quantity_has_a_margin_alone(text) -> None:
    experiment = always(text).changed(duration=1.0)
    (limit,) = experiment.limits
    judgement = judge_run(limit, experiment.run("corrected", "lqr"))
    assert judgement.measured is None
    assert judgement.margin is not None
    assert judgement.kept == (judgement.margin >= 0)


OFF_THE_GRID = [
    {"signal": "rotor angle", "above": "-1 rad", "from": "0.1002 s", "to": "0.1004 s"},
    {"always": "eventually[0.2 ms, 0.4 ms] error < 1 rad"},
    {"always": "always[100.1 ms, 100.9 ms] error < 1 rad"},
    {"always": "error < 1 rad until[5.3 ms, 5.4 ms] error < 1 rad"},
]


@pytest.mark.parametrize("table", OFF_THE_GRID)
def test_a_window_between_two_samples_is_refused(table) -> None:
    with pytest.raises(ArgumentError, match=r"no sample is between .*: one comes each 0\.001 s"):
        servo(table)


@pytest.mark.parametrize(("begin", "end"), [(0.0002, 0.0034), (0.001, 0.003), (0.0006, 0.0039)])
def test_an_interval_has_the_samples_in_it(begin, end) -> None:
    """1, 2 and 3 ms, whatever stands between two samples."""
    x = np.array([9.0, 1.0, 2.0, 3.0, -9.0, 9.0])
    signals = {"t": 1e-3 * np.arange(6.0), "x": x, "y": x}
    formula = read_formula(f"always[{begin!r} s, {end!r} s] x > 0", UNITS).formula
    assert formula.margins(signals, 1e-3)[0] == 1.0


def test_an_instant_between_two_samples_by_rounding_alone_is_a_sample() -> None:
    """0.07/0.01 is 7.000000000000001 and 0.57/0.01 is 56.99999999999999."""
    assert (0.07 / 0.01, 0.57 / 0.01) != (7.0, 57.0)
    x = np.ones(100)
    x[[7, 57]] = 0.25, 0.125
    x[[6, 58]] = -1.0
    signals = {"t": 0.01 * np.arange(100), "x": x, "y": x}
    least = [
        read_formula(f"always[{interval}] x > 0", UNITS).formula.margins(signals, 0.01)[0]
        for interval in ("0.07 s, 0.5 s", "0.1 s, 0.57 s", "0.57 s, 0.57 s")
    ]
    assert least == [0.25, 0.125, 0.125]


# -- refusals --------------------------------------------------------------------------------------

WRONG = {
    "abs(angle) < 1 rad": "has 'angle' at character 5, may have t, rotor angle",
    "abs(rotor angle) < 1 mm": "compares rad and m",
    "abs(rotor angle) < 1": "compares rad and a number without a unit",
    "rotor angle + current < 1 rad": "adds rad and A",
    "sin(current) < 1": "gives sin a number in A, not in rad",
    "min(error) < 1 rad": "gives min 1 arguments in place of 2",
    "error == 1 rad": "has '==' at character 7, may have",
    "error ** 2 < 1 rad": "has '*' at character 8 where a quantity must be",
    "error": "has no comparison",
    "1 < 2": "has no signal in it",
    "always[3 s, 1 s] error < 1 rad": "has an interval from 3 s to 1 s",
    "always[0, 1 m] error < 1 rad": "has an interval that is none of times",
    "eventually[0 s, 5 s always error < 1 rad": "has no ']'",
    "error < 1 rad until": "has nothing where a quantity must be",
    "error < 1 rad) and": "has ')' at character 14 after a whole formula",
    "error < 1 rad and abs(current) < 0 A": "compares quantities of different units",
    "__import__('os').system('true') < 1": "has '__import__' at character 1, may have",
    "not " * 50 + "error < 1 rad": "nested more than 40 deep",
    "error < 1 rad" + " " * 1000: "has 1013 characters",
    "eventually[0 s, 20 s] error < 1 rad": "it asks for 20 s after an instant; the run has 18 s",
    "(error < 1 rad) < 2 rad": "has a formula where a quantity must be",
    "error < 1e999 rad": "has a number that is not finite",
    "(" * 300 + "error < 1 rad" + ")" * 300: "nested more than 40 deep",
}


@pytest.mark.parametrize("text", WRONG)
def test_a_wrong_text_is_refused_in_one_line(text) -> None:
    with pytest.raises(ArgumentError) as refusal:
        always(text)
    assert WRONG[text] in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_s_is_asked_of_laws_with_a_surface_only() -> None:
    with pytest.raises(ArgumentError, match="no law that it is asked of has a surface"):
        servo({"of": ["lqr"], "always": "abs(s) < 1 A s"})
    (limit,) = always("abs(s) < 1 A s").limits
    assert limit.laws == ("grosmc",)


def test_a_run_in_which_a_quotient_is_undefined_does_not_keep_it() -> None:
    experiment = always("error / (error - error) < 1").changed(duration=0.1)
    (limit,) = experiment.limits
    judgement = judge_run(limit, experiment.run("corrected", "lqr"))
    assert (judgement.measured, judgement.kept) == (math.inf, False)
