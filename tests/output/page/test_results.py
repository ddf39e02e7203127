"""Forms of results: JSON, tables and figures."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
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
from grosmc_mj.output.charts.chart import Chart, ChartAxis, Curve, Layer, Panel
from grosmc_mj.output.charts.envelope import envelope, jumps
from grosmc_mj.output.charts.figure import drawn, write_chart
from grosmc_mj.output.charts.interactive import page_figure
from grosmc_mj.output.charts.of_results import chart_of, panels_chart
from grosmc_mj.output.palette import CELLS as CELL_COLOURS
from grosmc_mj.output.palette import COLOURS, FAILED, INK, KEPT, Stroke
from grosmc_mj.output.results import tables
from grosmc_mj.output.results.document import json_text, write_json
from grosmc_mj.output.results.result import CellChart, LineChart, Series
from grosmc_mj.output.results.tables import (
    details,
    names,
    numbers,
    prefixed,
    table,
    text,
    words,
)

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


def lines_of(title: str, columns: list[Any], *rows: Sequence[str], **options: Any) -> list[str]:
    """Return the lines of a table in a wide terminal, without the rule below its header."""
    console = Console(width=160, color_system=None)
    with console.capture() as capture:
        console.print(table(title, columns, rows, **options))
    lines = [line.rstrip() for line in capture.get().splitlines()]
    return [line for line in lines if not line or line.strip("─ ")]


@pytest.mark.parametrize(
    ("grouped", "expected"),
    [(True, ["a 1", "2", "", "b 3"]), (False, ["a 1", "a 2", "b 3"])],
)
def test_a_group_is_named_once_and_set_apart(grouped: bool, expected: list[str]) -> None:
    columns = [*words("case"), *numbers("value")]
    _, *rows = lines_of("", columns, ("a", "1"), ("a", "2"), ("b", "3"), grouped=grouped)
    assert [" ".join(row.split()) for row in rows] == expected


def test_brackets_are_shown() -> None:
    lines = lines_of("[bold]t[/]", words("u [rad]"), ("[/] [red]x",), legend="in [deg]")
    assert [line.strip() for line in lines] == ["[bold]t[/]", "u [rad]", "[/] [red]x", "in [deg]"]


def test_a_long_text_fills_the_width_and_only_text_is_wrapped() -> None:
    columns = [*names("law"), *text("statement"), *numbers("value")]
    row = ("a_law_of_my_own_with_a_long_name", "of several words " * 12, "1.25e-3")
    lines = lines_of("", columns, row)
    # The last cell ends with a space.
    assert max(map(len, lines)) == tables.WIDTH - 1
    assert "a_law_of_my_own_with" in lines[1]
    assert lines[1].endswith(" 1.25e-3")


def test_markdown_aligns_numbers_right_and_escapes_bars() -> None:
    columns = [*words("law"), *numbers("max |u|"), *words("")]
    shown = table("", columns, [("lqr", "1 N", "|s| > 0"), ("pid", "", "")])
    assert shown.markdown() == [
        r"| law | max \|u\| |  |",
        "|---|---:|---|",
        r"| lqr | 1 N | \|s\| > 0 |",
        "| pid |  |  |",
    ]


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.0, "0"),
        (0.01234, "0.0123"),
        (12.345, "12.3"),
        (999.4, "999"),
        (999.6, "1000"),
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


# Brief tables.

EIGHT = table(
    "",
    [*words("name"), *details(numbers("detail")), *numbers("size")],
    [(f"row {i}", "9", str(i)) for i in range(8)],
    legend="About the detail.",
)


@pytest.mark.parametrize(
    ("most", "shown", "legend"),
    [(3, 3, "... and 5 more: --verbose has them"), (8, 8, "")],
)
def test_a_brief_table_says_how_many_rows_it_hides(most: int, shown: int, legend: str) -> None:
    """Its own legend is about all columns, also those of details."""
    brief = EIGHT.brief(most)
    assert brief.legend == legend
    assert brief.rows == [[f"row {i}", str(i)] for i in range(shown)]
    assert [column.header for column in brief.columns] == ["name", "size"]


@pytest.mark.parametrize(
    ("width", "legend"), [(42, ""), (43, "No room for: c d; --verbose has all.")]
)
def test_a_column_beyond_the_width_of_100_is_named(width: int, legend: str) -> None:
    """Each column takes 2 more."""
    columns = [*words("a"), *numbers("b", "c\nd")]
    brief = table("", columns, [("x" * width, "1" * 42, "2" * 10)]).brief(1)
    assert brief.legend == legend
    assert len(brief.rows[0]) == (2 if legend else 3)


# Formulas.


def test_a_formula_is_a_line_of_text() -> None:
    assert in_text(r"\tfrac12 \dot q^2 \le \varepsilon") == "1/2 q̇^2 ≤ ε"


# Figures.


SMALL_CHART = Chart([[Panel([])]], size=(1, 1))


def test_a_figure_is_written_as_two_files(tmp_path: Path) -> None:
    write_chart(SMALL_CHART, tmp_path / "a.png")
    assert {file.name for file in tmp_path.iterdir()} == {"a.png", "a.svg"}


def test_no_figure_is_written_if_one_of_its_files_cannot_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save = Figure.savefig

    def save_on_a_full_disk(self: Figure, file: Path, **options: Any) -> None:
        if file.suffix == ".svg":
            raise OSError(28, "No space left on device")
        save(self, file, **options)

    monkeypatch.setattr(Figure, "savefig", save_on_a_full_disk)
    with pytest.raises(SetupError, match="No space left"):
        write_chart(SMALL_CHART, tmp_path / "a.png")
    assert not list(tmp_path.iterdir())


def test_a_legend_below_stays_within_its_figure() -> None:
    labels = ["implicit, predicted, corrected equations", "implicit, predicted, as printed"]
    curves = [Curve([0, 1], [0, 1], Stroke(INK), name=name) for name in [*labels, *"abcdefg"]]
    figure = drawn(Chart([[Panel(curves)]], size=(7.2, 4.0)))
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    assert figure.bbox.x0 <= box.x0 <= box.x1 <= figure.bbox.x1


TIME = np.linspace(0, 1, 1000)


@pytest.mark.parametrize(
    ("signal", "expected"),
    [
        (np.sign(np.sin(1e4 * TIME)), True),
        # The steps of a wave add up to four times its amplitude a period: to 22 and 18 ranges.
        (np.sin(22 * np.pi * TIME), True),
        (np.sin(18 * np.pi * TIME), False),
        (np.zeros(1), False),
    ],
    ids=["switching", "quick wave", "wave", "single sample"],
)
def test_a_signal_jumps_if_its_steps_add_up_to_twenty_ranges(signal: Array, expected: bool) -> None:
    assert jumps(signal) == expected


def test_the_envelope_of_a_switching_signal_is_its_range_and_mean() -> None:
    """Two of three samples are at 5 and one is at -1; the mean is 3."""
    signal = np.tile([5.0, 5.0, -1.0], 400)
    drawn_as = envelope(np.arange(1200) / 100, signal, 40)
    assert drawn_as.time == pytest.approx(0.145 + 0.3 * np.arange(40))
    assert (set(drawn_as.least), set(drawn_as.largest)) == ({-1.0}, {5.0})
    assert drawn_as.mean == pytest.approx(np.full(40, 3.0), abs=0.05)


CELLS = CellChart.of("kept", {("law", "a"): (-1.0, "✓", ""), ("law", "b"): (2.0, "✗", "")}, 2.0)


def test_cells_of_a_figure_have_a_colour_for_kept_partly_and_failed() -> None:
    image = drawn(chart_of(CELLS)).axes[0].images[0]
    assert np.asarray(image.get_array())[0, :2].tolist() == [-1.0, 2.0]
    colours = np.asarray(image.cmap(image.norm(np.array([-2.0, 0.0, 2.0]))))[:, :3]
    # A colour map has 256 steps.
    for colour, expected in zip(colours, CELL_COLOURS, strict=True):
        assert colour == pytest.approx(to_rgb(expected), abs=5e-3)


@pytest.mark.parametrize(("end", "colour"), [(0, KEPT), (-1, FAILED)])
def test_cells_of_the_page_have_the_hues_of_a_figure(end: int, colour: str) -> None:
    (heat_map,) = page_figure(chart_of(CELLS)).data
    shown, expected = rgb_to_hsv([to_rgb(heat_map["colorscale"][end][1]), to_rgb(colour)])
    assert shown[0] == pytest.approx(expected[0], abs=0.02)


def lines(*curves: Series, **fields: Any) -> Chart:
    """Return the chart of curves."""
    return chart_of(LineChart(name="J", titles=("rate", "J"), lines=curves, **fields))


JUDGED = lines(Series(name="J", x=[1.0, 2.0, 3.0], y=[4.0, 5.0, 6.0], good=[True, None, False]))


def test_a_point_that_is_not_judged_is_not_marked_as_failed() -> None:
    _, failed, *_ = drawn(JUDGED).axes[0].lines
    assert list(np.asarray(failed.get_xdata())) == [3.0]


def test_the_page_marks_the_points_that_a_figure_marks() -> None:
    (curve,) = page_figure(JUDGED).data
    assert curve["marker"]["symbol"] == ["circle", "circle", "circle-open"]


@pytest.mark.parametrize(("first", "marks"), [(1.0, [20.0]), (90.0, [0.0, 20.0])])
def test_a_mark_at_zero_is_left_out_of_a_logarithmic_axis(first: float, marks: list[float]) -> None:
    chart = lines(Series(name="J", x=[first, 100.0], y=[1.0, 2.0]), marks=[0.0, 20.0])
    assert [shape["x0"] for shape in page_figure(chart).layout["shapes"]] == marks
    assert [np.ravel(line.get_xdata())[0] for line in drawn(chart).axes[0].lines[1:]] == marks


@pytest.mark.parametrize(
    ("y", "scale"),
    [
        ([1.0, 11.0], "log"),
        ([1.0, 9.0], "linear"),
        ([0.0, 11.0], "linear"),
        ([-90.0, 180.0], "linear"),
    ],
    ids=["more than a decade", "less", "zero", "a phase"],
)
def test_a_figure_and_the_page_have_one_scale(y: list[float], scale: str) -> None:
    chart = lines(Series(name="J", x=[1.0, 2.0], y=y))
    axes = drawn(chart).axes[0]
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", scale)
    layout = page_figure(chart).layout
    assert (layout["xaxis"]["type"], layout["yaxis"]["type"]) == ("linear", scale)


def test_words_along_an_axis_stand_in_their_order() -> None:
    chart = lines(Series(name="J", x=["sgn", "tanh"], y=[1.0, 2.0]))
    axes = drawn(chart).axes[0]
    assert [text.get_text() for text in axes.get_xticklabels()] == ["sgn", "tanh"]
    assert page_figure(chart).layout["xaxis"]["ticktext"] == ["sgn", "tanh"]


def test_a_law_has_one_colour_in_all_panels() -> None:
    """It had that of its place in each panel, where a law may be missing."""
    both = [Series(name=law, x=[1.0, 2.0], y=[1.0, 2.0]) for law in ("lqr", "implicit")]
    charts = [
        LineChart(name="J", titles=("rate", "J"), lines=curves) for curves in (both, both[1:])
    ]
    figure = drawn(panels_chart("a", [charts]))
    first, second = [[line.get_color() for line in axes.lines] for axes in figure.axes]
    assert first[0] == COLOURS["lqr"]
    assert first[1] == second[0]


def test_an_axis_that_is_linear_about_zero_has_powers_of_ten_on_the_page() -> None:
    layers: list[Layer] = [Curve([0.0, 1.0], [-1e-3, 1.0], Stroke(INK))]
    panel = Panel(layers, y=ChartAxis("y", "symlog", linear=1e-3, low=-1e-3, high=1.0))
    figure = page_figure(Chart([[panel]]))
    low, high = figure.data[0]["y"]
    # It is asinh of the value over the linear part.
    assert (low, high) == (pytest.approx(-math.asinh(1)), pytest.approx(math.asinh(1e3)))
    axis = figure.layout["yaxis"]
    assert axis["range"] == pytest.approx([low, high])
    assert dict(zip(axis["ticktext"], axis["tickvals"], strict=True))["1"] == pytest.approx(high)
