from .coordinates.symbolic import ErrorCoordinates
from .design import computed_torque_pd, linear_lqr
from .references import TIME, Setpoint, Setpoints, reference, setpoints
from .state_design import StateUncertainty, state_grosmc
from .switching import find_switching
from .task import StateTask

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
