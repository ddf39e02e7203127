"""The figure of a case file and its document: panels, units, marks, curves near the run."""

from __future__ import annotations

import json

import numpy as np
import pytest
from case_texts import load
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from grosmc_mj.experiments.curves import draw_experiment, figure_size, write_curves
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.results.envelope import envelope
from grosmc_mj.results.palette import FAILED
from grosmc_mj.simulation.trajectory import Status

CASE = """
[plant]
system = "{}"
compare = ["physics"]
[run]
start = {{ "{}" = "{}" }}
duration = "{}"
[[controller]]
law = "lqr"
"""
JUDGED = """
[[controller]]
law = "grosmc"
[[requirement]]
deviation_below = "{}"
cart_travel_below = "40 cm"
"""
# The link is pushed through the angle at which its cable has no length.
PUSH = """
[[disturbance]]
body = "link"
torque = ["0 N m", "50 N m", "0 N m"]
profile = "constant"
"""
NOISY = '[[sensor]]\nof = "{}"\nnoise = "{}"\n'
ESTIMATED = '[[estimator]]\nof = "{}"\n'


def figure_of(experiment: Experiment) -> Figure:
    results = list(experiment.runs())
    figure = Figure(figsize=figure_size(results))
    draw_experiment(figure, results)
    return figure


def labels(figure: Figure) -> list[str]:
    return [axes.get_ylabel() for axes in figure.axes if axes.get_visible()]


def test_panels_have_their_own_units_and_limits_that_are_not_kept_are_framed(tmp_path) -> None:
    """The output's unit is not that of s."""
    case = CASE.format("cart_pendulum", "pole angle", "-10 deg", "1 s")
    kept = figure_of(load(tmp_path, case + JUDGED.format("1 rad")))
    assert labels(kept) == [
        "pole angle [rad]", "distance from y* [rad]", "travel of the cart [m]", "s [rad/s]",
        "force [N]",
    ]  # fmt: skip
    assert not kept.axes[1].get_title(loc="right")
    levels = [line for line in kept.axes[1].lines if line.get_label() == "limit"]
    assert sorted(float(np.ravel(line.get_ydata())[0]) for line in levels) == [-1.0, 1.0]
    assert len(kept.axes[4].collections) == 1  # the range of a force that jumps: of GROSMC alone
    figure = figure_of(load(tmp_path, case + JUDGED.format("1e-9 rad")))
    framed = [to_hex(axes.spines["top"].get_edgecolor()) == FAILED.lower() for axes in figure.axes]
    assert framed[:5] == [False, True, True, False, False]
    words = figure.axes[1].get_title(loc="right").splitlines()
    assert words == [f"not kept by {law}: deviation below 1e-9 rad" for law in ("lqr", "grosmc")]


def test_each_output_has_a_panel_and_its_reference() -> None:
    experiment = Experiment.load("two_link_arm/case1").varied(duration=0.2)
    figure = figure_of(experiment)
    assert labels(figure)[:3] == ["output y1 [m]", "output y2 [m]", "|y − y*| [m]"]
    reference = [line for line in figure.axes[1].lines if line.get_label() == "reference"]
    run = experiment.run(law="grosmc")
    np.testing.assert_array_equal(reference[0].get_ydata(), run.comparison.reference[:, 1])


@pytest.mark.parametrize(
    ("system", "bent", "parts", "rates"),
    [
        ("servo", "rotor angle", ESTIMATED.format("rotor speed"), ["rotor speed [rad/s]"]),
        ("servo", "rotor angle", NOISY.format("rotor angle", "1 mrad"), []),
        ("two_link_arm", "elbow angle",
         NOISY.format("shoulder rate", "0.1 rad/s") + NOISY.format("elbow rate", "1 rad/s"),
         ["elbow rate [rad/s]"]),
        # A run that ends at once, of the straight arm, where the law is not defined.
        ("two_link_arm", "shoulder angle", ESTIMATED.format("shoulder rate"),
         ["shoulder rate [rad/s]"]),
    ],
)  # fmt: skip
def test_a_rate_that_is_not_known_exactly_is_drawn_as_it_is_and_as_it_is_seen(
    system, bent, parts, rates, tmp_path
) -> None:
    delay = '[computing]\ndelay = "1 ms"\n'
    case = CASE.format(system, bent, "1 rad", "0.1 s") + delay + parts
    experiment = load(tmp_path, case)
    figure, (run,) = figure_of(experiment), experiment.runs()
    shown = [axes for axes in figure.axes if axes.get_ylabel().endswith(" [rad/s]")]
    assert [axes.get_ylabel() for axes in shown] == rates
    names = [state.name for state in run.trajectory.system.states]
    assert run.trajectory.seen is not None
    for axes in shown if bent != "shoulder angle" else ():
        i = names.index(axes.get_ylabel().partition(" [")[0])
        true, seen = axes.lines
        assert (true.get_label(), seen.get_label()) == ("true", "seen by LQR")
        assert to_hex(true.get_color()) != to_hex(seen.get_color())
        # A signal that jumps at every sample is its range and its mean.
        if not axes.collections:
            np.testing.assert_array_equal(true.get_ydata(), run.trajectory.state[:-1, i])
            np.testing.assert_array_equal(seen.get_ydata(), run.trajectory.seen[:, i])


