"""Colours that figures and films share: Okabe and Ito's, then Tol's, for the colour-blind too."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

# Okabe and Ito's, with a softer black.
BLACK, ORANGE, SKY, GREEN = "#222222", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"

COLOURS = {
    "lqr": VERMILION,
    "fl-lqr": PURPLE,
    "grosmc": BLUE,
    "pd": ORANGE,
    "lqi": "#661100",
    "pid": "#888888",
    "adrc": "#117733",
    "cart-lqr": "#999933",
    "cart-ism": SKY,
    "cart-pfl": "#882255",
}
LABELS = {
    "lqr": "LQR",
    "fl-lqr": "FL + LQR",
    "grosmc": "GROSMC",
    "pd": "PD",
    "lqi": "LQI",
    "pid": "PID",
    "adrc": "ADRC",
    "cart-lqr": "4-state LQR",
    "cart-ism": "4-state ISM",
    "cart-pfl": "partial FL",
}
# Controllers that have no colour of their own, in turn.
OTHERS = ("#332288", "#44AA99", "#AA4499", "#DDCC77")

# Line styles that tell laws apart for those who see no colour, in turn.
_DASHES = ("-", (0, (5, 2)), (0, (1, 1.2)), (0, (6, 2, 1, 2)))

# Physics thick, the equations thin on top.
LINES: Mapping[str, Mapping[str, Any]] = {
    "physics": {"lw": 3.2, "alpha": 0.45, "ls": "-"},
    "corrected": {"lw": 1.1, "ls": "--"},
    "printed": {"lw": 1.1, "ls": ":"},
}
PLANTS: Mapping[str, str] = {
    "physics": "MuJoCo",
    "corrected": "corrected equations",
    "printed": "printed equations",
}

# What was asked for: kept, not kept, or not decided.
KEPT, FAILED, OPEN = GREEN, VERMILION, ORANGE
# Colours of words that are verdicts, in lower case.
VERDICT_COLOURS = {
    "supported": KEPT, "kept": KEPT, "holds": KEPT,
    "refuted": FAILED, "premise not met": FAILED, "not kept": FAILED, "fails": FAILED,
    "undetermined": OPEN, "inconclusive": OPEN,
}  # fmt: skip

OPTIMUM = BLACK
DISTURBANCE = GREEN
GRID = "#dddddd"
# The reference, or the nominal optimum, over all curves.
REFERENCE: Mapping[str, Any] = {"color": OPTIMUM, "lw": 1, "ls": (0, (1, 2)), "zorder": 5}


def label_of(controller: str) -> str:
    """A controller's name for people."""
    return LABELS.get(controller, controller)


def colour_of(controller: str, others: int = 0) -> str:
    """The colour of a controller; one that has none takes the one numbered ``others``."""
    return COLOURS.get(controller, OTHERS[others % len(OTHERS)])


class LawStyle(NamedTuple):
    """How a law is drawn.

    Attributes:
        label: Its name for people.
        colour: #RRGGBB.
        line: Matplotlib's line style.
    """

    label: str
    colour: str
    line: str | tuple[float, tuple[float, ...]]


def law_styles(laws: Iterable[str]) -> dict[str, LawStyle]:
    """A style for each law; those without a colour of their own take the others in turn."""
    styles: dict[str, LawStyle] = {}
    others = 0
    for number, law in enumerate(dict.fromkeys(laws)):
        line = _DASHES[number % len(_DASHES)]
        styles[law] = LawStyle(label_of(law), colour_of(law, others), line)
        others += law not in COLOURS
    return styles


def red_green_blue(colour: str) -> tuple[float, float, float]:
    """#RRGGBB as three numbers from 0 to 1."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return (red, green, blue)
