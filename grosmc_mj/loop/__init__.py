"""The loop as built: what lies between a law and its plant.

Sensors, a computer, estimators and actuators are values (``parts``); ``in_loop`` puts them around a
law, written once for both engines.
"""

from __future__ import annotations

from grosmc_mj.loop.in_loop import in_loop, relooped, room_of
from grosmc_mj.loop.loop import Loop
from grosmc_mj.loop.parts import Actuator, Computing, Estimator, Sensor

__all__ = ["Actuator", "Computing", "Estimator", "Loop", "Sensor", "in_loop", "relooped", "room_of"]
