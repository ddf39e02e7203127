"""The loop as built: what lies between a law and its plant.

Sensors, a computer, estimators and actuators are values; ``simulate`` takes them as its ``loop``,
and the kernel runs their stages around the law.
"""

from __future__ import annotations

from grosmc_mj.simulation.loop.actuators import Actuator
from grosmc_mj.simulation.loop.applied import AppliedLoop, apply_loop
from grosmc_mj.simulation.loop.computer import Computing
from grosmc_mj.simulation.loop.estimators import Estimator
from grosmc_mj.simulation.loop.loop import Loop
from grosmc_mj.simulation.loop.sensors import Sensor

__all__ = [
    "Actuator",
    "AppliedLoop",
    "Computing",
    "Estimator",
    "Loop",
    "Sensor",
    "apply_loop",
]
