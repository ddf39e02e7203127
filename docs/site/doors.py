"""The drawing of the package's doors, and the table of them, as the code has them.

``python docs/site/doors.py`` writes ``docs/figures/doors.svg`` and the table in
``docs/architecture.md`` anew. The order of the doors is the import contract's in
``pyproject.toml``; their contents are their docstrings and folders.
"""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator
from html import escape
from pathlib import Path

from grosmc_mj.output import palette
from grosmc_mj.output.results import tables
from grosmc_mj.output.results.markdown import replace_marked

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "grosmc_mj"
PAGE = ROOT / "docs" / "architecture.md"
DRAWING = ROOT / "docs" / "figures" / "doors.svg"

# Name of the import contract that orders the doors.
_CONTRACT = "doors"
# Sizes of the drawing [px].
_WIDTH = 800
_ROW = 56
_GAP = 8
_MARGIN = 36
# The arrow beside the doors.
_GREY = "#888888"


def floors() -> list[list[str]]:
    """Return the doors from top to bottom; those beside each other do not import one another."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    (contract,) = [each for each in contracts if each["id"] == _CONTRACT]
    return [layer.split(" | ") for layer in contract["layers"]]


def rooms(door: str) -> list[str]:
    """Return the names of the folders with code behind a door."""
    folders = (PACKAGE / door).iterdir()
    return sorted(folder.name for folder in folders if (folder / "__init__.py").is_file())


def about(door: str) -> str:
    """Return the docstring of a door as one paragraph of Markdown."""
    source = (PACKAGE / door / "__init__.py").read_text(encoding="utf-8")
    text = ast.get_docstring(ast.parse(source)) or ""
    return " ".join(text.split()).replace("``", "`")


def table() -> list[str]:
    """Return the table of the doors in Markdown."""
    rows = [[f"**{door}**", about(door)] for floor in floors() for door in floor]
    return tables.table("", tables.words("door", "behind it"), rows).markdown()


def drawing() -> str:
    """Return the doors as SVG: each imports only doors below it."""
    height = len(floors()) * (_ROW + _GAP) + _GAP
    shapes = [shape for place in _places() for shape in _door(*place)]
    arrow = (
        f'<path d="M{_MARGIN / 2} {_GAP}V{height - 12}" stroke="{_GREY}" stroke-width="2" '
        f'fill="none"/><path d="M{_MARGIN / 2 - 6} {height - 18}h12l-6 10z" fill="{_GREY}"/>'
    )
    label = (
        f'<text transform="translate(13 {height / 2}) rotate(-90)" text-anchor="middle" '
        f'font-size="12" fill="#444">imports</text>'
    )
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" '
        f'font-family="sans-serif">',
        f'<rect width="{_WIDTH}" height="{height}" fill="white"/>',
        arrow,
        label,
        *shapes,
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _places() -> Iterator[tuple[str, float, float, float]]:
    """Yield each door with the left, top and width of its rectangle [px]."""
    for row, floor in enumerate(floors()):
        width = (_WIDTH - _MARGIN - _GAP - (len(floor) - 1) * _GAP) / len(floor)
        for column, door in enumerate(floor):
            yield door, _MARGIN + column * (width + _GAP), _GAP + row * (_ROW + _GAP), width


def _door(door: str, left: float, top: float, width: float) -> list[str]:
    """Return the shapes of one door: its rectangle, its name and its folders."""
    middle = left + width / 2
    folders = rooms(door)
    shapes = [
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" height="{_ROW}" rx="6" '
        f'fill="{palette.BLUE}" fill-opacity="0.09" stroke="{palette.BLUE}"/>',
        f'<text x="{middle:.1f}" y="{top + (24 if folders else 34):.1f}" text-anchor="middle" '
        f'font-size="17" font-weight="bold" fill="#111">{escape(door)}</text>',
    ]
    if folders:
        shapes.append(
            f'<text x="{middle:.1f}" y="{top + 44:.1f}" text-anchor="middle" font-size="13" '
            f'fill="#444">{escape(" · ".join(folders))}</text>'
        )
    return shapes


def main() -> None:
    """Write the drawing and the table."""
    DRAWING.write_text(drawing(), encoding="utf-8")
    replace_marked(PAGE, "doors", lambda: "\n".join(table()))


if __name__ == "__main__":
    main()
