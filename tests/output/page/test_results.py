"""Forms of results: JSON, tables and figures."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import rgb_to_hsv, to_rgb
from matplotlib.figure import Figure
from rich.console import Console

from grosmc_mj.chapter.claims.formulas import in_text
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import SetupError
from grosmc_mj.output.charts.charts import write_cells, write_panels
from grosmc_mj.output.charts.envelope import jumps
from grosmc_mj.output.charts.figure import draw_legend_below, figure_written
from grosmc_mj.output.page.charts import chart_figure
from grosmc_mj.output.palette import CELLS as CELL_COLOURS
from grosmc_mj.output.palette import FAILED, KEPT, LABELS, label_of
from grosmc_mj.output.results import tables
from grosmc_mj.output.results.document import json_text, write_json
from grosmc_mj.output.results.result import CellChart, LineChart, Series
from grosmc_mj.output.results.tables import names, numbers, prefixed, table, text, words

# Documents.


def test_numbers_survive_to_the_last_bit(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.json"
    values = [0.1, 5e-324, -0.0, 1e308, 1.0 + 2**-52]
    write_json(path, values)
    assert np.array(json.loads(path.read_text())).tobytes() == np.array(values).tobytes()


def test_null_stands_for_numbers_that_json_does_not_have() -> None:
    margins = [math.inf, -math.inf, (math.nan, 1.5), np.float64(-math.inf), np.int64(3)]
    content = MappingProxyType({"margins": margins, "kept": np.bool_(True), "text": "inf"})
    assert json.loads(json_text(content)) == {
        "margins": [None, None, [None, 1.5], None, 3],
        "kept": True,
        "text": "inf",
    }


def test_a_document_that_cannot_be_written_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_json(path, [1.0])
    with pytest.raises(TypeError):
        write_json(path, {"value": object()})
    assert list(tmp_path.iterdir()) == [path]
    assert json.loads(path.read_text()) == [1.0]


def test_a_document_in_a_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_json(path, [1.0])
    with pytest.raises(SetupError, match="cannot write"):
        write_json(path / "b.json", {})


# Tables.


def printed(shown: tables.Table) -> list[str]:
    """Return the lines of a table in a wide terminal."""
    console = Console(width=160, color_system=None)
    with console.capture() as capture:
        console.print(shown)
    return [line.rstrip() for line in capture.get().splitlines()]


def rows_of_two_cases(*, grouped: bool) -> list[list[str]]:
    """Return the texts of each row of a table with two rows of a case and one of another."""
    columns = [*words("case"), *numbers("value")]
    rows = [("a", "1"), ("a", "2"), ("b", "3")]
    lines = printed(table("", columns, rows, grouped=grouped))
    return [line.split() for line in lines[2:]]


def test_a_group_is_named_once() -> None:
    rows = [row for row in rows_of_two_cases(grouped=True) if row]
    assert rows == [["a", "1"], ["2"], ["b", "3"]]


def test_a_group_is_set_apart() -> None:
    has_texts = [bool(row) for row in rows_of_two_cases(grouped=True)]
    assert has_texts == [True, True, False, True]


def test_every_row_without_groups_is_named() -> None:
    assert rows_of_two_cases(grouped=False) == [["a", "1"], ["a", "2"], ["b", "3"]]


def test_brackets_are_shown() -> None:
    shown = table("[bold]t[/]", words("u [rad]"), [("[/] [red]x",)], legend="in [deg]")
    lines = [line.strip() for line in printed(shown)]
    texts = [line for line in lines if line.strip("─ ")]
    assert texts == ["[bold]t[/]", "u [rad]", "[/] [red]x", "in [deg]"]


def lines_of_a_long_text() -> list[str]:
    """Return the lines of a table with a name, a text of many words and a number."""
    columns = [*names("law"), *text("statement"), *numbers("value")]
    row = ("a_law_of_my_own_with_a_long_name", "of several words " * 12, "1.25e-3")
    return printed(table("", columns, [row]))


def test_a_long_text_fills_the_width() -> None:
    assert max(map(len, lines_of_a_long_text())) == tables.WIDTH


def test_only_text_is_wrapped() -> None:
    lines = lines_of_a_long_text()
    assert "".join(lines).count("1.25e-3") == 1
    assert "a_law_of_my_own_with" in lines[2]


def markdown_lines() -> list[str]:
    """Return a table with bars in its texts, in Markdown."""
    columns = [*words("law"), *numbers("max |u|"), *words("")]
    rows = [("lqr", "1 N", "|s| > 0"), ("pid", "", "")]
    return tables.table("", columns, rows).markdown()


def test_markdown_aligns_numbers_right() -> None:
    assert markdown_lines()[1] == "|---|---:|---|"


def test_markdown_escapes_bars() -> None:
    heading, _, *rows = markdown_lines()
    assert heading == r"| law | max \|u\| |  |"
    assert rows == [r"| lqr | 1 N | \|s\| > 0 |", "| pid |  |  |"]


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.0, "0"),
        (0.01234, "0.0123"),
        (12.345, "12.3"),
        (9999.0, "9999"),
        (12345.0, "1.2e4"),
        (-1.23456e-7, "-1.2e-7"),
        (-math.inf, "-inf"),
        (None, "-"),
    ],
)
def test_a_number_is_written_in_short(value: float, expected: str) -> None:
    assert tables.number(value) == expected


@pytest.mark.parametrize(
    ("unit", "value", "expected"),
    [
        ("rad", 2.0, ("rad", 1)),
        ("rad", 0.0, ("rad", 1)),
        ("rad", math.inf, ("rad", 1)),
        ("rad", 0.2, ("mrad", 1e3)),
        ("m", 1e-3, ("mm", 1e3)),
        ("m", 3e-5, ("µm", 1e6)),
        ("m", 3e-9, ("µm", 1e6)),
    ],
)
def test_a_small_number_has_a_unit_with_a_prefix(
    unit: str, value: float, expected: tuple[str, float]
) -> None:
    assert prefixed(unit, value) == expected


# Names and formulas.


@pytest.mark.parametrize(
    ("law", "label"),
    [
        ("grosmc", "GROSMC"),
        ("implicit, predicted", "GROSMC, implicit, predicted"),
        ("lqi, quick", "LQI, quick"),
        ("mine", "mine"),
        ("mine, quick", "mine, quick"),
        ("LQR", '"LQR"'),
        ("GROSMC, implicit, predicted", '"GROSMC, implicit, predicted"'),
    ],
)
def test_a_law_is_named_as_people_say(law: str, label: str) -> None:
    assert label_of(law) == label


def test_no_two_laws_of_the_package_have_one_label() -> None:
    assert len(set(LABELS.values())) == len(LABELS)


def test_a_formula_is_a_line_of_text() -> None:
    assert in_text(r"\tfrac12 \dot q^2 \le \varepsilon") == "1/2 q̇^2 ≤ ε"


# Figures.


def test_no_figure_is_written_if_one_of_its_files_cannot_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save = Figure.savefig

    def save_on_a_full_disk(self: Figure, file: Path, **options: Any) -> None:
        if file.suffix == ".svg":
            raise OSError(28, "No space left on device")
        save(self, file, **options)

    monkeypatch.setattr(Figure, "savefig", save_on_a_full_disk)
    with (
        pytest.raises(SetupError, match="No space left"),
        figure_written(tmp_path / "a.png", (1, 1)),
    ):
        pass
    assert not list(tmp_path.iterdir())


def test_a_legend_below_stays_within_its_figure(tmp_path: Path) -> None:
    labels = [f"implicit, predicted, corrected equations {i}" for i in range(2)]
    with figure_written(tmp_path / "a.png", (7.2, 4.0)) as figure:
        axes = figure.subplots()
        for label in [*labels, *"aaaaaaa"]:
            axes.plot([0, 1], label=label)
        draw_legend_below(figure, [axes])

    assert {file.name for file in tmp_path.iterdir()} == {"a.png", "a.svg"}
    box = figure.legends[0].get_window_extent()
    assert figure.bbox.x0 <= box.x0 <= box.x1 <= figure.bbox.x1


TIME = np.linspace(0, 1, 1000)


@pytest.mark.parametrize(
    ("signal", "expected"),
    [
        (np.sign(np.sin(1e4 * TIME)), True),
        (np.sin(6 * np.pi * TIME), False),
        (np.zeros(1), False),
    ],
    ids=["switching", "wave", "single sample"],
)
def test_only_a_signal_that_switches_at_every_sample_jumps(signal: Array, expected: bool) -> None:
    assert jumps(signal) == expected


CELLS = CellChart.of("kept", {("law", "a"): (-1.0, "✓", ""), ("law", "b"): (2.0, "✗", "")}, 2.0)


def test_cells_of_a_figure_have_a_colour_for_kept_partly_and_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures: list[Figure] = []
    write = "grosmc_mj.output.charts.figure.write_figure"
    monkeypatch.setattr(write, lambda figure, files: figures.append(figure))
    write_cells(tmp_path / "a.png", "a", [CELLS], "a note")

    image = figures[0].axes[0].images[0]
    assert np.asarray(image.get_array())[0, :2].tolist() == [-1.0, 2.0]
    colours = np.asarray(image.cmap(image.norm(np.array([-2.0, 0.0, 2.0]))))[:, :3]
    # A colour map has 256 steps.
    for colour, expected in zip(colours, CELL_COLOURS, strict=True):
        assert colour == pytest.approx(to_rgb(expected), abs=5e-3)


def test_a_point_that_is_not_judged_is_not_marked_as_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures: list[Figure] = []
    write = "grosmc_mj.output.charts.figure.write_figure"
    monkeypatch.setattr(write, lambda figure, files: figures.append(figure))
    curve = Series(name="J", x=[1.0, 2.0, 3.0], y=[4.0, 5.0, 6.0], good=[True, None, False])
    chart = LineChart(name="J", titles=("rate", "J"), lines=[curve])
    write_panels(tmp_path / "a.png", "a", [[chart]])
    _, failed, *_ = figures[0].axes[0].lines
    assert list(np.asarray(failed.get_xdata())) == [3.0]


@pytest.mark.parametrize(("end", "colour"), [(0, KEPT), (-1, FAILED)])
def test_cells_of_the_page_have_the_hues_of_a_figure(end: int, colour: str) -> None:
    (heat_map,) = chart_figure(CELLS).data
    hue = rgb_to_hsv(to_rgb(heat_map["colorscale"][end][1]))[0]
    assert hue == pytest.approx(rgb_to_hsv(to_rgb(colour))[0], abs=0.02)


@pytest.mark.parametrize(("first", "marks"), [(1.0, [20.0]), (90.0, [0.0, 20.0])])
def test_a_mark_at_zero_is_left_out_of_a_logarithmic_axis(first: float, marks: list[float]) -> None:
    curve = Series(name="J", x=[first, 100.0], y=[1.0, 2.0])
    chart = LineChart(name="J", titles=("rate", "J"), lines=[curve], marks=[0.0, 20.0])
    layout = chart_figure(chart).layout
    assert [shape["x0"] for shape in layout["shapes"]] == marks
