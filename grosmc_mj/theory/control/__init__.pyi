from .coordinates.symbolic import ErrorCoordinates
from .design import computed_torque_pd, linear_lqr, realized, state_grosmc
from .references import TIME, Setpoint, Setpoints, reference, setpoints
from .switching import find_switching
from .task import state_task
from .uncertainty.states import StateUncertainty

__all__ = [
    "TIME",
    "ErrorCoordinates",
    "Setpoint",
    "Setpoints",
    "StateUncertainty",
    "computed_torque_pd",
    "find_switching",
    "linear_lqr",
    "realized",
    "reference",
    "setpoints",
    "state_grosmc",
    "state_task",
]
