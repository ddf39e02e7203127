"""grosmc-mj view."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.targets import TARGET, shown_experiment
from grosmc_mj.errors import ArgumentError, DivergenceError, SetupError

if TYPE_CHECKING:
    from grosmc_mj.viewer.live import LiveRun
    from grosmc_mj.viewer.playback import Motion


@dataclass(frozen=True)
class ViewCommand(Command):
    """Watch a case in MuJoCo's window, and push it.

    The closed loop runs as you watch, in real time and without end, or a recorded run is replayed.

    Keys: space pauses; . shows one picture more; + and - double and halve the speed; backspace
    starts again. Left and right push the uncertain body for 0.2 s (a force along x, or a torque
    where a force moves nothing), up and down make the push stronger and weaker; in a replay left
    and right go 1 s back and on. The mouse turns and moves the picture, [ and ] change the camera,
    Tab shows MuJoCo's own panel. Close the window or press Ctrl-C to end.

    Without a display it says so and names the command that makes a film. On macOS run it with
    mjpython -m grosmc_mj.cli view.

    Attributes:
        target: A system, of which it is case1, a case of the package or a case file.
        controller: One of those that grosmc-mj list shows, or of the file; grosmc by default, or
            a file's last one.
        replay: Whether to record the whole run first, and replay it.
        speed: Seconds of the run in a second.
        switching: Switching law of a system's sliding mode laws, as for validate.
        surface: printed or discrete, as for validate.
    """

    target: Annotated[Positional[str], arg(metavar=TARGET, name="target")]
    controller: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None
    replay: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    speed: Annotated[float, arg(metavar="X")] = 1.0
    switching: Annotated[str, arg(metavar="NAME")] = "sign"
    surface: Annotated[str, arg(metavar="printed|discrete")] = "printed"

    def execute(self) -> int:
        """Prepare the case, open the window."""
        from grosmc_mj.viewer.playback import Playback

        Playback(self.speed)  # refuses a speed that cannot be before anything is compiled
        experiment, film = self._shown()
        return show(experiment, replay=self.replay, speed=self.speed, film=film)

    def _shown(self) -> tuple[LiveRun, str]:
        """What is shown, and the command that films it."""
        from grosmc_mj.experiments.runs import Settings
        from grosmc_mj.viewer.live import LiveRun

        settings = Settings(
            switching=self.switching,
            surface=self.surface,  # pyright: ignore[reportArgumentType]  checked by Settings
        )
        asked = shown_experiment(self.target).with_settings(**settings.changes())
        if asked.nominal.plant.kind != "physics":
            raise ArgumentError(f"{self.target}: it does not run in MuJoCo: nothing to see")
        name = self.controller or asked.controllers[-1]
        law, plant, case = asked.law("physics", name), asked.plant("physics"), asked.case
        period = asked.settings.control_period
        run = LiveRun(plant, law, case.x0, case.duration, case.disturbances, period)
        film = (
            f"grosmc-mj film {self.target} --controllers {name}"
            + (f" --switching {self.switching}" if self.switching != "sign" else "")
            + (f" --surface {self.surface}" if self.surface != "printed" else "")
        )
        return run, film


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
