"""grosmc-mj film."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import (
    OUTPUT,
    Command,
    Flag,
    OptionalName,
    OptionalSurface,
    Target,
    WholeNumber,
    command,
)
from grosmc_mj.cli.exit_codes import DONE
from grosmc_mj.cli.films import FOLDER, write_with_progress
from grosmc_mj.cli.targets import result_name, shown_experiment
from grosmc_mj.ground.errors import ArgumentError, name_list
from grosmc_mj.ground.files import require_writable

if TYPE_CHECKING:
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.plants import PlantName
    from grosmc_mj.output.films.film import Format

# Laws that are filmed if none are named.
_LAWS = ("lqr", "grosmc")


@command
class FilmCommand(Command):
    """Film a case: laws side by side in MuJoCo, with their curves; of equations, the curves alone.

    Each law runs once; the film replays the recorded states. A translucent ghost shows the
    nominal optimal trajectory x* (for the arm, the reference), a green arrow or arc the force or
    torque of the disturbance while it acts. The camera moves where a body would not fit or would be
    a speck; a model without light, floor or background gets them, and moving parts without colours
    have those of the laws. Beside FILE.mp4 (H.264, plays
    in every browser) lie a poster, FILE.png, of the moment at which the laws differ most, and
    FILE.json with all that the film was made from.

    It renders off-screen with the backend that MUJOCO_GL names, else with the first that works of
    egl, osmesa and, where there is a display, glfw. Where none works, or without ffmpeg, it says
    what is missing and which command installs it.

    Attributes:
        target: A system, of which it is case1, a case (SYSTEM/CASE) or a case file (FILE.toml).
        laws: One to four laws that grosmc-mj list shows, or laws of the file.
        camera: Camera of the model: fixed, follow or wide; by default follow where it moves along
            with the cart, else fixed.
        size: Width and height in pixels, both even.
        fps: Frames per second.
        speed: Seconds of the run in a second of the film.
        start: First instant shown, in s.
        stop: End of what is shown, in s.
        duration: Duration of the runs, in s.
        output: The film; by default renders/films/SYSTEM_CASE.mp4.
        gif: Write a small GIF, too.
        workers: Number of rendering processes.
        switching: Switching law of the sliding mode laws: sign as in the chapter, boundary-layer,
            implicit, implicit-estimate, super-twisting, adaptive, unit-vector or
            implicit-unit-vector.
        surface: printed, or discrete: zero at every sample of the nominal plant.
    """

    target: Target
    _: KW_ONLY
    laws: Annotated[
        tuple[str, ...] | None,
        Parameter(metavar="NAME...", show_default="lqr grosmc, else the last four"),
    ] = None
    camera: OptionalName = None
    size: Annotated[str, Parameter(metavar="WxH")] = "1280x720"
    fps: WholeNumber = 30
    speed: Annotated[float, Parameter(metavar="X")] = 1.0
    start: Annotated[float, Parameter(name="--from", metavar="T")] = 0.0
    stop: Annotated[
        float | None,
        Parameter(name="--to", metavar="T", show_default="the run's end"),
    ] = None
    duration: Annotated[float | None, Parameter(metavar="S", show_default="the case's")] = None
    output: Annotated[
        Path | None,
        Parameter(alias="-o", metavar="FILE.mp4", group=OUTPUT),
    ] = None
    gif: Annotated[Flag, Parameter(group=OUTPUT)] = False
    workers: Annotated[WholeNumber | None, Parameter(show_default="one a core")] = None
    switching: Annotated[OptionalName, Parameter(show_default="the law's own")] = None
    surface: Annotated[OptionalSurface, Parameter(show_default="the law's own")] = None

    def execute(self) -> int:
        """Run the laws, then render and write the film."""
        from grosmc_mj.experiments.films import film_of

        form = self._format()
        experiment = shown_experiment(self.target).changed(
            switching=self.switching, surface=self.surface
        )
        if self.duration is not None:
            experiment = experiment.changed(duration=self.duration)
        laws = self._law_names(experiment)
        _require_filmable(experiment, laws, form)

        path = self.output
        if path is None:
            path = Path("renders") / FOLDER / f"{result_name(experiment.path)}.mp4"
        require_writable(path)
        plant = _filmed_plant(experiment)
        results = [experiment.run(plant, law) for law in laws]
        console = screen.console()
        write_with_progress(
            console,
            experiment,
            film_of(results, form, laws),
            path,
            workers=self.workers,
            gif=self.gif,
        )

        ended = [f"{result.key}: {result.ended}" for result in results if result.ended]
        screen.say_lines(console, ended, full=self.verbose)
        return DONE

    def _format(self) -> Format:
        """Return the format of the film.

        Raises:
            ArgumentError: If the size, or another number, does not fit.
        """
        from grosmc_mj.output.films.film import Format

        size = re.fullmatch(r"(\d+)[x×](\d+)", self.size.strip().lower())
        if size is None:
            raise ArgumentError(f"--size {self.size} must be WIDTHxHEIGHT in pixels, like 1280x720")
        return Format(
            int(size[1]),
            int(size[2]),
            self.fps,
            self.speed,
            self.camera,
            self.start,
            self.stop,
        )

    def _law_names(self, experiment: Experiment) -> tuple[str, ...]:
        """Return the laws to film, each once; say which laws of the file are left out."""
        from grosmc_mj.output.films.film import MOST_TAKES

        if self.laws is not None:
            return tuple(dict.fromkeys(self.laws))
        declared = experiment.controllers
        laws = _LAWS
        if not set(laws) <= set(declared):
            laws = tuple(dict.fromkeys(declared[-MOST_TAKES:]))
        others = [law for law in declared if law not in laws]
        if others:
            screen.notice(f"not shown: {name_list(others)}; --laws takes up to {MOST_TAKES} laws")
        return laws


def _require_filmable(experiment: Experiment, controllers: Sequence[str], form: Format) -> None:
    """Refuse a film that cannot be made, before anything is run for it.

    Raises:
        ArgumentError: If there are no controllers, too many or unknown ones, or the format does not
            fit the case.
    """
    from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
    from grosmc_mj.output.films.film import MOST_TAKES
    from grosmc_mj.output.films.scene import camera_names

    if not 1 <= len(controllers) <= MOST_TAKES:
        raise ArgumentError(
            f"a film shows 1 to {MOST_TAKES} controllers, not {len(controllers)}; valid: "
            f"{name_list(experiment.controllers)}"
        )
    for name in controllers:
        experiment.law(_filmed_plant(experiment), name)
    plant = experiment.nominal.plant
    cameras = camera_names(plant.model) if isinstance(plant, MujocoPlant) else ()
    form.check(cameras, experiment.duration)


def _filmed_plant(experiment: Experiment) -> PlantName:
    """Return the plant that is filmed: MuJoCo, or else the equations."""
    names = experiment.plant_names
    return "physics" if "physics" in names else names[-1]
