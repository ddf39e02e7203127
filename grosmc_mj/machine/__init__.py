"""The machine as built: what a rigid, frictionless model leaves out.

``parts`` are values; ``building`` writes them into a model as edits, ``motors`` those that drive a
joint; ``stability`` says what timestep they need, ``unseen`` what of their states no law sees.
"""

from __future__ import annotations

from grosmc_mj.machine.parts import (
    LuGre,
    MachinePart,
    Motor,
    SlidingLoad,
    Stop,
    SwingingLoad,
    Transmission,
    Wall,
)

__all__ = [
    "LuGre",
    "MachinePart",
    "Motor",
    "SlidingLoad",
    "Stop",
    "SwingingLoad",
    "Transmission",
    "Wall",
]
