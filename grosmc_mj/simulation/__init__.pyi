from .disturbances import Constant, SineFrom
from .linearization import linearize
from .loop import Actuator, Computing, Estimator, Loop, Sensor
from .loop.in_loop import in_loop
from .machine import LuGre, Motor, SlidingLoad, Stop, SwingingLoad, Transmission, Wall
from .models.files import load_model
from .trajectory import Status

__all__ = [
    "Actuator",
    "Computing",
    "Constant",
    "Estimator",
    "Loop",
    "LuGre",
    "Motor",
    "Sensor",
    "SineFrom",
    "SlidingLoad",
    "Status",
    "Stop",
    "SwingingLoad",
    "Transmission",
    "Wall",
    "in_loop",
    "linearize",
    "load_model",
]
