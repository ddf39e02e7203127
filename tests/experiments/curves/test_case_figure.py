"""The figure of a case file and its document: panels, units, marks, curves near the run."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from cases import case
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from grosmc_mj.experiments.answer.curves import (
    curves_document,
    experiment_chart,
    levels_of,
    panel_of,
    panels_of,
    write_curves,
)
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.requirements.magnitudes import StaysWithin
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.output.charts.envelope import envelope
from grosmc_mj.output.charts.figure import drawn
from grosmc_mj.output.palette import FAILED
from grosmc_mj.simulation.trajectory import Status

PHYSICS = {"compare": ["physics"]}


def cart(deviation: str, **further: Any) -> list[RunResult]:
    """Runs of a cart under two laws, whose deviation and position have limits."""
    experiment = case(
        "cart_pendulum",
        plant=PHYSICS,
        run={"start": {"pole angle": "-10 deg"}, "duration": "1 s"},
        controller=[{"law": "lqr"}, {"law": "grosmc"}],
        requirement=[
            {"deviation_below": deviation} | further,
            {"state": "cart position", "stays_within": "40 cm"},
            # An output has its panel already.
            {"state": "pole angle", "stays_within": "9 rad"},
        ],
    )
    return list(experiment.runs())


def figure_of(runs: list[RunResult]) -> Figure:
    return drawn(experiment_chart(runs))


def labels(figure: Figure) -> list[str]:
    return [axes.get_ylabel() for axes in figure.axes if axes.get_visible()]


def axes_of(figure: Figure, label: str) -> Axes:
    """The panel whose quantity begins with these words."""
    (axes,) = [one for one in figure.axes if one.get_ylabel().startswith(label)]
    return axes


# A cart, its limits


@pytest.fixture(scope="module")
def kept() -> Figure:
    """Runs of a cart that deviate by less than their limit."""
    return figure_of(cart("1 rad"))


@pytest.fixture(scope="module")
def broken() -> Figure:
    """Runs of a cart that deviate and travel further than their limits."""
    return figure_of(cart("1e-9 rad"))


def test_panels_have_their_own_units(kept: Figure) -> None:
    """The output's unit is not that of s."""
    assert labels(kept) == [
        "cart position [m]",
        "pole angle [rad]",
        "deviation y − y* [rad]",
        "s [rad/s]",
        "force [N]",
    ]


def test_a_limit_of_a_signed_quantity_is_one_to_both_sides(kept: Figure) -> None:
    lines = [line for line in axes_of(kept, "deviation").lines if line.get_label() == "limit"]
    levels = [float(np.ravel(line.get_ydata())[0]) for line in lines]
    assert sorted(levels) == [-1.0, 1.0]


def test_a_limit_that_is_kept_has_no_words(kept: Figure) -> None:
    assert not axes_of(kept, "deviation").get_title(loc="right")


def test_an_input_that_jumps_is_drawn_as_its_range(kept: Figure) -> None:
    """Only the force of GROSMC jumps."""
    assert len(axes_of(kept, "force").collections) == 1


def test_panels_with_broken_limits_are_framed(broken: Figure) -> None:
    edges = [axes.spines["top"].get_edgecolor() for axes in broken.axes[:5]]
    framed = [to_hex(edge) == FAILED.lower() for edge in edges]
    assert labels(broken)[:2] == ["deviation y − y* [rad]", "pole angle [rad]"]
    assert framed == [True, False, True, False, False]


def test_a_broken_limit_is_named_with_its_laws(broken: Figure) -> None:
    assert axes_of(broken, "deviation").get_title(loc="right").splitlines() == [
        "not kept by lqr: deviation below 1e-9 rad",
        "not kept by grosmc: deviation below 1e-9 rad",
    ]


# Several outputs


@pytest.fixture(scope="module")
def circle_runs() -> list[RunResult]:
    return list(Experiment.load("two_link_arm/case1").changed(duration=0.2).runs())


def test_each_output_has_a_panel(circle_runs: list[RunResult]) -> None:
    panels = labels(figure_of(circle_runs))
    assert {"output y1 [m]", "output y2 [m]", "deviation |y − y*| [m]"} <= set(panels)


def test_an_output_is_drawn_with_its_reference(circle_runs: list[RunResult]) -> None:
    figure = figure_of(circle_runs)
    (line,) = [
        line for line in axes_of(figure, "output y2").lines if line.get_label() == "reference"
    ]
    np.testing.assert_array_equal(line.get_ydata(), circle_runs[-1].comparison.reference[:, 1])


def test_a_limit_about_a_reference_begins_where_it_holds(circle_runs: list[RunResult]) -> None:
    run = circle_runs[-1]
    limit = StaysWithin(number=0.003, unit="m", after=0.1)
    panel = panels_of(circle_runs)[1]
    above, below = levels_of(limit, panel)
    assert panel.reference is not None
    since = run.comparison.time >= 0.1
    for (time, line), side in ((above, 1), (below, -1)):
        assert time[0] == pytest.approx(0.1)
        np.testing.assert_allclose(line, panel.reference[since] + side * 0.003)


