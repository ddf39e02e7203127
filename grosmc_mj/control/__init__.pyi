from .coordinates.symbolic import ErrorCoordinates
from .design import computed_torque_pd
from .references import TIME, Setpoint, Setpoints, reference, setpoints
from .switching import find_switching

__all__ = [
    "TIME",
    "ErrorCoordinates",
    "Setpoint",
    "Setpoints",
    "computed_torque_pd",
    "find_switching",
    "reference",
    "setpoints",
]
