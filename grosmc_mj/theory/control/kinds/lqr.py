"""LQR on the plant's linearization; on a robot with an actuator for each joint computed torque."""

from __future__ import annotations

from grosmc_mj.ground.fields import checked
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.design import linear_lqr, linearized_lqr
from grosmc_mj.theory.control.kinds.kind import OF_EQUATIONS, LawKind, Where
from grosmc_mj.theory.control.task import Task


@checked()
class Lqr(LawKind):
    """LQR (5) on the linearization about zero error, or about the operating point."""

    key = "lqr"
    where = OF_EQUATIONS | {Where.UNDERACTUATED}
    linearizing = False

    @classmethod
    def holds_states(cls, where: Where, *, follows: bool) -> bool:
        """Whether there is an operating point."""
        return where in (Where.AT_REST, Where.UNDERACTUATED)

    def design(self, task: Task) -> Controller:
        """Return the law for a task."""
        return linear_lqr(task)


@checked()
class ComputedTorqueLqr(LawKind):
    """LQR of a robot that has an actuator for each joint: computed torque."""

    key = "lqr"
    where = frozenset({Where.COMPUTED_TORQUE})

    def design(self, task: Task) -> Controller:
        """Return the law for a task."""
        return linearized_lqr(task, name=self.key)
