"""grosmc-mj view."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from grosmc_mj.cli import screen
from grosmc_mj.cli.commands import View
from grosmc_mj.errors import ArgumentError, DivergenceError, SetupError, unknown_name

if TYPE_CHECKING:
    from grosmc_mj.viewer.live import LiveRun
    from grosmc_mj.viewer.playback import Motion


def view(command: View) -> int:
    """Prepare the case, open the window."""
    from grosmc_mj.viewer.playback import Playback

    Playback(command.speed)  # refuses a speed that cannot be before anything is compiled
    if command.system.endswith(".toml") or "/" in command.system:
        experiment, film = _of_file(command)
    else:
        experiment, film = _of_system(command)
    return show(experiment, replay=command.replay, speed=command.speed, film=film)


def _of_system(command: View) -> tuple[LiveRun, str]:
    """A case of a system of the package, and the command that films it."""
    from grosmc_mj.experiments.experiment import find_experiment
    from grosmc_mj.experiments.runs import Settings
    from grosmc_mj.viewer.live import LiveRun

    settings = Settings(
        switching=command.switching,
        surface=command.surface,  # pyright: ignore[reportArgumentType]  checked by Settings
    )
    found = find_experiment(command.system, command.case or "case1")
    found, name = found.with_settings(**settings.changes()), command.controller or "grosmc"
    case, law, plant = found.case, found.law("physics", name), found.plant("physics")
    experiment = LiveRun(
        plant, law, case.x0, case.duration, case.disturbances, found.settings.control_period
    )
    film = (
        f"grosmc-mj film {case.system} --case {case.name} --controllers {name}"
        + (f" --switching {command.switching}" if command.switching != "sign" else "")
        + (f" --surface {command.surface}" if command.surface != "printed" else "")
    )
    return experiment, film


def _of_file(command: View) -> tuple[LiveRun, str]:
    """A case file, and the command that films it."""
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.viewer.live import LiveRun

    if command.case is not None or command.switching != "sign" or command.surface != "printed":
        raise ArgumentError(
            f"--case, --switching and --surface are for a system: {command.system} says its own"
        )
    found = Experiment.load(command.system)
    plant = found.plants.get("physics")
    if plant is None:
        raise ArgumentError(f"{command.system}: it does not run in MuJoCo: there is nothing to see")
    laws = {name: law for (on, name), law in found.laws.items() if on == "physics"}
    name = command.controller or list(laws)[-1]
    if name not in laws:
        raise ArgumentError(unknown_name("controller", name, laws))
    case, period = found.case, found.settings.control_period
    experiment = LiveRun(plant, laws[name], case.x0, case.duration, case.disturbances, period)
    return experiment, f"grosmc-mj run {command.system} --film"


def show(experiment: LiveRun, *, replay: bool, speed: float, film: str) -> int:
    """Show an experiment in a window until that is closed.

    Args:
        experiment: What runs.
        replay: Whether it is recorded first and then shown.
        speed: Seconds of it in a second.
        film: The command that makes a film of it, offered where there is no display.

    Raises:
        SetupError: If there is no display.
    """
    from grosmc_mj.viewer.viewer import play, require_display

    try:
        require_display()
    except SetupError as error:
        raise SetupError(f"{error}; for a film of it run: {film}") from error
    motion = _recorded(experiment) if replay else _live(experiment)
    play(motion, speed=speed, say=lambda line: print(line, file=sys.stderr))
    return screen.DONE


def _live(experiment: LiveRun) -> Motion:
    from grosmc_mj.viewer.live import Live

    return Live(experiment)


def _recorded(experiment: LiveRun) -> Motion:
    from grosmc_mj.simulation.simulate import simulate
    from grosmc_mj.viewer.replay import RecordedRun

    ended = ""
    try:
        run = simulate(
            experiment.plant,
            experiment.controller,
            experiment.x0,
            duration=experiment.duration,
            control_period=experiment.control_period,
            disturbances=experiment.disturbances,
        )
    except DivergenceError as error:
        run, ended = error.trajectory, str(error)
    return RecordedRun(experiment.plant.model, run, ended)
