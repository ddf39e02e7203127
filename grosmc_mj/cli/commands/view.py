"""grosmc-mj view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro
from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.targets import TARGET, shown_experiment
from grosmc_mj.errors import ArgumentError, SetupError


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
        from grosmc_mj.experiments.runs import Settings
        from grosmc_mj.viewer import Live, Motion, Playback, RecordedRun, play, require_display

        Playback(self.speed)  # refuses a speed that cannot be before anything is compiled
        settings = Settings(
            switching=self.switching,
            surface=self.surface,  # pyright: ignore[reportArgumentType]  checked by Settings
        )
        asked = shown_experiment(self.target).with_settings(**settings.changes())
        if asked.nominal.plant.kind != "physics":
            raise ArgumentError(f"{self.target}: it does not run in MuJoCo: nothing to see")
        name = self.controller or asked.controllers[-1]
        law, plant, case = asked.law("physics", name), asked.plant("physics"), asked.case
        try:
            require_display()
        except SetupError as error:
            raise SetupError(f"{error}; for a film of it run: {self._film(name)}") from error
        motion: Motion
        if self.replay:
            result = asked.run("physics", name)
            motion = RecordedRun(plant.model, result.trajectory, result.ended)
        else:
            period = asked.settings.control_period
            motion = Live(
                plant, law, case.x0, duration=case.duration, disturbances=case.disturbances,
                control_period=period,
            )  # fmt: skip
        play(motion, speed=self.speed, say=screen.notice)
        return screen.DONE

    def _film(self, name: str) -> str:
        """The command that films it."""
        return (
            f"grosmc-mj film {self.target} --controllers {name}"
            + (f" --switching {self.switching}" if self.switching != "sign" else "")
            + (f" --surface {self.surface}" if self.surface != "printed" else "")
        )
