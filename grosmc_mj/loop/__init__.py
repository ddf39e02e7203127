"""The loop as built: what lies between a law and its plant.

Sensors, a computer, estimators and actuators are values; ``in_loop`` attaches them to a controller,
and the kernel runs their stages around its law.
"""

from __future__ import annotations

from grosmc_mj.loop.actuators import Actuator
from grosmc_mj.loop.controllers import in_loop, relooped
from grosmc_mj.loop.delay import Computing
from grosmc_mj.loop.estimators import Estimator
from grosmc_mj.loop.loop import Loop
from grosmc_mj.loop.sensors import Sensor

__all__ = ["Actuator", "Computing", "Estimator", "Loop", "Sensor", "in_loop", "relooped"]
