"""Figures: written as a whole, and what their curves and laws look like."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from grosmc_mj.errors import SetupError
from grosmc_mj.results.envelope import jumps
from grosmc_mj.results.figure import figure_written, labelled_below
from grosmc_mj.results.palette import COLOURS, OTHERS, law_styles


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
    assert {each.name for each in tmp_path.iterdir()} == {"a.png", "a.svg"}


def test_a_signal_that_switches_at_every_sample_jumps_and_a_wave_does_not() -> None:
    time = np.linspace(0, 1, 1000)
    assert jumps(np.sign(np.sin(1e4 * time)))
    assert not jumps(np.sin(6 * np.pi * time))
    assert not jumps(np.zeros(1))


def test_laws_without_a_colour_take_the_others_in_turn() -> None:
    styles = law_styles(["lqr", "mine", "grosmc", "yours", "mine"])
    assert [each.colour for each in styles.values()] == [
        COLOURS["lqr"], OTHERS[0], COLOURS["grosmc"], OTHERS[1],
    ]  # fmt: skip
    assert [each.label for each in styles.values()] == ["LQR", "mine", "GROSMC", "yours"]
    assert len({each.line for each in styles.values()}) == 4


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