def test_a_limit_of_a_distance_is_one_to_one_side(circle_runs: list[RunResult]) -> None:
    panel = panel_of(circle_runs, "deviation")
    ((_, line),) = levels_of(StaysWithin(number=0.003, unit="m"), panel)
    assert set(np.ravel(line)) == {0.003}


# States as a law sees them


ESTIMATED = {"estimator": {"of": "rotor speed"}}
NOISY_ANGLE = {"of": "rotor angle", "noise": "1 mrad"}
EXACT_SPEED = {"of": "rotor speed", "exact": True}
NOISY_RATES = {
    "sensor": [
        {"of": "shoulder rate", "noise": "0.1 rad/s"},
        {"of": "elbow rate", "noise": "1 rad/s"},
    ]
}


def late(system: str, start: str, **loop: Any) -> list[RunResult]:
    """Runs of a law that sees its states a millisecond late."""
    run = {"start": {start: "1 rad"}}
    return list(case(system, plant=PHYSICS, run=run, computing={"delay": "1 ms"}, **loop).runs())


def rates(figure: Figure) -> dict[str, Axes]:
    """Panels of rates, by the name of the state."""
    panels = {axes.get_ylabel(): axes for axes in figure.axes}
    return {
        label.removesuffix(" [rad/s]"): axes
        for label, axes in panels.items()
        if label.endswith(" [rad/s]")
    }


@pytest.mark.parametrize(
    ("system", "start", "loop", "names"),
    [
        ("servo", "rotor angle", {"sensor": NOISY_ANGLE}, ["rotor speed"]),
        ("servo", "rotor angle", {"sensor": [NOISY_ANGLE, EXACT_SPEED]}, []),
        ("two_link_arm", "elbow angle", NOISY_RATES, ["elbow rate"]),
        # The law is not defined there: the run ends at once.
        (
            "two_link_arm",
            "shoulder angle",
            {"estimator": {"of": "shoulder rate"}},
            ["shoulder rate"],
        ),
    ],
)
def test_the_rate_that_is_seen_worst_has_a_panel(system, start, loop, names) -> None:
    assert list(rates(figure_of(late(system, start, **loop)))) == names


def test_curves_of_a_rate_that_does_not_jump_are_its_values() -> None:
    """The seen rate is distinct from the true one."""
    runs = late("servo", "rotor angle", **ESTIMATED)
    axes = rates(figure_of(runs))["rotor speed"]
    assert not axes.collections
    true, seen = axes.lines
    assert [line.get_label() for line in (true, seen)] == ["true", "seen by lqr"]
    assert to_hex(true.get_color()) != to_hex(seen.get_color())
    trajectory = runs[0].trajectory
    assert trajectory.seen is not None
    np.testing.assert_array_equal(true.get_ydata(), trajectory.state[:-1, 1])
    np.testing.assert_array_equal(seen.get_ydata(), trajectory.seen[:, 1])


# Hidden states of a machine


@pytest.fixture(scope="module")
def machine() -> Figure:
    runs = list(Experiment.load("cart_pendulum/machine").changed(duration=0.2).runs())
    return figure_of(runs)


def test_states_of_a_machine_that_no_law_sees_have_panels(machine: Figure) -> None:
    """The twist first, then the current; each in a unit that reads well."""
    hidden = [label for label in labels(machine) if "not seen" in label]
    assert hidden == [
        "slider twist,\nnot seen [mm]",
        "force winding,\nnot seen [A]",
        "slider friction bristle,\nnot seen [µm]",
    ]


def test_a_twist_is_drawn_with_its_backlash(machine: Figure) -> None:
    twist, winding, _ = [axes for axes in machine.axes if "not seen" in axes.get_ylabel()]
    (play,) = twist.patches
    assert play.get_label() == "backlash"
    (_, low), (_, high) = twist.transData.transform([(0, 0), (0, 0.1)])
    np.testing.assert_allclose(play.get_window_extent().height, high - low, rtol=1e-6)
    assert not winding.patches


# Signals that jump, runs that end


def test_a_signal_that_jumps_is_its_range_with_its_mean() -> None:
    time = np.linspace(0.0, 1.0, 1001)
    jumps = envelope(time, np.where(np.arange(1001) % 2, 3.0, -1.0), 100)
    assert len(jumps.time) == 100
    assert set(jumps.least) == {-1.0}
    assert set(jumps.largest) == {3.0}
    np.testing.assert_allclose(jumps.mean[2:-2], 1.0, atol=1e-6)


def test_an_envelope_of_one_value_is_the_value() -> None:
    short = envelope(np.zeros(1), np.ones(1))
    assert short.least.tolist() == [1.0]
    assert short.mean.tolist() == [1.0]


def test_a_run_that_ended_early_is_marked() -> None:
    """The link is pushed through the angle at which its cable has no length."""
    push = {"body": "link", "torque": ["0 N m", "50 N m", "0 N m"]}
    duration = {"duration": "1 s"}
    runs = list(case("arm", plant=PHYSICS, run=duration, disturbance=push).runs())
    ended = [run for run in runs if run.status is not Status.COMPLETED]
    assert ended
    figure = figure_of(runs)
    assert [text.get_text() for text in figure.axes[0].texts] == ["ended"] * len(ended)


