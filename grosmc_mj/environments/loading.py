"""A case as an environment of dm_control."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Unpack

from grosmc_mj.environments.episode import Episode, EpisodeOptions, Target, refuse_unknown_options
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.errors import SetupError

if TYPE_CHECKING:
    from dm_control.rl.control import Environment


def load(
    target: Target,
    task: str | Experiment | None = None,
    *,
    seed: int | None = None,
    **options: Unpack[EpisodeOptions],
) -> Environment:
    """Load a case as a dm_control environment, with its edits and disturbances.

    A law that runs in it gets the states and inputs that ``simulate`` gives it, bit for bit.

    Args:
        target: ``servo``, ``cart_pendulum``, ``arm`` or ``two_link_arm``; or an experiment,
            ``SYSTEM/CASE``, or the path of a case file, on a model in MuJoCo or on equations.
        task: Name of one of a system's cases, the nominal one by default, or an experiment.
        seed: Of the starts, which ``task.random`` draws; None for other starts each time.
        options: ``control_period``, ``timestep``, ``spread`` and ``action_limit``, numbers in SI
            units or texts such as ``"10 ms"``; see ``EpisodeOptions``.

    Returns:
        The environment; ``environment.task.ended`` says why an episode ended early.

    Raises:
        ModelError: If there is no such system.
        ArgumentError: If there is no such case or option, or a number does not fit.
        SetupError: If dm_control is not installed.
    """
    refuse_unknown_options(options, ["seed"])
    episode = Episode(target, task, **options)
    try:
        with warnings.catch_warnings():
            # Without a display GLFW only warns, and dm_control would take it for rendering.
            warnings.filterwarnings("error", module="glfw")
            from dm_control.rl.control import Environment

            from grosmc_mj.environments.dm_control_face import CasePhysics, CaseTask
    except ImportError as error:
        raise SetupError(
            f"environments need dm_control, which cannot be imported ({error}): pip install "
            "dm_control with Python 3.12 or older, or use the Gymnasium environments"
        ) from error
    physics = CasePhysics(episode)
    task_of_episode = CaseTask(episode, seed)
    return Environment(physics, task_of_episode, n_sub_steps=episode.problem.stride)
