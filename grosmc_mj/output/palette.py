"""Colours and line styles of figures and films.

The colours are those of Okabe and Ito, then those of Tol: colour-blind readers can tell them apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

# The colours of Okabe and Ito, with a softer black.
BLACK = "#222222"
ORANGE = "#E69F00"
SKY = "#56B4E9"
GREEN = "#009E73"
YELLOW = "#F0E442"
BLUE = "#0072B2"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"

# Colours of laws.
COLOURS = {
    "lqr": VERMILION,
    "fl-lqr": PURPLE,
    "grosmc": BLUE,
    "pd": ORANGE,
    "lqi": "#661100",
    "fl-pid": "#888888",
    "adrc": "#117733",
    "cart-lqr": "#999933",
    "cart-ism": SKY,
    "cart-pfl": "#882255",
}
# Names of laws for people.
LABELS = {
    "lqr": "LQR",
    "fl-lqr": "FL + LQR",
    "grosmc": "GROSMC",
    "grosmc-implicit": "GROSMC, implicit, discrete surface",
    "implicit": "GROSMC, implicit",
    "sign": "GROSMC, sign",
    "boundary-layer": "GROSMC, boundary layer",
    "implicit-estimate": "GROSMC, implicit with estimate",
    "super-twisting": "GROSMC, super-twisting",
    "grosmc adaptive": "GROSMC, adaptive gain",
    "regulating-grosmc": "regulating GROSMC",
    # The rival, or where there is none GROSMC's own adaptive gain.
    "adaptive": "adaptive",
    "pd": "PD",
    "lqi": "LQI",
    "pid": "PID",
    "fl-pid": "FL + PID",
    "adrc": "ADRC",
    "cart-lqr": "4-state LQR",
    "cart-ism": "4-state ISM",
    "cart-pfl": "partial FL",
}
# Colours of all other laws, in turn.
OTHERS = ("#332288", "#44AA99", "#AA4499", "#DDCC77")

# Line styles of laws, in turn: they tell laws apart without colours.
_DASHES = ("-", (0, (5, 2)), (0, (1, 1.2)), (0, (6, 2, 1, 2)))

# Line styles of plants: physics is thick, the equations lie thin on top of it.
LINES: Mapping[str, Mapping[str, Any]] = {
    "physics": {"lw": 3.2, "alpha": 0.45, "ls": "-"},
    "corrected": {"lw": 1.1, "ls": "--"},
    "printed": {"lw": 1.1, "ls": ":"},
    "measured": {"lw": 1.3, "ls": "-"},
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
# Line style of the reference or the nominal optimum, which lies above all curves.
REFERENCE: Mapping[str, Any] = {"color": OPTIMUM, "lw": 1, "ls": (0, (1, 2)), "zorder": 5}


def label_of(controller: str) -> str:
    """Return a law's name for people, such as ``GROSMC, implicit`` for ``implicit``.

    Two laws have two names: one of a user's that is called as a law of the package is for people
    stands in quotation marks.
    """
    name, comma, variant = controller.partition(", ")
    if name in LABELS:
        return f"{LABELS[name]}{comma}{variant}"

    for label in LABELS.values():
        if controller == label or controller.startswith(f"{label}, "):
            return f'"{controller}"'
    return controller


def colour_of(controller: str, others: int = 0) -> str:
    """Return the colour of a law; one without a colour takes number ``others`` of ``OTHERS``."""
    return COLOURS.get(controller, OTHERS[others % len(OTHERS)])


class LawStyle(NamedTuple):
    """Name, colour and line style of a law in figures.

    Attributes:
        label: Name for people.
        colour: Colour as #RRGGBB.
        line: Matplotlib's line style.
    """

    label: str
    colour: str
    line: str | tuple[float, tuple[float, ...]]


def law_styles(laws: Iterable[str]) -> dict[str, LawStyle]:
    """Return a style for each law; laws without a colour take those of ``OTHERS`` in turn."""
    styles: dict[str, LawStyle] = {}
    without_colour = 0
    for number, law in enumerate(dict.fromkeys(laws)):
        line = _DASHES[number % len(_DASHES)]
        styles[law] = LawStyle(label_of(law), colour_of(law, without_colour), line)
        if law not in COLOURS:
            without_colour += 1
    return styles


def red_green_blue(colour: str) -> tuple[float, float, float]:
    """Return the three parts of a colour #RRGGBB as numbers from 0 to 1."""
    red = int(colour[1:3], 16) / 255
    green = int(colour[3:5], 16) / 255
    blue = int(colour[5:7], 16) / 255
    return (red, green, blue)
