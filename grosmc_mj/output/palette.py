"""Colours and line styles of figures and films.

A law has the same name everywhere: the one that it has in its file, and that people type.

The colours are those of Okabe and Ito, then those of Tol: colour-blind readers can tell them apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal, NamedTuple

Dash = Literal["solid", "dash", "dot", "dashdot", "longdash", "longdashdot"]


class Stroke(NamedTuple):
    """How a line is drawn.

    Attributes:
        colour: Colour as #RRGGBB, or ``INK``.
        width: Width [point].
        dash: Dashes.
        opacity: 1 for a line that hides all below it.
    """

    colour: str
    width: float = 1.4
    dash: Dash = "solid"
    opacity: float = 1.0


# Colour of the text of a page, light or dark; on paper it is black.
INK = "ink"

# The colours of Okabe and Ito, with a softer black.
BLACK = "#222222"
ORANGE = "#E69F00"
SKY = "#56B4E9"
GREEN = "#009E73"
YELLOW = "#F0E442"
BLUE = "#0072B2"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#888888"

# Colours of laws.
COLOURS = {
    "lqr": VERMILION,
    "fl-lqr": PURPLE,
    "grosmc": BLUE,
    "pd": ORANGE,
    "lqi": "#661100",
    "fl-pid": GREY,
    "adrc": "#117733",
    "cart-lqr": "#999933",
    "cart-ism": SKY,
    "cart-pfl": "#882255",
}
# Laws with the chapter's integral surface, however they switch.
GROSMC_LAWS = frozenset(
    {
        "grosmc",
        "grosmc-implicit",
        "implicit",
        "sign",
        "boundary-layer",
        "implicit-estimate",
        "super-twisting",
        "grosmc adaptive",
        "regulating-grosmc",
    }
)
# Colours of all other laws, in turn.
OTHERS = ("#332288", "#44AA99", "#AA4499", "#DDCC77")

# Lines of plants: physics is thick, the equations lie thin on top of it.
PLANT_LINES: Mapping[str, Stroke] = {
    "physics": Stroke(INK, 3.2, "solid", 0.45),
    "corrected": Stroke(INK, 1.1, "dash"),
    "printed": Stroke(INK, 1.1, "dot"),
    "measured": Stroke(INK, 1.3),
}
# Names of plants for people.
PLANTS: Mapping[str, str] = {
    "physics": "MuJoCo",
    "corrected": "corrected equations",
    "printed": "printed equations",
    "measured": "measured",
}

# Colours of requirements: kept, not kept, or not decided.
KEPT = GREEN
FAILED = VERMILION
# Cells of a chart: kept, kept in part, not kept; light, for dark letters.
CELLS = ("#7fceb9", "#f5e6a0", "#f0925a")
OPEN = ORANGE
# Colours of words that are verdicts, in lower case.
VERDICT_COLOURS = {
    "supported": KEPT,
    "kept": KEPT,
    "holds": KEPT,
    "refuted": FAILED,
    "premise not met": FAILED,
    "not kept": FAILED,
    "fails": FAILED,
    "undetermined": OPEN,
    "inconclusive": OPEN,
}

OPTIMUM = BLACK
DISTURBANCE = GREEN
GRID = "#dddddd"
# Line of the reference or the nominal optimum, which lies above all curves.
REFERENCE = Stroke(INK, 1.0, "dot")


def colour_of(controller: str, others: int = 0) -> str:
    """Return the colour of a law; one without a colour takes number ``others`` of ``OTHERS``."""
    return COLOURS.get(controller, OTHERS[others % len(OTHERS)])


def law_colours(laws: Iterable[str]) -> dict[str, str]:
    """Return the colour of each law; laws without a colour take those of ``OTHERS`` in turn."""
    colours: dict[str, str] = {}
    without_colour = 0
    for law in dict.fromkeys(laws):
        colours[law] = colour_of(law, without_colour)
        if law not in COLOURS:
            without_colour += 1
    return colours


def red_green_blue(colour: str) -> tuple[float, float, float]:
    """Return the three parts of a colour #RRGGBB as numbers from 0 to 1."""
    red = int(colour[1:3], 16) / 255
    green = int(colour[3:5], 16) / 255
    blue = int(colour[5:7], 16) / 255
    return (red, green, blue)
