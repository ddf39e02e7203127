"""Colours that figures and films share: Okabe and Ito's, told apart by the colour-blind."""

from __future__ import annotations

COLOURS = {"lqr": "#D55E00", "fl-lqr": "#CC79A7", "grosmc": "#0072B2"}
LABELS = {"lqr": "LQR", "fl-lqr": "FL + LQR", "grosmc": "GROSMC"}
# Controllers beyond those of the chapter, in turn.
OTHERS = ("#E69F00", "#56B4E9", "#882255", "#999933")

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
