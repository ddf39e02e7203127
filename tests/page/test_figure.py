"""Figures: written as a whole, and what their curves and laws look like."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import rgb_to_hsv, to_rgb
from matplotlib.figure import Figure

from grosmc_mj.errors import SetupError
from grosmc_mj.page.charts import chart_figure
from grosmc_mj.results.charts import write_cells
from grosmc_mj.results.envelope import jumps
from grosmc_mj.results.figure import figure_written, labelled_below
from grosmc_mj.results.palette import COLOURS, FAILED, KEPT, OTHERS, law_styles
from grosmc_mj.results.result import CellChart, LineChart, Series


def test_png_and_svg_are_written_together_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.png"
    save = Figure.savefig

    def full(self: Figure, file: Path, **options: object) -> None:
        if file.suffix == ".svg":
            raise OSError(28, "No space left on device")
        save(self, file, **options)  # pyright: ignore[reportArgumentType]

    with monkeypatch.context() as disk:
        disk.setattr(Figure, "savefig", full)
        with pytest.raises(SetupError, match="No space left"), figure_written(path, (1, 1)):
            pass
    assert not list(tmp_path.iterdir())
    with figure_written(path, (1, 1)):
        pass
    assert {file.name for file in tmp_path.iterdir()} == {"a.png", "a.svg"}


def test_a_signal_that_switches_at_every_sample_jumps_and_a_wave_does_not() -> None:
    time = np.linspace(0, 1, 1000)
    assert jumps(np.sign(np.sin(1e4 * time)))
    assert not jumps(np.sin(6 * np.pi * time))
    assert not jumps(np.zeros(1))


def test_kept_is_green_and_not_kept_is_red_on_either_side_of_the_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In figures, where white is the limit, and in lighter shades on the page."""
    figures: list[Figure] = []
    write = lambda figure, _: figures.append(figure)  # noqa: E731
    monkeypatch.setattr("grosmc_mj.results.figure.write_figure", write)
    cells = {("law", "a"): (-1.0, "✓", ""), ("law", "b"): (2.0, "✗", "")}
    write_cells(tmp_path / "a.png", "a", [CellChart.of("kept", cells, 2.0)], "a note")
    image = figures[0].axes[0].images[0]
    low, limit, high = np.asarray(image.cmap(image.norm(np.array([-2.0, 0.0, 2.0]))))[:, :3]
    expected = [*to_rgb(KEPT), 1, 1, 1, *to_rgb(FAILED)]
    assert [*low, *limit, *high] == pytest.approx(expected, abs=5e-3)
    assert np.asarray(image.get_array())[0, :2].tolist() == [-1.0, 2.0]
    (heat,) = chart_figure(CellChart.of("kept", cells, 2.0))["data"]
    assert (heat["zmin"], heat["zmax"]) == (-2.0, 2.0)
    for shade, meant in ((heat["colorscale"][0], KEPT), (heat["colorscale"][-1], FAILED)):
        hue, saturation, _ = rgb_to_hsv(to_rgb(shade[1]))
        assert hue == pytest.approx(rgb_to_hsv(to_rgb(meant))[0], abs=0.02)
        assert saturation > 0.3


def test_laws_have_the_same_colour_wherever_they_are_drawn() -> None:
    """Those without one of their own take the others in turn."""
    styles = law_styles(["lqr", "mine", "grosmc", "yours", "mine"])
    assert [style.colour for style in styles.values()] == [
        COLOURS["lqr"], OTHERS[0], COLOURS["grosmc"], OTHERS[1],
    ]  # fmt: skip
    assert [style.label for style in styles.values()] == ["LQR", "mine", "GROSMC", "yours"]
    assert len({style.line for style in styles.values()}) == 4
    lines = [Series(name=law, x=[0.0], y=[1.0]) for law in ("grosmc", "lqr", "mine")]
    drawn = chart_figure(LineChart(name="J", titles=("x", "y"), lines=lines))["data"]
    colours = [line["marker"]["color"] for line in drawn]
    assert colours[:2] == [COLOURS["grosmc"], COLOURS["lqr"]]
    assert len(set(colours)) == 3


@pytest.mark.parametrize("long", [0, 1, 2, 3])
def test_a_legend_below_stays_within_its_figure(
    long: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With as many long labels in a row; short ones stand three in a row."""
    labels = [f"implicit, predicted, corrected equations {i}" for i in range(long)]
    labels += [f"law {i}" for i in range(long, 9)]
    monkeypatch.setattr("grosmc_mj.results.figure.write_figure", lambda *_: None)
    with figure_written(tmp_path / "a.png", (7.2, 4.0)) as figure:
        axes = figure.subplots()
        for label in sorted(labels, key=lambda label: int(label[-1]) % 3):
            axes.plot([0, 1], label=label)
        labelled_below(figure, [axes])
        figure.draw_without_rendering()
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert figure.bbox.x0 <= box.x0 <= box.x1 <= figure.bbox.x1
    rows = {round(text.get_window_extent().y0) for text in legend.get_texts()}
    assert len(rows) == 3 or long
