"""grosmc-mj view."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import Annotated

from cyclopts import Parameter

from grosmc_mj.cli.command import Command, OptionalName, OptionalSurface, Target, command
from grosmc_mj.cli.exit_codes import DONE
from grosmc_mj.cli.targets import shown_experiment
from grosmc_mj.ground.errors import SetupError


@command
class ViewCommand(Command):
    """Watch a case in MuJoCo's window, and pull at it.

    The closed loop runs as you watch, in real time and without end. The window is MuJoCo's own:
    double click chooses a body and Ctrl and the mouse pull it, with a force that the law has to
    cope with; the mouse turns and moves the picture, [ and ] change the camera, Tab shows the
    panels and F1 the other keys. Close the window or press Ctrl-C to end.

    Without a display it says so and names the command that makes a film. On macOS run it with
    mjpython -m grosmc_mj.cli view.

    Attributes:
        target: A system, of which it is case1, a case (SYSTEM/CASE) or a case file (FILE.toml).
        laws: One of those that grosmc-mj list shows, or of the file; grosmc by default, or
            a file's last one.
        speed: Seconds of the run in a second.
        switching: Switching law of a system's sliding mode laws, as for film.
        surface: printed or discrete, as for film.
    """

    target: Target
    _: KW_ONLY
    laws: OptionalName = None
    speed: Annotated[float, Parameter(metavar="X")] = 1.0
    switching: Annotated[OptionalName, Parameter(show_default="the law's own")] = None
    surface: Annotated[OptionalSurface, Parameter(show_default="the law's own")] = None

    def execute(self) -> int:
        """Prepare the case and open the window."""
        from grosmc_mj.output.viewer import play

        experiment = shown_experiment(self.target).changed(
            switching=self.switching, surface=self.surface
        )
        case = experiment
        law = self.laws or experiment.controllers[-1]
        try:
            play(
                experiment.plant("physics"),
                experiment.law("physics", law),
                case.x0,
                duration=case.duration,
                loop=experiment.applied_loop("physics", law),
                disturbances=case.disturbances,
                control_period=experiment.settings.control_period,
                speed=self.speed,
            )
        # MuJoCo raises them too, for instance because macOS needs mjpython.
        except RuntimeError as error:
            film = f"grosmc-mj film {self.target} --laws {law}"
            raise SetupError(f"{error}; for a film of it run: {film}") from error
        return DONE
