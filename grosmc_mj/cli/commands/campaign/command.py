"""grosmc-mj campaign."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional, arg

from grosmc_mj.cli.command import Command, Laws
from grosmc_mj.cli.targets import TARGET
from grosmc_mj.errors import ArgumentError

# Options of a replay alone, and those that both have.
_OF_REPLAY = ("controller", "engine", "case_file", "film")
_OF_BOTH = ("target", "out", "figures", "verbose", "replay")


@dataclass(frozen=True)
class CampaignCommand(Command):
    """Run thousands of uncertain plants and say what share of them keeps what is required.

    The uncertainty is a case file's [[uncertain]] tables; the package has a file for servo,
    cart_pendulum and arm. Every plant meets every controller, in MuJoCo or, where --screen lets
    it, on its equations, and nothing is recorded but what it did: pass rates with intervals,
    margins, differences between the controllers and what drives the margins go to standard output.
    The folder keeps manifest.json, one row a run in parts/*.parquet, results.json and figures.

    With --replay the target is such a folder, and one of its runs is repeated, recorded, and
    compared to the last bit. RUN.json, the figure and the film go to replays in the folder, or to
    --out. The folder is data: no Python is imported from it.

    Exit code: 0 if done, 1 if --at-least is missed or a replay is not what the campaign stored, 2
    if the command or the set-up is wrong.

    Attributes:
        target: A system, a case of the package or a case file; for --replay a campaign's folder.
        runs: Plants.
        shard: Plants of one part, the smallest piece of work that is done, kept and handed out.
        seed: Of the sampler; run i depends on it and on i alone.
        sampler: random or corners. Random runs are independent, so that they alone give intervals;
            corners are all combinations of the ranges' ends.
        controllers: Laws to run, of the file's controllers or of its [laws].
        control_period: Time between two samples of the laws, in s, instead of the file's.
        duration: Of each run, in s, instead of the file's.
        screen: Which runs are made on the equations, with all that are near a limit, ended early or
            are worse than the worst of a sample confirmed in MuJoCo, and 2 % of the rest: auto
            those of plants that equations describe as MuJoCo does, which is measured first;
            equations all that equations can describe; none no run.
        integrator: MuJoCo's, instead of the file's. implicitfast takes less than half the time of
            RK4, the packaged models' own, and passes plants that RK4 fails: of 9 verdicts on 256
            arms in which they differ RK4 was right in 8, by steps a tenth as long.
        out: The campaign's folder, by default renders/campaigns/NAME; for --replay where to write.
        resume: Go on with what is in the folder.
        executor: batch runs in this process, on all cores; processes in workers of their own; dask
            in those of a Dask scheduler.
        workers: Processes, for processes and for dask without a scheduler.
        scheduler: Address or file of a Dask scheduler.
        confidence: Of the intervals.
        worst: Search for the worst plant under each controller, and shrink it.
        evaluations: Runs that this search may take for a controller.
        radius: Bisect the scale of the uncertainty at which each controller first fails.
        axes: Two uncertain numbers that the map is drawn over.
        at_least: Share of the declared design that must be shown to keep everything, under each
            controller: exit code 1 if its one-sided lower bound (Clopper and Pearson, at the
            confidence) is below it. It takes independent runs, as --sampler random draws them.
        figures: Whether to draw the figures.
        replay: Number of the run to repeat; or worst, shrunk or outside, the plants that --worst
            and --radius found.
        controller: For --replay: whose run; by default the campaign's last controller.
        engine: For --replay: native or python.
        case_file: For --replay: the campaign's case file, if that names Python, which is imported
            from beside it if it is what the campaign recorded; a model is taken from there too.
        film: For --replay: whether to film it in MuJoCo: films/RUN.mp4.
    """

    target: Annotated[Positional[str], arg(metavar=f"{TARGET}|FOLDER", name="target")]
    runs: Annotated[int, arg(metavar="N")] = 1024
    shard: Annotated[int, arg(metavar="N")] = 512
    seed: Annotated[int, arg(metavar="N")] = 0
    sampler: Annotated[str, arg(metavar="NAME")] = "random"
    controllers: Laws = ()
    control_period: Annotated[float | None, arg(metavar="S", help_behavior_hint="")] = None
    duration: Annotated[float | None, arg(metavar="S", help_behavior_hint="")] = None
    screen: Annotated[str, arg(metavar="auto|equations|none")] = "auto"
    integrator: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None
    out: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")] = None
    resume: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    executor: Annotated[str, arg(metavar="NAME")] = "batch"
    workers: Annotated[int | None, arg(metavar="N", help_behavior_hint="(default: one a core)")] = (
        None
    )
    scheduler: Annotated[str | None, arg(metavar="ADDRESS", help_behavior_hint="")] = None
    confidence: Annotated[float, arg(metavar="SHARE")] = 0.95
    worst: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    evaluations: Annotated[int, arg(metavar="N")] = 1024
    radius: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    axes: Annotated[
        tuple[str, ...],
        arg(metavar="X Y", help_behavior_hint="(default: those that drive margins most)"),
    ] = ()
    at_least: Annotated[float | None, arg(metavar="SHARE", help_behavior_hint="")] = None
    figures: bool = True
    replay: Annotated[str | None, arg(metavar="RUN", help_behavior_hint="")] = None
    controller: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None
    engine: Annotated[str, arg(metavar="native|python")] = "native"
    case_file: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None
    film: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False

    def execute(self) -> int:
        """Run the missing parts, print the answer, search; or repeat a run."""
        self._refuse_idle()
        if self.replay is not None:
            from grosmc_mj.cli.commands.campaign.replay import replay_run

            return replay_run(self, self.replay)
        from grosmc_mj.cli.commands.campaign.running import run

        return run(self)

    def _refuse_idle(self) -> None:
        """Refuse options of the other kind: of a campaign in a replay, of a replay elsewhere."""
        for option in fields(self):
            name, of_replay = option.name, option.name in _OF_REPLAY
            idle = name not in _OF_BOTH and of_replay != (self.replay is not None)
            if idle and getattr(self, name) != option.default:
                where = "for --replay only" if of_replay else "not for --replay"
                raise ArgumentError(f"--{name.replace('_', '-')} is {where}: leave it out")
