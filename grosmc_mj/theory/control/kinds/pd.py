"""Computed torque with PD."""

from __future__ import annotations

from grosmc_mj.ground.fields import checked
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.design import Damping, PdFrequency, computed_torque_pd
from grosmc_mj.theory.control.kinds.kind import OF_OUTPUTS, LawKind
from grosmc_mj.theory.control.task import Task


@checked()
class Pd(LawKind):
    """Feedback linearization with the same two poles for every output."""

    key = "pd"
    where = OF_OUTPUTS
    follows_weights = False

    frequency: PdFrequency
    damping: Damping = 1.0

    def design(self, task: Task) -> Controller:
        """Return the law for a task."""
        return computed_torque_pd(task, self.frequency, self.damping)
