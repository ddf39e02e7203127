"""The figure of a case file: what it draws, in which unit, and what it marks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from grosmc_mj.experiments.curves import draw_experiment, figure_size
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.films import film_of
from grosmc_mj.results.envelope import envelope
from grosmc_mj.results.palette import FAILED, law_styles
from grosmc_mj.simulation.trajectory import Status

CASE = """
[plant]
system = "cart_pendulum"
compare = ["physics"]
[run]
start = {{ "pole angle" = "-10 deg" }}
duration = "1 s"
[[controller]]
law = "lqr"
[[controller]]
law = "grosmc"
[[requirement]]
deviation_below = "{deviation}"
cart_travel_below = "40 cm"
"""


# The link is pushed through the angle at which its cable has no length.
PUSHED_OVER = """
[plant]
system = "arm"
compare = ["physics"]
[run]
duration = "1 s"
[[disturbance]]
body = "link"
torque = ["0 N m", "50 N m", "0 N m"]
profile = "constant"
[[controller]]
law = "lqr"
"""


def figure_of(experiment: Experiment) -> Figure:
    results = list(experiment.runs())
    figure = Figure(figsize=figure_size(results))
    draw_experiment(figure, results)
    return figure


def labels(figure: Figure) -> list[str]:
    return [axes.get_ylabel() for axes in figure.axes if axes.get_visible()]


def mine(folder: Path, deviation: str) -> Experiment:
    file = folder / "mine.toml"
    file.write_text(CASE.format(deviation=deviation))
    return Experiment.load(file)


def test_every_panel_has_its_own_unit(tmp_path: Path) -> None:
    """The output's is not that of s."""
    figure = figure_of(mine(tmp_path, "1 rad"))
    assert labels(figure) == [
        "pole angle [rad]", "distance from y* [rad]", "travel of the cart [m]", "s [rad/s]",
        "force [N]",
    ]  # fmt: skip


def test_each_output_has_a_panel_and_its_reference() -> None:
    experiment = Experiment.load("two_link_arm/case1").varied(duration=0.2)
    figure = figure_of(experiment)
    assert labels(figure)[:3] == ["output y1 [m]", "output y2 [m]", "|y − y*| [m]"]
    reference = [line for line in figure.axes[1].lines if line.get_label() == "reference"]
    run = experiment.run(law="grosmc")
    np.testing.assert_array_equal(reference[0].get_ydata(), run.comparison.reference[:, 1])


LOOP = """
[plant]
system = "{system}"
compare = ["physics"]
[run]
duration = "0.1 s"
engine = "python"
start = {{ "{bent}" = "1 rad" }}
[computing]
delay = "1 ms"
[[controller]]
law = "lqr"
{parts}
"""
NOISY = '[[sensor]]\nof = "{}"\nnoise = "{}"\n'
ESTIMATED = '[[estimator]]\nof = "{}"\n'


@pytest.mark.parametrize(
    ("system", "parts", "rates"),
    [
        ("servo", ESTIMATED.format("rotor speed"), ["rotor speed [rad/s]"]),
        ("servo", NOISY.format("rotor speed", "0.1 rad/s"), ["rotor speed [rad/s]"]),
        ("servo", NOISY.format("rotor angle", "1 mrad"), []),
        ("servo", NOISY.format("rotor speed", "0 rad/s"), []),
        (
            "cart_pendulum",
            ESTIMATED.format("cart speed") + ESTIMATED.format("pole rate"),
            ["cart speed [m/s]", "pole rate [rad/s]"],
        ),
        (
            "two_link_arm",
            NOISY.format("shoulder rate", "0.1 rad/s") + NOISY.format("elbow rate", "1 rad/s"),
            ["elbow rate [rad/s]"],
        ),
    ],
)
def test_a_rate_that_is_not_known_exactly_is_drawn_as_it_is_and_as_it_is_seen(
    system: str, parts: str, rates: list[str], tmp_path: Path
) -> None:
    file = tmp_path / "mine.toml"
    bent = {"servo": "rotor angle", "cart_pendulum": "pole angle"}.get(system, "elbow angle")
    file.write_text(LOOP.format(system=system, parts=parts, bent=bent))
    experiment = Experiment.load(file)
    figure, run = figure_of(experiment), experiment.run()
    ends = (" [rad/s]", " [m/s]")
    shown = [axes for axes in figure.axes if axes.get_ylabel().endswith(ends)]
    assert [axes.get_ylabel() for axes in shown] == rates
    names = [state.name for state in run.trajectory.system.states]
    assert run.trajectory.seen is not None
    for axes in shown:
        i = names.index(axes.get_ylabel().partition(" [")[0])
        true, seen = axes.lines
        assert (true.get_label(), seen.get_label()) == ("true", "seen by LQR")
        assert to_hex(true.get_color()) != to_hex(seen.get_color())
        # What jumps at every sample is its range and its mean.
        if not axes.collections:
            np.testing.assert_array_equal(true.get_ydata(), run.trajectory.state[:-1, i])
            np.testing.assert_array_equal(seen.get_ydata(), run.trajectory.seen[:, i])
    below = {text.get_text() for legend in figure.legends for text in legend.get_texts()}
    assert below == {"LQR, MuJoCo", "reference"}


