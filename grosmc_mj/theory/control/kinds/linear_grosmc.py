"""GROSMC of section 2, on the linearization."""

from __future__ import annotations

from numpy.typing import ArrayLike

from grosmc_mj.ground.fields import checked
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.design import NO_UNCERTAINTY, linear_grosmc, state_grosmc
from grosmc_mj.theory.control.kinds.kind import LawKind, Where
from grosmc_mj.theory.control.task import Limit, Task
from grosmc_mj.theory.control.uncertainty.outputs import Uncertainty
from grosmc_mj.theory.control.uncertainty.states import StateUncertainty


@checked(eq=False)
class LinearGrosmc(LawKind):
    """GROSMC on the linearization about zero error, eqs. (8)+(12)."""

    key = "linear-grosmc"
    where = frozenset({Where.EQUATIONS})
    linearizing = False
    switches = True

    uncertainty: Uncertainty
    G: ArrayLike | None = None

    def design(self, task: Task) -> Controller:
        """Return the law for a task."""
        return linear_grosmc(task, self.uncertainty, self.G)


@checked(eq=False)
class StateGrosmc(LawKind):
    """GROSMC on all states about an operating point: the surface (8) and the law (12)."""

    key = "linear-grosmc"
    where = frozenset({Where.AT_REST})
    linearizing = False
    switches = True
    takes_limits = True

    uncertainty: StateUncertainty = NO_UNCERTAINTY
    G: ArrayLike | None = None
    limit: Limit | None = None

    @classmethod
    def holds_states(cls, where: Where, *, follows: bool) -> bool:
        """Return True: it is a law of all states."""
        return True

    def design(self, task: Task) -> Controller:
        """Return the law for a task."""
        return state_grosmc(task, self.uncertainty, self.G, self.limit)


@checked(eq=False)
class UnderactuatedGrosmc(StateGrosmc):
    """GROSMC of a robot with fewer actuators than joints: there is no other one."""

    key = "grosmc"
    where = frozenset({Where.UNDERACTUATED})