def test_states_of_a_machine_that_no_law_sees_have_panels() -> None:
    """The twist first, with its backlash, then the current; each in a unit that reads well."""
    experiment = Experiment.load("cart_pendulum/machine").varied(duration=0.2)
    figure = figure_of(experiment)
    shown = [axes for axes in figure.axes if "not seen" in axes.get_ylabel()]
    assert [axes.get_ylabel() for axes in shown] == [
        "slider twist,\nnot seen [mm]", "force winding,\nnot seen [A]",
        "slider friction bristle,\nnot seen [µm]",
    ]  # fmt: skip
    (play,) = shown[0].patches
    assert (play.get_label(), not shown[1].patches) == ("backlash", True)
    (_, low), (_, high) = shown[0].transData.transform([(0, 0), (0, 0.1)])
    np.testing.assert_allclose(play.get_window_extent().height, high - low, rtol=1e-6)


def test_a_signal_that_jumps_is_its_range_and_its_mean() -> None:
    time = np.linspace(0.0, 1.0, 1001)
    jumps = envelope(time, np.where(np.arange(1001) % 2, 3.0, -1.0), 100)
    assert (len(jumps.time), set(jumps.least), set(jumps.largest)) == (100, {-1.0}, {3.0})
    np.testing.assert_allclose(jumps.mean[2:-2], 1.0, atol=1e-6)
    short = envelope(np.zeros(1), np.ones(1))
    assert (short.least.tolist(), short.mean.tolist()) == ([1.0], [1.0])


def test_a_run_that_ended_early_is_marked(tmp_path) -> None:
    runs = list(load(tmp_path, CASE.format("arm", "joint angle", "0 rad", "1 s") + PUSH).runs())
    ended = [run for run in runs if run.status is not Status.COMPLETED]
    assert ended
    figure = Figure()
    draw_experiment(figure, runs)
    assert [text.get_text() for text in figure.axes[0].texts] == ["ended"] * len(ended)


def test_curves_are_near_the_run_beside_its_requirements_and_disturbances(tmp_path) -> None:
    experiment = Experiment.load("servo/case1").varied(duration=11.0)
    runs = [experiment.run("physics", law) for law in ("lqr", "grosmc")]
    path = write_curves(runs, "servo_case1", tmp_path)
    assert path == tmp_path / "curves" / "servo_case1.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    for run, curve in zip(runs, document["panels"][0]["curves"], strict=True):
        time, true = run.trajectory.time, run.trajectory.state[:, 0]
        drawn = np.interp(time, curve["t"], curve["y"])
        # A line between points that are rounded to seven digits.
        assert np.abs(drawn - true).max() <= 5e-4 * np.ptp(true) + 1e-6
        assert len(curve["t"]) < len(time) / 20
        assert set(curve["t"]) <= {float(f"{t:.7g}") for t in time.tolist()}
    # A curve that switches at every sample has its range, and is drawn below the rest.
    (current,) = (panel for panel in document["panels"] if panel["label"] == "current [A]")
    rough, smooth = current["curves"]
    assert (rough["law"], smooth["law"]) == ("grosmc", "lqr")
    (least, largest), true = rough["range"], runs[1].trajectory.input
    assert (min(least), max(largest)) == pytest.approx((true.min(), true.max()), rel=1e-6)
    assert [(one["start"], one["stop"]) for one in document["disturbances"]] == [(10.0, 11.0)]
    levels = {level for limit in document["panels"][1]["limits"] for level in limit["y"]}
    assert levels == {0.002, -0.002}
