"""What a policy sees, by name and with units, and the index that it is paid by."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.matrices import quadratic
from grosmc_mj.plants import System

Observation = Mapping[str, Any]


class Signals:
    """The named entries of an observation.

    They are each state, (1,); ``time``, exactly k T [s], (1,); ``error``, the z that the index
    weighs; and ``reference``, what z is measured from, y_r and its derivatives below r_i.

    Args:
        law: A controller with a design.

    Attributes:
        units: Unit of every entry by its name; of several numbers, one after the other.
        sizes: How many numbers every entry has.
    """

    def __init__(self, law: Controller) -> None:
        self._error, self._parameters = law.designed.error, law.parameters
        of_error, size = ", ".join(self._error.units), self._error.size
        states = {signal.name: signal.unit for signal in self._error.system.states}
        self.units = {**states, "time": "s", "error": of_error, "reference": of_error}
        self.sizes = {**dict.fromkeys(states, 1), "time": 1, "error": size, "reference": size}

    def observe(self, t: float, x: ArrayLike) -> OrderedDict[str, Array]:
        """The observation at a state.

        Args:
            t: Time [s].
            x: State, (n,).

        Returns:
            New arrays by name.
        """
        error, p, state = self._error, self._parameters, np.array(x, float)
        # A law that regulates the whole state has no reference.
        reference = error.reference_along([t], getattr(p, "reference", None))[0]
        states = zip((signal.name for signal in error.system.states), state[:, None], strict=True)
        entries = dict(states) | {"time": np.array([t])}
        return OrderedDict(entries, error=error.error_state(t, state, p), reference=reference)


class Index:
    """J = 1/2 ∫ z'Qz + v'Rv dt of eqs. (13), (27) and (48).

    v is u, about its operating point, for a law on the plant's linear model, and alpha + E u of
    eqs. (23) and (44) after feedback linearization.

    Args:
        law: A controller with error coordinates and the optimum that it was designed for.
    """

    def __init__(self, law: Controller) -> None:
        self._p, self._design = law.parameters, law.designed
        self._memory, self._kept_alive = law.begin()
        _, self._v = self._design.error.input_maps(linearizing=self._design.linearizing)

    def defined(self, x: Array) -> bool:
        """Whether a state is in the region that the index is defined in."""
        return not self._design.linearizing or bool(self._design.error.system.linearizable(x))

    def stage_cost(self, t: float, x: Array, u: ArrayLike) -> float:
        """1/2 (z'Qz + v'Rv), in the index's unit per second.

        Args:
            t: Time [s].
            x: State, (n,).
            u: Input, (m,).
        """
        error, optimum, v = self._design.error, self._design.lqr, np.zeros(np.size(u))
        self._v(t, x, np.asarray(u, float), self._memory, self._p, v)
        z = error.error_state(t, x, self._p)
        return float(0.5 * (quadratic(z, optimum.Q) + quadratic(v, optimum.R)))


def input_label(system: System) -> str:
    """The inputs with their units: ``force [N]``."""
    return ", ".join(f"{signal.name} [{signal.unit}]" for signal in system.inputs)
