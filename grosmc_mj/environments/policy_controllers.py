"""A policy as a controller: judged by the same claims and metrics as the laws."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, NoReturn, get_args

import numpy as np

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller, Design
from grosmc_mj.control.memory import Memory
from grosmc_mj.environments.reward import Index
from grosmc_mj.environments.signals import Observation, Signals, input_label
from grosmc_mj.errors import (
    ArgumentError,
    GrosmcError,
    PolicyError,
    SetupError,
    UndefinedLawError,
)

if TYPE_CHECKING:
    import dm_env

Takes = Literal["observation", "time_step"]


@dataclass
class PolicyMemory(Memory):
    """What a run under a policy remembers.

    Attributes:
        v: What the index weighs of the input commanded, (m,).
        samples: Actions asked for so far.
    """

    v: Any = field(default_factory=lambda: np.zeros(1))
    samples: float = 0.0


class TimeSteps:
    """Makes the time steps that the environment of the same case would give.

    Args:
        index: Gives the reward.

    Raises:
        SetupError: If dm_env is not installed.
    """

    def __init__(self, index: Index) -> None:
        try:
            import dm_env
        except ImportError as error:
            raise SetupError("time steps need dm_env: pip install dm_env") from error
        self._make, self._index = dm_env, index
        self.restart()

    def restart(self) -> None:
        """Begin a run."""
        self._last: tuple[float, float] | None = None

    def at(self, t: float, observation: Mapping[str, Any]) -> dm_env.TimeStep:
        """The time step at an instant [s]: the first of a run, or one with the reward so far."""
        if self._last is None:
            return self._make.restart(observation)
        before, cost = self._last
        return self._make.transition(-(t - before) * cost, observation)

    def book(self, t: float, x: Array, u: Array) -> None:
        """Keep what the next time step's reward is made of."""
        self._last = (t, self._index.stage_cost(t, x, u))


class PolicyLaw:
    """A law (t, x, memory, p, u) that asks a policy.

    Args:
        policy: What is asked.
        like: The controller whose error coordinates and index the run is measured in.
        takes: What the policy is called with.
        name: What it is called in messages.
    """

    python_only = True

    def __init__(self, policy: Any, like: Controller, takes: Takes, name: str) -> None:
        self._policy, self._name = policy, name
        self._signals, self._index = Signals(like), Index(like)
        self._ask: Callable[[Any], Any] = _predicting(policy) or policy
        self._time_steps = TimeSteps(self._index) if takes == "time_step" else None

    def __call__(self, t: float, x: Array, memory: PolicyMemory, p: Any, u: Array) -> None:
        """Write the policy's inputs, (m,)."""
        if memory.samples == 0:
            self._restart()
        memory.samples += 1.0
        u[:] = 0.0
        if not self._index.defined(x):
            memory.undefined = 1.0
            return
        seen: Any = self._signals.observe(t, x)
        if self._time_steps is not None:
            seen = self._time_steps.at(t, seen)
        try:
            u[:] = self._checked(self._ask(seen), len(u))
        except UndefinedLawError:
            memory.undefined = 1.0
            return
        except GrosmcError:
            raise
        except Exception as error:
            self._point_at(error, t)
        if self._time_steps is not None:
            self._time_steps.book(t, x, u)
        memory.v[:] = self._index.weighed(t, x, u)

    def _restart(self) -> None:
        """Tell a policy with a memory of its own that a run begins."""
        if self._time_steps is not None:
            self._time_steps.restart()
        reset = getattr(self._policy, "reset", None)
        if callable(reset):
            reset()

    def _checked(self, action: Any, m: int) -> Array:
        """An action as (m,) numbers; those that are not finite end the run as diverged."""
        try:
            # NumPy would take None for NaN.
            u = np.zeros(0) if action is None else np.asarray(action, float)
        except (TypeError, ValueError):
            u = np.zeros(0)
        if u.shape != (m,) and not (m == 1 and u.shape == ()):
            units = input_label(self._signals.system)
            raise ArgumentError(
                f"policy {self._name} returned a {type(action).__name__} of shape {np.shape(u)}, "
                f"must return {m} number(s) in an array of shape ({m},): {units}"
            )
        return u.reshape(m)

    def _point_at(self, error: Exception, t: float) -> NoReturn:
        """Raise one line that says where in the user's code an error comes from.

        Raises:
            PolicyError: Always.
        """
        frames = traceback.extract_tb(error.__traceback__)[1:]
        # The innermost line in the file that the policy is in, not in a library that it calls.
        own = [frame for frame in frames if frame.filename == frames[0].filename]
        where = f" at {own[-1].filename}:{own[-1].lineno}" if own else " when it was called"
        said = " ".join(str(error).split())
        raise PolicyError(
            f"policy {self._name} raised {type(error).__name__}: {said}{where} (t = {t:g} s)"
        ) from error


def policy_controller(
    policy: Any,
    like: Controller,
    *,
    takes: Takes = "observation",
    name: str = "",
) -> Controller:
    """A policy as a controller, for ``simulate(..., engine="python")``.

    Its runs have the error coordinates and the optimum of ``like``, so that
    ``compare_with_optimum`` and ``measure`` work as for a law. A policy with a ``reset()`` is
    reset where a run begins. Where the index of ``like`` is undefined, so is the policy.

    Args:
        policy: Called with an observation as the environments give it (or a dm_env time step),
            returns an action, (m,), in the units of the system's inputs. Or an object with
            ``predict(observation) -> (action, state)``, called without further arguments.
        like: A controller of the same system and design, such as
            ``chapter_controller("grosmc", nominal)``.
        takes: ``observation``, or ``time_step`` for a dm_env time step.
        name: Of the controller; by default what the policy is called.

    Raises:
        ArgumentError: If the policy can't be called, or ``like`` has no index. A run raises it
            for an action of the wrong shape, and PolicyError with file and line for an error
            of the policy's own.
    """
    require_known("form of observation", takes, get_args(Takes))
    if not (callable(policy) or _predicting(policy)):
        raise ArgumentError(
            f"a {type(policy).__name__} is no policy: give a function of an observation, or an "
            "object with predict(observation)"
        )
    called = name or getattr(policy, "__name__", type(policy).__name__)
    law = PolicyLaw(policy, like, takes, called)
    design = like.designed
    return Controller(
        name=called,
        law=law,
        parameters=like.parameters,
        memory=partial(_memory, design.error.inputs),
        design=Design(
            design.error,
            design.lqr,
            source="a policy",
            linearizing=design.linearizing,
            follows_optimum=False,
        ),
    )


def _memory(m: int) -> PolicyMemory:
    """The memory of a run with m inputs."""
    return PolicyMemory(v=np.zeros(m))


def _predicting(policy: Any) -> Callable[[Observation], Any] | None:
    """How to ask an object with ``predict``; None if it has none."""
    predict = getattr(policy, "predict", None)
    if not callable(predict):
        return None

    def ask(observation: Observation) -> Any:
        answer = predict(observation)
        return answer[0] if isinstance(answer, tuple) else answer

    return ask
