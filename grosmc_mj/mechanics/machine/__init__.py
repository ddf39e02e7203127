"""The machine as built: the parts that a rigid, frictionless model lacks, one file each.

A part is an edit of a model that also knows the timestep it needs and its states.
"""

from __future__ import annotations

from grosmc_mj.mechanics.machine.backlash import Transmission
from grosmc_mj.mechanics.machine.drive_friction import DriveFriction
from grosmc_mj.mechanics.machine.friction import LuGre
from grosmc_mj.mechanics.machine.motor import Motor
from grosmc_mj.mechanics.machine.part import MachinePart
from grosmc_mj.mechanics.machine.stops import Stop, Wall

# All kinds, in the order in which a case file is read.
PARTS = (Transmission, LuGre, DriveFriction, Stop, Motor, Wall)

__all__ = [
    "DriveFriction",
    "LuGre",
    "MachinePart",
    "Motor",
    "Stop",
    "Transmission",
    "Wall",
]
