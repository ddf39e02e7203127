"""A case as an environment of dm_control."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from grosmc_mj.environments.episode import EpisodeSetup
from grosmc_mj.errors import SetupError
from grosmc_mj.experiments.experiment import Experiment

if TYPE_CHECKING:
    from dm_control.rl.control import Environment


def load(
    target: str,
    task: str | Experiment | None = None,
    *,
    control_period: float | None = None,
    timestep: float | None = None,
    spread: ArrayLike = 0.0,
    action_limit: ArrayLike | None = None,
    seed: int | None = None,
) -> Environment:
    """A case as a dm_control environment, with its edits and disturbances.

    A law that runs in it gets the states and inputs that ``simulate`` gives it, bit for bit.

    Args:
        target: ``servo``, ``cart_pendulum``, ``arm`` or ``two_link_arm``; or ``SYSTEM/CASE``, or
            the path of a case file, on a model in MuJoCo or on equations.
        task: Name of one of a system's cases, the nominal one by default, or an experiment.
        control_period: Time between two actions [s], a multiple of the timestep; the case's own
            by default.
        timestep: Physics timestep [s]; the case's own by default.
        spread: Half widths of the starts about the case's own, (n,), in the states' units, or
            one number for all of them. Starts are drawn uniformly by ``task.random``.
        action_limit: Largest magnitude of each action, (m,) or one number; by default the
            actuators' own limits, which may be none.
        seed: Of the starts; None for others each time.

    Returns:
        The environment; ``environment.task.ended`` says why an episode ended early.

    Raises:
        ModelError: If there is no such system.
        ArgumentError: If there is no such case, or a number does not fit.
        SetupError: If dm_control is not installed.
    """
    setup = EpisodeSetup(
        target,
        task,
        control_period=control_period,
        timestep=timestep,
        spread=spread,
        action_limit=action_limit,
    )
    try:
        with warnings.catch_warnings():
            # Without a display GLFW only warns, and dm_control would take it for rendering.
            warnings.filterwarnings("error", module="glfw")
            from dm_control.rl.control import Environment

            from grosmc_mj.environments.dm_control_face import CaseTask, physics_of
    except ImportError as error:
        raise SetupError(
            f"environments need dm_control, which cannot be imported ({error}): pip install "
            "dm_control with Python 3.12 or older, or use the Gymnasium environments"
        ) from error
    physics, case = physics_of(setup), CaseTask(setup, seed)
    return Environment(physics, case, n_sub_steps=setup.problem.stride)