# The document


@pytest.fixture(scope="module")
def servo_runs() -> list[RunResult]:
    experiment = Experiment.load("servo/case1").changed(duration=11.0)
    return [experiment.run("physics", law) for law in ("lqr", "grosmc")]


@pytest.fixture(scope="module")
def document(servo_runs: list[RunResult]) -> dict[str, Any]:
    return curves_document(servo_runs)


def test_curves_are_written_beside_the_results(servo_runs, tmp_path) -> None:
    path = write_curves(servo_runs, "servo_case1", tmp_path)
    assert path == tmp_path / "curves" / "servo_case1.json"
    assert json.loads(path.read_text(encoding="utf-8"))["system"] == "servo"


@pytest.mark.parametrize("index", [0, 1])
def test_a_curve_has_few_points_of_its_run_and_is_near_it(servo_runs, document, index) -> None:
    trajectory = servo_runs[index].trajectory
    curve = document["panels"][0]["curves"][index]
    true = trajectory.state[:, 0]
    drawn = np.interp(trajectory.time, curve["t"], curve["y"])
    # A line between points that are rounded to seven digits.
    assert np.abs(drawn - true).max() <= 5e-4 * np.ptp(true) + 1e-6
    assert len(curve["t"]) < len(trajectory.time) / 20
    assert set(curve["t"]) <= {float(f"{t:.7g}") for t in trajectory.time.tolist()}


def test_a_curve_that_jumps_has_its_range(servo_runs, document) -> None:
    """It is drawn first, below the smooth one."""
    (current,) = [panel for panel in document["panels"] if panel["label"] == "current [A]"]
    rough, smooth = current["curves"]
    assert rough["law"] == "grosmc"
    assert smooth["law"] == "lqr"
    least, largest = rough["range"]
    true = servo_runs[1].trajectory.input
    assert min(least) == pytest.approx(true.min(), rel=1e-6)
    assert max(largest) == pytest.approx(true.max(), rel=1e-6)


def test_a_document_has_the_disturbances_within_the_run_and_levels_of_limits(document) -> None:
    (disturbance,) = document["disturbances"]
    assert (disturbance["start"], disturbance["stop"]) == (10.0, 11.0)
    deviation = document["panels"][1]
    levels = {level for limit in deviation["limits"] for level in limit["y"]}
    assert levels == {0.002, -0.002}


def test_every_requirement_that_is_not_kept_is_named() -> None:
    """A mean square and a cost have no panel."""
    limits = {
        "settles_within": "0.05 s",
        "cost_ratio_below": 0.01,
        "stays_within": "1 urad",
        "rms_below": "1 urad",
        "after": "0.05 s",
        "deviation_below": "1 nrad",
        "input_below": "1 uA",
    }
    run = {"duration": "0.1 s"}
    results = list(case("servo", plant=PHYSICS, run=run, requirement=limits).runs())
    failed = {
        item.requirement.words for run in results for item in run.requirements if not item.kept
    }
    titles = "\n".join(axes.get_title(loc="right") for axes in figure_of(results).axes)
    assert {words for words in failed if words in titles} == failed
    assert len(failed) >= 5


# A panel by its quantity


@pytest.fixture(scope="module")
def arm_runs() -> list[RunResult]:
    experiment = Experiment.load("arm/nominal").changed({"run.duration": 0.2})
    return [experiment.run(plant="corrected", law=law) for law in ("lqr", "grosmc")]


def test_the_reference_of_a_joint_s_rate_is_the_reference_s_derivative(
    arm_runs: list[RunResult],
) -> None:
    """y_r = sin(pi t)."""
    panel = panel_of(arm_runs, "joint rate")
    expected = np.pi * np.cos(np.pi * arm_runs[0].comparison.time)
    assert panel.reference == pytest.approx(expected, abs=1e-9)


def test_s_is_drawn_of_laws_with_a_surface_only(arm_runs: list[RunResult]) -> None:
    panel = panel_of(arm_runs, "sliding")
    assert [curve.run.controller.name for curve in panel.curves] == ["grosmc"]


def test_a_quantity_that_no_run_has_is_refused_with_those_that_there_are(
    arm_runs: list[RunResult],
) -> None:
    with pytest.raises(ArgumentError, match=r"'cart position'.*output.*deviation.*joint rate"):
        panel_of(arm_runs, "cart position")


@pytest.mark.parametrize(("limit", "first"), [("1e3 N", "deviation"), ("1 mN", "force")])
def test_a_figure_opens_with_the_requirement_that_binds(limit: str, first: str) -> None:
    runs = cart("1e-4 rad", input_below=limit)
    chart = experiment_chart(runs)
    assert chart.rows[0][0].y.title.startswith(first)
    # None is lost, and none is drawn twice.
    titles = sorted(panel.label for panel in panels_of(runs))
    assert sorted(row[0].y.title for row in chart.rows) == titles
