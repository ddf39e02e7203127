from .coordinates.symbolic import ErrorCoordinates
from .design import computed_torque_pd, linear_lqr, state_grosmc
from .references import TIME, Setpoint, Setpoints, reference, setpoints
from .switching import find_switching
from .task import StateTask
from .uncertainty import StateUncertainty

__all__ = [
    "TIME",
    "ErrorCoordinates",
    "Setpoint",
    "Setpoints",
    "StateTask",
    "StateUncertainty",
    "computed_torque_pd",
    "find_switching",
    "linear_lqr",
    "reference",
    "setpoints",
    "state_grosmc",
]
