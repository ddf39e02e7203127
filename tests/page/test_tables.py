"""The one table builder: groups, width, and texts that look like markup."""

from __future__ import annotations

import math

from rich.console import Console

from grosmc_mj.results.tables import (
    WIDTH,
    Table,
    markdown_table,
    names,
    number,
    numbers,
    prefixed,
    table,
    text,
    words,
)


def lines(shown: Table) -> list[str]:
    """What a wide terminal shows."""
    console = Console(width=160, color_system=None)
    with console.capture() as found:
        console.print(shown)
    return [line.rstrip() for line in found.get().splitlines()]


def test_a_group_is_named_once_and_set_apart() -> None:
    rows = [("a", "1"), ("a", "2"), ("b", "3")]
    columns = [*words("case"), *numbers("value")]
    found = lines(table("", columns, rows, grouped=True))
    assert [line.split() for line in found[2:]] == [["a", "1"], ["2"], [], ["b", "3"]]
    plain = lines(table("", columns, rows))
    assert [line.split() for line in plain[2:]] == [["a", "1"], ["a", "2"], ["b", "3"]]


def test_brackets_are_shown_as_they_are() -> None:
    shown = lines(table("[bold]t[/]", words("u [rad]"), [("[/] [red]x",)], legend="in [deg]"))
    assert [line.strip() for line in shown if set(line) - {"─", " "}] == [
        "[bold]t[/]", "u [rad]", "[/] [red]x", "in [deg]",
    ]  # fmt: skip


def test_only_text_is_wrapped_and_fills_the_width() -> None:
    long = "of several words " * 12
    columns = [*names("law"), *text("statement"), *numbers("found")]
    found = lines(table("", columns, [("a_law_of_my_own_with_a_long_name", long, "1.25e-3")]))
    assert max(map(len, found)) == WIDTH
    assert "…" not in "".join(found)
    assert "".join(found).count("1.25e-3") == 1
    assert "a_law_of_my_own_with" in found[2]


def test_a_number_has_six_characters_at_most() -> None:
    values = (0.0, 0.01234, 12.345, 9999.0, 12345.0, -1.23456e-7, float("-inf"))
    assert [*map(number, values)] == [
        "0", "0.0123", "12.3", "9999", "1.2e4", "-1.2e-7", "-inf",
    ]  # fmt: skip
    assert number(None) == "-"


def test_a_unit_has_the_prefix_that_its_number_is_read_with() -> None:
    assert prefixed("rad", 2.0) == prefixed("rad", 0.0) == prefixed("rad", math.inf) == ("rad", 1)
    assert prefixed("rad", 0.2) == ("mrad", 1e3)
    assert prefixed("m", 1e-3) == ("mm", 1e3)
    assert prefixed("m", 3e-5) == prefixed("m", 3e-9) == ("µm", 1e6)


def test_numbers_stand_at_the_right_and_bars_stay_bars() -> None:
    columns = [*words("law"), *numbers("max |u|"), *words("")]
    assert markdown_table(columns, [("lqr", "1 N", "|s| > 0"), ("pid", "", "")]) == [
        r"| law | max \|u\| |  |",
        "|---|---:|---|",
        r"| lqr | 1 N | \|s\| > 0 |",
        "| pid |  |  |",
    ]
