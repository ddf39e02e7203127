"""Figures: written as a whole, and what their curves and laws look like."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from grosmc_mj.errors import SetupError
from grosmc_mj.report.figure import figure_written, jumps
from grosmc_mj.report.palette import COLOURS, OTHERS, law_styles


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
