from .disturbances import Constant, SineFrom
from .linearization import linearize
from .loop import Actuator, Computing, Estimator, Loop, Sensor, in_loop
from .models import load_model
from .trajectory import Status

__all__ = [
    "Actuator",
    "Computing",
    "Constant",
    "Estimator",
    "Loop",
    "Sensor",
    "SineFrom",
    "Status",
    "in_loop",
    "linearize",
    "load_model",
]
