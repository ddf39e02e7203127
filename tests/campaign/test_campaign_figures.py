"""The figures of campaigns: what is drawn is what was given, and says so."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex

from grosmc_mj.campaign.findings.basis import NO_PROOF
from grosmc_mj.campaign.findings.promise import Promise
from grosmc_mj.campaign.findings.radius import Look, Radius
from grosmc_mj.campaign.report.margin_figure import draw_margins
from grosmc_mj.campaign.report.pass_map_figure import (
    BOUNDARY,
    Boundary,
    PassMap,
    Points,
    draw_pass_map,
)
from grosmc_mj.campaign.report.radius_figure import draw_radius
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.results.figure import in_lines, write_figure
from grosmc_mj.results.palette import COLOURS

INF = math.inf
TITLE = "Cart-pendulum: 8 of 16 runs, random, seed 0"
MARGINS = np.array([-INF, -INF, -0.5, 0.0, 0.5, 0.75, 1.0, 1.25])


def margins_figure(title: str = TITLE, **panels: Any) -> Any:
    """Margins in degrees, and what else is given, without a unit."""
    found = panels or {
        "deviation below 2 deg": {"grosmc": MARGINS, "mine": MARGINS[3:]},
        "settles within 4 s": {"grosmc": np.ones(3)},
    }
    units = dict.fromkeys(found, "") | {"deviation below 2 deg": "deg"}
    return draw_margins(found, units, title, NO_PROOF)


def pass_map(**boundary):
    x, y = np.linspace(1, 4, 8), np.linspace(-20, 20, 8)
    laws = {"grosmc": Points(x, y, MARGINS), "lqr": Points(x, y, x)}
    return PassMap("mass scale of pole", "start angle [deg]", laws, boundary)


def boundary(offset):
    """A premise that holds up to a mass scale of ``offset``, the rows being start angles."""
    x, y = np.linspace(1, 4, 13), np.linspace(-20, 20, 5)
    return Boundary(x, y, np.tile(offset - x, (5, 1)))


def searched(law="grosmc", least=(0.5, 0.1, -0.2, -INF), promised=1.5, note="by the sliding gain"):
    """Scales 1, 2 ..., of which those fail whose margin is negative."""
    looks = [
        Look(scale, margin, int(margin < 0), np.zeros(1))
        for scale, margin in enumerate(least, start=1)
    ]
    return Radius(law, 16, tuple(looks), Promise(promised, note), largest=8.0)


EACH = [
    lambda: margins_figure(),
    lambda: draw_pass_map(pass_map(grosmc=boundary(2.0)), TITLE, NO_PROOF),
    lambda: draw_radius([searched()], TITLE, NO_PROOF),
]


def drawn(figure: Any) -> Any:
    """The part of a figure that has its panels."""
    return figure.subfigs[0]


def entries(legend: Any) -> list[str]:
    """The texts of a legend, a line each."""
    return [text.get_text().replace("\n", " ") for text in legend.get_texts()]


@pytest.mark.slow
@pytest.mark.parametrize("make", EACH)
def test_figures_are_written_the_same_each_time(make, tmp_path):
    first = [tmp_path / "one" / name for name in ("a.png", "a.svg")]
    again = [tmp_path / "two" / name for name in ("a.png", "a.svg")]
    for files in (first, again):
        write_figure(make(), files)
    assert [file.read_bytes() for file in first] == [file.read_bytes() for file in again]
    assert first[0].read_bytes().startswith(b"\x89PNG")
    assert "<svg" in first[1].read_text()


@pytest.mark.parametrize(
    "make",
    [
        lambda: margins_figure(),
        lambda: draw_pass_map(pass_map(), TITLE, NO_PROOF),
        lambda: draw_radius([searched(), searched("lqr")], TITLE, NO_PROOF),
    ],
)
def test_every_figure_says_what_was_sampled_and_what_that_is_not(make):
    figure = make()
    assert drawn(figure).get_suptitle() == TITLE
    assert [text.get_text() for text in figure.texts] == [NO_PROOF]
    assert len(drawn(figure).axes) == 2


def test_lines_are_even_and_words_whole():
    assert in_lines("one two three four", 14) == "one two\nthree four"
    assert in_lines("a_very_long_word_of_its_own: 1 of 2", 28).splitlines()[0][-1] == ":"
    assert in_lines("") == ""


def test_a_figure_is_written_or_refused_as_a_whole(tmp_path):
    write_figure(EACH[2](), [tmp_path / "new" / "a.png"])
    assert [file.name for file in (tmp_path / "new").iterdir()] == ["a.png"]
    (tmp_path / "file").touch()
    with pytest.raises(SetupError, match="cannot write"):
        write_figure(EACH[2](), [tmp_path / "file" / "a.png"])


# Margins.


def test_margins_are_distribution_functions():
    panel = drawn(margins_figure()).axes[0]
    zero, curve, other = panel.lines
    assert list(zero.get_xdata()) == [0, 0]
    x, y = curve.get_data()
    for at in (-0.51, -0.5, -0.1, 0.0, 0.3, 1.25):
        assert y[np.searchsorted(x, at, side="right") - 1] == np.mean(at >= MARGINS)
    assert curve.get_drawstyle() == "steps-post"
    assert curve.get_color() == COLOURS["grosmc"]
    assert other.get_linestyle() != curve.get_linestyle()
    # The step of the runs that did not complete stands inside of the left edge.
    assert panel.get_xlim()[0] < x[0] == x[2] < -0.5
    assert y[2] == 2 / 8
    assert panel.get_xlabel() == "margin [deg]"
    assert panel.get_title() == "deviation below 2 deg"
    assert entries(panel.get_legend()) == [
        "GROSMC: 5 of 8 kept; 2 did not complete",
        "mine: 5 of 5 kept",
    ]


def test_margins_far_out_do_not_set_the_axis():
    margins = np.concatenate([np.linspace(0.5, 1, 50), [-3000.0, -1e9]])
    (panel,) = drawn(margins_figure(kept={"lqr": margins})).axes
    low, high = panel.get_xlim()
    assert -0.5 < low < 0 < 1 < high < 1.5
    assert entries(panel.get_legend()) == ["LQR: 50 of 52 kept; 2 beyond the left edge"]


@pytest.mark.parametrize(
    "margins", [[-INF, -INF], [0.0], [-5.0, -4.0], [1e-9, 2e-9], [3.0], [-1e300, 1.0]]
)
def test_zero_is_always_well_inside(margins):
    figure = margins_figure(kept={"grosmc": np.array(margins)})
    low, high = drawn(figure).axes[0].get_xlim()
    assert low < 0 < high
    assert 0.1 < -low / (high - low) < 0.9


def test_a_law_that_fails_widely_does_not_hide_the_others():
    laws = {"grosmc": np.linspace(0.1, 1, 30), "lqr": np.linspace(-1e6, -1e5, 30)}
    low, _ = drawn(margins_figure(kept=laws)).axes[0].get_xlim()
    assert low > -10


def test_an_axis_of_margins_has_their_own_scale():
    """Margins of another unit are drawn the same, and all that is drawn fits."""
    margins, least = np.linspace(-0.05, 0.2, 30), np.array([-INF, 0.5, 0.1, -0.2])
    limits = []
    for factor in (1.0, 2.0**-20, 2.0**20):
        laws = {"grosmc": factor * margins, "lqr": -1e6 * factor * np.ones(30)}
        first = margins_figure(kept=laws)
        second = draw_radius([searched(least=factor * least)], TITLE, "")
        found = (drawn(first).axes[0].get_xlim(), drawn(second).axes[0].get_ylim())
        limits.append(np.array(found) / factor)
    np.testing.assert_allclose(limits[1:], [limits[0]] * 2, rtol=1e-9)
    assert limits[0][1, 0] < -0.2 < 0.5 < limits[0][1, 1]


# The pass map.


def test_every_run_is_marked_by_its_outcome():
    shown = pass_map()
    first, second = drawn(draw_pass_map(shown, TITLE, NO_PROOF)).axes
    marks = {each.get_label(): each for each in first.collections}
    masks = {
        "passed": MARGINS >= 0,
        "failed": MARGINS == -0.5,
        "did not complete": MARGINS == -INF,
    }
    assert list(marks) == list(masks)
    points = np.stack(shown.laws["grosmc"][:2], axis=1)
    for outcome, mask in masks.items():
        np.testing.assert_array_equal(marks[outcome].get_offsets(), points[mask])
    assert len({to_hex(each.get_facecolor()[0]) for each in marks.values()}) == 3
    assert len({each.get_paths()[0].vertices.shape for each in marks.values()}) == 3
    assert first.get_title() == "GROSMC: 5 of 8 passed"
    assert second.get_title() == "LQR: 8 of 8 passed"
    assert (first.get_xlabel(), first.get_ylabel()) == ("mass scale of pole", "start angle [deg]")
    assert (first.get_xlim(), first.get_ylim()) == (second.get_xlim(), second.get_ylim())


def test_the_premise_is_drawn_where_it_begins_to_fail():
    figure = draw_pass_map(pass_map(grosmc=boundary(2.1)), TITLE, NO_PROOF)
    first, second = drawn(figure).axes
    hatched, line = first.collections[3:]
    (path,) = line.get_paths()
    # Between the columns of the grid the margin is linear, as the contour is.
    np.testing.assert_allclose(path.vertices[:, 0], 2.1, rtol=1e-12)
    assert hatched.hatches == ["//"]
    assert hatched.get_paths()[0].vertices[:, 0].min() == pytest.approx(2.1)
    assert len(second.collections) == 1
    (legend,) = drawn(figure).legends
    assert entries(legend) == [
        "passed", "failed", "did not complete", BOUNDARY, "a premise does not hold",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("offset", "said", "hatched"),
    [(9.0, "the premises hold all over the map", 0), (0.0, "a premise does not hold", 1)],
)
def test_a_premise_without_a_boundary_on_the_map(offset, said, hatched):
    figure = draw_pass_map(pass_map(grosmc=boundary(offset)), TITLE, NO_PROOF)
    assert len(drawn(figure).axes[0].collections) == 3 + hatched
    assert entries(drawn(figure).legends[0])[3:] == [said]


def test_a_premise_may_be_minus_infinity():
    given = boundary(2.5)
    given.margin[:, -3:] = -INF
    line = drawn(draw_pass_map(pass_map(grosmc=given), TITLE, "")).axes[0].collections[-1]
    np.testing.assert_allclose(line.get_paths()[0].vertices[:, 0], 2.5, rtol=1e-12)


# The radius.


def test_a_radius_is_drawn_beside_the_promise():
    (panel,) = drawn(draw_radius([searched()], TITLE, NO_PROOF)).axes
    legend = dict(zip(entries(panel.get_legend()), panel.get_legend().legend_handles, strict=True))
    lines = {each.get_label().replace("\n", " "): each for each in panel.lines}
    assert list(legend) == [
        "no failure found",
        "failure found",
        "a run did not complete",
        "no failure found up to 2",
        "premises promise 1.5: by the sliding gain",
    ]
    data = {label: [list(row) for row in lines[label].get_data()] for label in legend}
    bottom = panel.get_ylim()[0]
    assert data["no failure found"] == [[1, 2], [0.5, 0.1]]
    assert data["failure found"] == [[3], [-0.2]]
    assert data["a run did not complete"] == [[4], [bottom]]
    assert bottom < -0.2
    path = panel.lines[1].get_data()
    assert [list(row) for row in path] == [[1, 2, 3, 4], [0.5, 0.1, -0.2, bottom]]
    assert lines["no failure found"].get_markerfacecolor() == COLOURS["grosmc"]
    assert lines["failure found"].get_markerfacecolor() == "white"
    assert data["no failure found up to 2"][0] == [2, 2]
    assert data["premises promise 1.5: by the sliding gain"][0] == [1.5, 1.5]
    # The smaller one stands to the left of its line, the larger one to the right.
    sides = {text.get_text(): text.get_ha() for text in panel.texts}
    assert sides == {"2": "left", "1.5": "right"}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"least": np.ones(4)}, "no failure found up to 4, the largest tried"),
        ({"least": -np.ones(4)}, "a failure was found at every scale tried"),
        ({"promised": None, "note": "no gain"}, "premises promise no radius: no gain"),
        ({"note": ""}, "premises promise 1.5"),
    ],
)
def test_a_radius_that_is_not_there_is_said(changes, said):
    (panel,) = drawn(draw_radius([searched(**changes)], TITLE, NO_PROOF)).axes
    assert said in entries(panel.get_legend())


def test_where_s_leaves_its_bound_is_drawn_beside_the_promise():
    found = searched()
    looks = [replace(look, leaving=int(look.scale > 2)) for look in found.looks]
    found = replace(found, looks=tuple(looks), band=0.1)
    (panel,) = drawn(draw_radius([found], TITLE, NO_PROOF)).axes
    lines = {each.get_label().replace("\n", " "): each for each in panel.lines}
    (said,) = [label for label in lines if label.startswith("|s|")]
    assert said == "|s| keeps the promised bound up to 2, leaves it at 3"
    assert list(lines[said].get_xdata()) == [2, 2]


def test_unknown_endings_are_refused_before_anything_is_written(tmp_path):
    with pytest.raises(ArgumentError, match=r"a.pdf: a figure ends in .png or .svg"):
        write_figure(EACH[2](), [tmp_path / "a.png", tmp_path / "a.pdf"])
    assert not list(tmp_path.iterdir())
