"""The observation of a policy, by name and with units, and the index that gives its reward."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.wording import titled
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.matrices import quadratic
from grosmc_mj.theory.plants import System

Observation = Mapping[str, Any]


class Signals:
    """The named entries of an observation.

    They are each state, (1,); ``time``, exactly k T [s], (1,); ``error``, the z that the index
    weighs; and ``reference``, from which z is measured, y_r and its derivatives below r_i.

    Args:
        law: A controller with a design.

    Attributes:
        units: Unit of every entry by its name; of several numbers, one after the other.
        sizes: How many numbers every entry has.
    """

    def __init__(self, law: Controller) -> None:
        self._error = law.designed.error
        self._parameters = law.parameters
        units = ", ".join(self._error.units)
        size = self._error.size
        states = {signal.name: signal.unit for signal in self._error.system.states}
        self.units = {**states, "time": "s", "error": units, "reference": units}
        self.sizes = {**dict.fromkeys(states, 1), "time": 1, "error": size, "reference": size}

    def observe(self, t: float, x: ArrayLike) -> OrderedDict[str, Array]:
        """Return the observation at a state.

        Args:
            t: Time [s].
            x: State, (n,).

        Returns:
            New arrays by name.
        """
        error = self._error
        p = self._parameters
        state = np.array(x, float)
        entries = OrderedDict[str, Array]()
        for signal, value in zip(error.system.states, state[:, None], strict=True):
            entries[signal.name] = value
        entries["time"] = np.array([t])
        entries["error"] = error.error_state(t, state, p)
        # A law that regulates the whole state has no reference.
        entries["reference"] = error.reference_along([t], getattr(p, "reference", None))[0]
        return entries


class Index:
    """J = 1/2 ∫ z'Qz + v'Rv dt of eqs. (13), (27) and (48).

    v is u, about its operating point, for a law on the plant's linear model, and alpha + E u of
    eqs. (23) and (44) after feedback linearization.

    Args:
        law: A controller with error coordinates and the optimum that it was designed for.

    Raises:
        ArgumentError: If nobody has chosen its weights.
    """

    def __init__(self, law: Controller) -> None:
        self._p = law.parameters
        self._design = law.designed
        if not self._design.weighed:
            raise ArgumentError(
                f"{law.name} has no weights, so there is no index: give [task] Q and R"
            )
        self._memory = law.memory()
        _, self._v = self._design.error.input_maps(linearizing=self._design.linearizing)

    def defined(self, x: Array) -> bool:
        """Whether a state is in the region that the index is defined in."""
        if not self._design.linearizing:
            return True
        return bool(self._design.error.system.linearizable(x))

    def stage_cost(self, t: float, x: Array, u: ArrayLike) -> float:
        """Return 1/2 (z'Qz + v'Rv), in the index's unit per second.

        Args:
            t: Time [s].
            x: State, (n,).
            u: Input, (m,).
        """
        v = np.zeros(np.size(u))
        self._v(t, x, np.asarray(u, float), self._memory, self._p, v)
        z = self._design.error.error_state(t, x, self._p)
        optimum = self._design.lqr
        return float(0.5 * (quadratic(z, optimum.Q) + quadratic(v, optimum.R)))


def input_label(system: System) -> str:
    """The inputs with their units: ``force [N]``."""
    return ", ".join(titled(signal.name, signal.unit) for signal in system.inputs)
