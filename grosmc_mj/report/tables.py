"""Tables in the house's style, and numbers in them."""

from __future__ import annotations

from rich import box
from rich.table import Table


def number(value: float) -> str:
    """A number in at most six characters, with three significant digits where they fit."""
    if value == 0 or 0.01 <= abs(value) < 9999.5:
        return f"{value:.3g}" if abs(value) < 999.5 else f"{value:.0f}"
    return f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e")


def empty_table(title: str = "") -> Table:
    """An empty table in the house's style."""
    return Table(
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        show_edge=False,
        title=title or None,
        title_justify="left",
        title_style="bold",
    )