def test_what_no_law_sees_of_a_machine_has_panels_where_there_is_any() -> None:
    """The twist first, with its backlash, then the current; each in a unit that reads well."""
    experiment = Experiment.load("cart_pendulum/machine").varied(duration=0.2)
    figure, runs = figure_of(experiment), list(experiment.runs())
    shown = [axes for axes in figure.axes if "not seen" in axes.get_ylabel()]
    assert [axes.get_ylabel() for axes in shown] == [
        "slider twist,\nnot seen [mm]", "force winding,\nnot seen [A]",
        "slider friction bristle,\nnot seen [µm]",
    ]  # fmt: skip
    lqr = next(run.trajectory for run in runs if run.key.endswith("physics/lqr"))
    assert lqr.physics is not None
    line = next(line for line in shown[0].lines if str(line.get_label()).startswith("LQR"))
    drawn = np.asarray(line.get_ydata(), float)
    if len(drawn) == len(lqr.time):
        np.testing.assert_allclose(drawn, 1e3 * lqr.unseen[0].of(lqr.physics))
    (play,) = shown[0].patches
    assert (play.get_label(), not shown[1].patches) == ("backlash", True)
    np.testing.assert_allclose(play.get_window_extent().height, _height(shown[0], 0.1), rtol=1e-6)
    rigid = experiment.varied(edits=())
    assert not [name for name in labels(figure_of(rigid)) if "not seen" in name]


def _height(axes: Axes, values: float) -> float:
    """Of so much on the y-axis, in pixels."""
    (_, low), (_, high) = axes.transData.transform([(0, 0), (0, values)])
    return float(high - low)


def test_a_run_that_ends_at_once_has_a_figure(tmp_path: Path) -> None:
    """Of the straight arm, where the law is not defined."""
    file = tmp_path / "mine.toml"
    parts = ESTIMATED.format("shoulder rate")
    text = LOOP.format(system="two_link_arm", parts=parts, bent="shoulder angle")
    file.write_text(text)
    assert "shoulder rate [rad/s]" in labels(figure_of(Experiment.load(file)))


def test_what_is_not_kept_is_framed_and_said(tmp_path: Path) -> None:
    figure = figure_of(mine(tmp_path, "1e-9 rad"))
    framed = [
        axes.get_ylabel().split(" [")[0]
        for axes in figure.axes
        if to_hex(axes.spines["top"].get_edgecolor()) == FAILED.lower()
    ]
    assert framed == ["distance from y*", "travel of the cart"]
    said = figure.axes[1].get_title(loc="right").splitlines()
    assert said == [f"not kept by {law}: deviation below 1e-9 rad" for law in ("lqr", "grosmc")]
    kept = figure_of(mine(tmp_path, "1 rad"))
    assert not kept.axes[1].get_title(loc="right")
    levels = [line for line in kept.axes[1].lines if line.get_label() == "limit"]
    assert sorted(float(np.ravel(line.get_ydata())[0]) for line in levels) == [-1.0, 1.0]


def test_a_signal_that_jumps_is_its_range_and_its_mean(tmp_path: Path) -> None:
    figure = figure_of(mine(tmp_path, "1 rad"))
    force = figure.axes[4]
    assert len(force.collections) == 1  # of GROSMC alone
    time = np.linspace(0.0, 1.0, 1001)
    found = envelope(time, np.where(np.arange(1001) % 2, 3.0, -1.0), 100)
    assert len(found.time) == 100
    assert set(found.least) == {-1.0}
    assert set(found.largest) == {3.0}
    np.testing.assert_allclose(found.mean, 1.0, atol=0.06)
    np.testing.assert_allclose(found.mean[2:-2], 1.0, atol=1e-6)
    short = envelope(np.zeros(1), np.ones(1))
    assert (short.least.tolist(), short.mean.tolist()) == ([1.0], [1.0])


def test_a_run_that_ended_early_is_marked(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(PUSHED_OVER)
    runs = list(Experiment.load(file).runs())
    ended = [run for run in runs if run.status is not Status.COMPLETED]
    assert ended
    figure = Figure()
    draw_experiment(figure, runs)
    assert [each.get_text() for each in figure.axes[0].texts] == ["ended"] * len(ended)


def test_a_law_has_one_colour_in_figures_and_films() -> None:
    results = list(Experiment.load("own_laws/pid").varied(duration=0.05).runs())
    styles = law_styles(result.controller.name for result in results)
    takes = film_of(results).takes
    assert [take.colour for take in takes] == [styles[r.controller.name].colour for r in results]
