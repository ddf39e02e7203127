"""Colours that figures and films share: Okabe and Ito's, then Tol's, for the colour-blind too."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

COLOURS = {
    "lqr": "#D55E00",
    "fl-lqr": "#CC79A7",
    "grosmc": "#0072B2",
    "pd": "#E69F00",
    "cart-lqr": "#999933",
    "cart-ism": "#56B4E9",
    "cart-pfl": "#882255",
}
LABELS = {
    "lqr": "LQR",
    "fl-lqr": "FL + LQR",
    "grosmc": "GROSMC",
    "pd": "PD",
    "cart-lqr": "4-state LQR",
    "cart-ism": "4-state ISM",
    "cart-pfl": "partial FL",
}
# Controllers that have no colour of their own, in turn.
OTHERS = ("#332288", "#44AA99", "#AA4499", "#DDCC77")

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

OPTIMUM = "#222222"
DISTURBANCE = "#009E73"
GRID = "#dddddd"


def colour_of(controller: str, others: int = 0) -> str:
    """The colour of a controller; one that has none takes the one numbered ``others``."""
    return COLOURS.get(controller, OTHERS[others % len(OTHERS)])


def red_green_blue(colour: str) -> tuple[float, float, float]:
    """#RRGGBB as three numbers from 0 to 1."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return (red, green, blue)
