"""Tables of pages in Markdown."""

from __future__ import annotations

from grosmc_mj.results.tables import markdown_table, numbers, words


def test_numbers_stand_at_the_right_and_bars_stay_bars() -> None:
    columns = [*words("law"), *numbers("max |u|"), *words("")]
    assert markdown_table(columns, [("lqr", "1 N", "|s| > 0"), ("pid", "", "")]) == [
        r"| law | max \|u\| |  |",
        "|---|---:|---|",
        r"| lqr | 1 N | \|s\| > 0 |",
        "| pid |  |  |",
    ]
