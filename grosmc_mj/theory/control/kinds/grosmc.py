"""GROSMC of section 4, for tracking."""

from __future__ import annotations

from numpy.typing import ArrayLike

from grosmc_mj.ground.fields import checked
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.design import ReachingGain, SwitchingGain, tracking_grosmc
from grosmc_mj.theory.control.kinds.kind import OF_OUTPUTS, LawKind
from grosmc_mj.theory.control.task import Task


@checked(eq=False)
class Grosmc(LawKind):
    """GROSMC with given gains, eqs. (51)+(55); ``G`` projects the surface."""

    key = "grosmc"
    where = OF_OUTPUTS
    switches = True

    k: ReachingGain
    epsilon: SwitchingGain
    G: ArrayLike | None = None

    def design(self, task: Task) -> Controller:
        """Return the law for a task."""
        return tracking_grosmc(task, self.k, self.epsilon, self.G)
