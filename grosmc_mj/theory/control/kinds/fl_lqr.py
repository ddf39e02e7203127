"""LQR on feedback linearization."""

from __future__ import annotations

from grosmc_mj.ground.fields import checked
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.design import linearized_lqr
from grosmc_mj.theory.control.kinds.kind import OF_EQUATIONS, LawKind
from grosmc_mj.theory.control.task import Task


@checked()
class FlLqr(LawKind):
    """Feedback linearization with LQR only, eqs. (23)+(28) and (44)+(49)."""

    key = "fl-lqr"
    where = OF_EQUATIONS

    def design(self, task: Task) -> Controller:
        """Return the law for a task."""
        return linearized_lqr(task)
