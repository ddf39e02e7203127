"""What a policy sees, by name and with units: the same in every face of a plant."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, unknown_name
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
        error = law.designed.error
        self._error, self._parameters = error, law.parameters
        self.system: System = error.system
        self._names = state_names(self.system)
        states = {signal.name: signal.unit for signal in self.system.states}
        of_error = ", ".join(error.units)
        self.units = {**states, "time": "s", "error": of_error, "reference": of_error}
        size = error.size
        self.sizes = {**dict.fromkeys(states, 1), "time": 1, "error": size, "reference": size}

    def observe(self, t: float, x: ArrayLike) -> OrderedDict[str, Array]:
        """The observation at a state.

        Args:
            t: Time [s].
            x: State, (n,).

        Returns:
            New arrays by name.
        """
        error, p = self._error, self._parameters
        state = np.asarray(x, float)
        seen = OrderedDict((name, state[i : i + 1].copy()) for i, name in enumerate(self._names))
        seen["time"] = np.array([t])
        seen["error"] = error.error_state(t, state, p)
        # A law that regulates the whole state has no reference.
        seen["reference"] = error.reference_along([t], getattr(p, "reference", None))[0]
        return seen

    def labelled(self, name: str) -> str:
        """An entry's name with its unit: ``pole angle [rad]``."""
        return f"{name} [{self.units[name]}]"


def state_names(system: System) -> tuple[str, ...]:
    """Names of the states' entries."""
    return tuple(signal.name for signal in system.states)


def input_label(system: System) -> str:
    """The inputs with their units: ``force [N]``."""
    return ", ".join(f"{signal.name} [{signal.unit}]" for signal in system.inputs)


def seen_state(names: tuple[str, ...], observation: Observation) -> tuple[float, Array]:
    """Time [s] and state (n,) from an observation.

    Raises:
        ArgumentError: If an entry is missing or has not one number.
    """
    try:
        values = [np.asarray(observation[name], float).reshape(()) for name in ("time", *names)]
    except KeyError as error:
        raise ArgumentError(
            unknown_name("observation, wanted", error.args[0], map(str, observation))
        ) from None
    except (TypeError, ValueError, IndexError):
        raise ArgumentError(
            f"the observation must map time, {', '.join(names)} to one number each: give the "
            "named observation, neither flattened nor batched"
        ) from None
    return float(values[0]), np.array(values[1:])
