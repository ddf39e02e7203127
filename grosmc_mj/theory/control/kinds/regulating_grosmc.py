"""GROSMC of section 3, for regulation."""

from __future__ import annotations

from numpy.typing import ArrayLike

from grosmc_mj.ground.fields import checked
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.design import regulating_grosmc
from grosmc_mj.theory.control.kinds.kind import OF_EQUATIONS, LawKind
from grosmc_mj.theory.control.task import Task
from grosmc_mj.theory.control.uncertainty.outputs import Uncertainty


@checked(eq=False)
class RegulatingGrosmc(LawKind):
    """GROSMC with gains from the declared uncertainty, eqs. (31)+(37)."""

    key = "regulating-grosmc"
    where = OF_EQUATIONS
    switches = True

    uncertainty: Uncertainty
    G: ArrayLike | None = None

    def design(self, task: Task) -> Controller:
        """Return the law for a task."""
        return regulating_grosmc(task, self.uncertainty, self.G)
