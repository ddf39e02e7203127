"""How results look, whatever they are: JSON, tables and figures."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from matplotlib.colors import rgb_to_hsv, to_rgb
from matplotlib.figure import Figure
from rich.console import Console

from grosmc_mj.errors import SetupError
from grosmc_mj.page.charts import chart_figure
from grosmc_mj.results import tables
from grosmc_mj.results.charts import write_cells
from grosmc_mj.results.document import json_text, write_json
from grosmc_mj.results.envelope import jumps
from grosmc_mj.results.figure import figure_written, labelled_below
from grosmc_mj.results.palette import FAILED, KEPT
from grosmc_mj.results.result import CellChart
from grosmc_mj.results.tables import names, numbers, prefixed, table, text, words


def test_numbers_survive_to_the_last_bit_and_null_stands_for_those_that_json_has_not(
    tmp_path: Path,
) -> None:
    path, values = tmp_path / "new" / "a.json", [0.1, 5e-324, -0.0, 1e308, 1.0 + 2**-52]
    write_json(path, values)
    assert np.array(json.loads(path.read_text())).tobytes() == np.array(values).tobytes()
    margins = [math.inf, -math.inf, (math.nan, 1.5), np.float64(-math.inf), np.int64(3)]
    content = MappingProxyType({"margins": margins, "kept": np.bool_(True), "text": "inf"})
    assert json.loads(json_text(content)) == {
        "margins": [None, None, [None, 1.5], None, 3], "kept": True, "text": "inf",
    }  # fmt: skip
    # A document that cannot be written leaves the old file.
    with pytest.raises(TypeError):
        write_json(path, {"value": object()})
    assert [*path.parent.iterdir()] == [path]
    assert json.loads(path.read_text()) == values
    with pytest.raises(SetupError, match="cannot write"):
        write_json(path / "b.json", {})


# Tables.


def lines(shown: tables.Table) -> list[str]:
    """Lines of a wide terminal."""
    console = Console(width=160, color_system=None)
    with console.capture() as capture:
        console.print(shown)
    return [line.rstrip() for line in capture.get().splitlines()]


def test_a_group_is_named_once_and_set_apart_and_brackets_are_shown() -> None:
    rows, columns = [("a", "1"), ("a", "2"), ("b", "3")], [*words("case"), *numbers("value")]
    for grouped, expected in (
        (True, [["a", "1"], ["2"], [], ["b", "3"]]), (False, [["a", "1"], ["a", "2"], ["b", "3"]])
    ):  # fmt: skip
        printed = lines(table("", columns, rows, grouped=grouped))
        assert [line.split() for line in printed[2:]] == expected
    printed = lines(table("[bold]t[/]", words("u [rad]"), [("[/] [red]x",)], legend="in [deg]"))
    shown = [line.strip() for line in printed if set(line) - {"─", " "}]
    assert shown == ["[bold]t[/]", "u [rad]", "[/] [red]x", "in [deg]"]
    # Only text is wrapped, and fills the width.
    columns = [*names("law"), *text("statement"), *numbers("value")]
    row = ("a_law_of_my_own_with_a_long_name", "of several words " * 12, "1.25e-3")
    printed = lines(table("", columns, [row]))
    assert max(map(len, printed)) == tables.WIDTH
    assert "".join(printed).count("1.25e-3") == 1
    assert "a_law_of_my_own_with" in printed[2]
    # In Markdown numbers stand at the right, and bars stay bars.
    columns = [*words("law"), *numbers("max |u|"), *words("")]
    assert tables.markdown_table(columns, [("lqr", "1 N", "|s| > 0"), ("pid", "", "")]) == [
        r"| law | max \|u\| |  |", "|---|---:|---|", r"| lqr | 1 N | \|s\| > 0 |", "| pid |  |  |",
    ]  # fmt: skip


def test_a_number_has_six_characters_at_most_and_a_unit_its_prefix() -> None:
    values = (0.0, 0.01234, 12.345, 9999.0, 12345.0, -1.23456e-7, -math.inf, None)
    assert " ".join(map(tables.number, values)) == "0 0.0123 12.3 9999 1.2e4 -1.2e-7 -inf -"
    assert prefixed("rad", 2.0) == prefixed("rad", 0.0) == prefixed("rad", math.inf) == ("rad", 1)
    assert (prefixed("rad", 0.2), prefixed("m", 1e-3)) == (("mrad", 1e3), ("mm", 1e3))
    assert prefixed("m", 3e-5) == prefixed("m", 3e-9) == ("µm", 1e6)


# Figures.


def test_png_and_svg_are_written_together_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, save = tmp_path / "a.png", Figure.savefig

    def full(self: Figure, file: Path, **options: object) -> None:
        if file.suffix == ".svg":
            raise OSError(28, "No space left on device")
        save(self, file, **options)  # pyright: ignore[reportArgumentType]

    with monkeypatch.context() as disk:
        disk.setattr(Figure, "savefig", full)
        with pytest.raises(SetupError, match="No space left"), figure_written(path, (1, 1)):
            pass
    assert not list(tmp_path.iterdir())
    with figure_written(path, (7.2, 4.0)) as figure:
        axes = figure.subplots()
        for i in range(9):
            axes.plot(
                [0, 1], label=f"implicit, predicted, corrected equations {i}" if i < 2 else "a"
            )
        labelled_below(figure, [axes])
    assert {file.name for file in tmp_path.iterdir()} == {"a.png", "a.svg"}
    # A legend below stays within its figure.
    box = figure.legends[0].get_window_extent()
    assert figure.bbox.x0 <= box.x0 <= box.x1 <= figure.bbox.x1


def test_a_signal_that_switches_at_every_sample_jumps_and_a_wave_does_not() -> None:
    time = np.linspace(0, 1, 1000)
    signals = (np.sign(np.sin(1e4 * time)), np.sin(6 * np.pi * time), np.zeros(1))
    assert [jumps(signal) for signal in signals] == [True, False, False]


def test_kept_is_green_and_not_kept_is_red_on_either_side_of_the_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In figures, where white is the limit, and in lighter shades on the page."""
    figures, write = list[Figure](), "grosmc_mj.results.figure.write_figure"
    monkeypatch.setattr(write, lambda figure, _: figures.append(figure))
    cells = {("law", "a"): (-1.0, "✓", ""), ("law", "b"): (2.0, "✗", "")}
    shown = CellChart.of("kept", cells, 2.0)
    write_cells(tmp_path / "a.png", "a", [shown], "a note")
    image = figures[0].axes[0].images[0]
    colours = np.asarray(image.cmap(image.norm(np.array([-2.0, 0.0, 2.0]))))[:, :3]
    assert colours.ravel() == pytest.approx([*to_rgb(KEPT), 1, 1, 1, *to_rgb(FAILED)], abs=5e-3)
    assert np.asarray(image.get_array())[0, :2].tolist() == [-1.0, 2.0]
    (heat,) = chart_figure(shown)["data"]
    hues = [rgb_to_hsv(to_rgb(heat["colorscale"][end][1]))[0] for end in (0, -1)]
    assert hues == pytest.approx([rgb_to_hsv(to_rgb(x))[0] for x in (KEPT, FAILED)], abs=0.02)
