"""A law as a policy of any environment, and a policy as a controller, judged as the laws are."""

from __future__ import annotations

from typing import Any

import numpy as np

from grosmc_mj.environments.signals import Index, Observation, Signals, input_label
from grosmc_mj.ground.arguments import reals
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, UndefinedLawError
from grosmc_mj.simulation.law_inputs import sample_law
from grosmc_mj.theory.control.controller import Controller, Sampled, custom_controller
from grosmc_mj.theory.plants import System, find_system


class LawPolicy:
    """A controller's law, called with observations; its memory starts anew at time 0.

    Args:
        controller: The controller.
        system: Its plant, which names the states.
        control_period: Of the environment [s].
    """

    def __init__(self, controller: Controller, system: System, control_period: float) -> None:
        self._controller = controller.sampled(control_period)
        self._names = ["time", *(signal.name for signal in system.states)]
        self._u = np.zeros(len(system.inputs))
        self.reset()

    def reset(self) -> None:
        """Forget the run so far."""
        self._memory = self._controller.memory()
        self._last = np.nan

    def __call__(self, observation: Observation) -> Array:
        """Return the law's inputs, (m,).

        Args:
            observation: As the environments give it, or any mapping of ``time`` and the states'
                names to numbers.

        Raises:
            ArgumentError: If an entry is missing, or the sampling is not what the law needs.
            UndefinedLawError: If the law is not defined at this state.
        """
        t, *x = self._numbers(observation)
        if t == 0:
            self.reset()
        self._require_period(t)
        self._last = t

        sample_law(self._controller, t, np.array(x), self._memory, self._u)
        if self._memory.undefined:
            name = self._controller.name
            raise UndefinedLawError(f"t = {t:g} s: {name} is undefined at this state", t)
        return self._u.copy()

    def _numbers(self, observation: Observation) -> list[float]:
        """Time and states of an observation."""
        try:
            return [np.asarray(observation[name], float).item() for name in self._names]
        except (KeyError, TypeError, ValueError, IndexError):
            raise ArgumentError(
                f"the observation must map {', '.join(self._names)} to one number each: give the "
                "named observation, neither flattened nor batched"
            ) from None

    def _require_period(self, t: float) -> None:
        """Refuse an instant that does not follow the last one by the law's control period."""
        design = self._controller.design
        p = self._controller.parameters
        needed = None
        if isinstance(p, Sampled):
            needed = p.period
        elif design is not None:
            needed = design.control_period

        period = t - self._last
        # Differences of instants are rounded in the instants' last place.
        if needed is not None and abs(period - needed) > 1e-9 * max(1.0, t):
            raise ArgumentError(
                f"{self._controller.name} is for a control period of {needed:g} s, not {period:g} "
                f"s: load the environment, or make the policy, with control_period={needed:g}"
            )


def law_policy(
    controller: Controller, system: str | None = None, *, control_period: float = 1e-3
) -> LawPolicy:
    """A law as a policy ``policy(observation) -> action``, for dm_control and Gymnasium alike.

    A law in a loop is taken without it: that is the environment's.

    Args:
        controller: Any controller.
        system: Its system's name; needed if the controller has no design.
        control_period: Of the environment [s], which a law of one's own may read.

    Raises:
        ArgumentError: If the system is not known, or the controller has no design.
    """
    if system is None:
        return LawPolicy(controller, controller.designed.error.system, control_period)
    return LawPolicy(controller, find_system(system), control_period)


class PolicyLaw:
    """A law (t, x, memory, p, u) that asks a policy.

    Args:
        policy: A function of an observation, or an object with ``predict(observation)``.
        like: The controller whose error coordinates are observed, and whose index is to be defined.
    """

    python_only = True

    def __init__(self, policy: Any, like: Controller) -> None:
        self._policy = policy
        self._predict = getattr(policy, "predict", None)
        self._signals = Signals(like)
        self._index = Index(like)
        self._label = input_label(like.designed.error.system)

    def __call__(self, t: float, x: Array, memory: Any, p: Any, u: Array) -> None:
        """Write the policy's inputs, (m,); one with a memory is reset where a run begins."""
        if t == 0 and hasattr(self._policy, "reset"):
            self._policy.reset()
        memory.undefined = float(not self._index.defined(x))
        if memory.undefined:
            return
        observation = self._signals.observe(t, x)
        try:
            action = self._action(observation)
        except UndefinedLawError:
            memory.undefined = 1.0
            return
        if action is None or np.size(reals(action)) != len(u):
            raise ArgumentError(
                f"the policy returned {action!r}, must return {len(u)} number(s): {self._label}"
            )
        u[:] = reals(action).reshape(u.shape)

    def _action(self, observation: Observation) -> Any:
        """The policy's answer; a model that predicts returns its state, too."""
        if self._predict is None:
            return self._policy(observation)
        prediction = self._predict(observation)
        if isinstance(prediction, tuple):
            return prediction[0]
        return prediction


def policy_controller(policy: Any, like: Controller, *, name: str = "") -> Controller:
    """Controller that asks a policy, for ``simulate(..., engine="python")``.

    Its runs have the error coordinates and the optimum of ``like``, so that
    ``compare_with_optimum`` and ``metrics_of_rows`` work as for a law. A policy with a ``reset()``
    is reset where a run begins. Where the index of ``like`` is undefined, so is the policy.

    Args:
        policy: Called with an observation as the environments give it, returns an action, (m,), in
            the units of the system's inputs. Or an object with
            ``predict(observation) -> (action, state)``, called without further arguments.
        like: A controller of the same system and design, such as
            ``chapter_controller("grosmc", nominal)``.
        name: Of the controller; by default what the policy is called.

    Raises:
        ArgumentError: If the policy can't be called, or ``like`` has no index. A run raises it for
            an action of the wrong shape, and LawError with file and line for an error of the
            policy's own.
    """
    if not (callable(policy) or hasattr(policy, "predict")):
        raise ArgumentError(
            f"a {type(policy).__name__} is no policy: give a function of an observation, or an "
            "object with predict(observation)"
        )
    called = name or getattr(policy, "__name__", type(policy).__name__)
    return custom_controller(called, PolicyLaw(policy, like), like)
