"""grosmc-mj campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.commands.campaign import answer
from grosmc_mj.cli.commands.campaign.replay import replay_run
from grosmc_mj.cli.commands.campaign.running import run_parts, say_integrator
from grosmc_mj.cli.targets import TARGET
from grosmc_mj.errors import ArgumentError, unknown_name

if TYPE_CHECKING:
    from rich.console import Console

    from grosmc_mj.campaign.family.campaign import Campaign
    from grosmc_mj.campaign.findings.findings import Findings
    from grosmc_mj.campaign.findings.radius import Radius
    from grosmc_mj.campaign.runs.folder import Folder

FOLDER = Path("renders") / "campaigns"
_MOST_EVALUATIONS = 10**7
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
        sampler: random, sobol, lhs or corners. Random runs are independent, so that they alone give
            intervals; the others spread over the ranges for maps and searches.
        controllers: Those of the file to run.
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
    controllers: Annotated[
        tuple[str, ...],
        arg(metavar="NAME [NAME ...]", help_behavior_hint="(default: all of the file)"),
    ] = ()
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
        """Run what is missing, say what is there, search where that is asked for."""
        from grosmc_mj.campaign.family.campaign import Campaign
        from grosmc_mj.campaign.family.specification import specification_of
        from grosmc_mj.campaign.findings.findings import findings
        from grosmc_mj.campaign.report.document import RESULTS, results_document
        from grosmc_mj.campaign.runs.folder import Folder
        from grosmc_mj.campaign.runs.manifest import read_manifest, refuse_other_code
        from grosmc_mj.campaign.runs.replay import RADIUS
        from grosmc_mj.executors import make_executor
        from grosmc_mj.results.document import write_json

        self._refuse_idle()
        if self.replay is not None:
            return replay_run(self, self.replay)
        _check(self)
        specification = specification_of(
            self.target,
            runs=self.runs,
            shard=self.shard,
            seed=self.seed,
            sampler=self.sampler,
            controllers=self.controllers or None,
            control_period=self.control_period,
            duration=self.duration,
            integrator=self.integrator,
            screen=self.screen,
        )
        folder = Folder(self.out or FOLDER / specification.name)
        if folder.begun:
            refuse_other_code(folder.path, read_manifest(folder.path), specification)
        asked = Campaign.of(specification)
        _check_axes(self, asked)
        executor = make_executor(self.executor, workers=self.workers, scheduler=self.scheduler)
        console = screen.console()
        with folder.held():
            for line in folder.begin(asked, resume=self.resume):
                screen.notice(line)
            say_integrator(asked)
            for line in asked.not_judged:
                screen.notice(line)
            for name in asked.idle:
                screen.notice(
                    f"{name} never acts: runs end at {asked.duration:g} s, before it begins."
                )
            done = run_parts(asked, folder, executor)
        found = findings(asked, folder, self.confidence)
        files = [folder.path / RESULTS]
        write_json(files[0], results_document(asked, found))
        code = answer.say_verdict(console, asked, found, self.at_least, self.confidence)
        answer.say_findings(console, asked, found)
        for line in done:
            console.print(line, style="dim")
        if self.verbose:
            answer.say_tables(console, asked, found)
        if self.worst:
            files.append(self._search(console, asked, folder, found))
        reached = self._grow(console, asked, folder) if self.radius else []
        if reached:
            files.append(folder.path / RADIUS)
        if self.figures:
            files += self._draw(asked, folder, found, reached)
        screen.say_files(console, *files)
        return code

    def _refuse_idle(self) -> None:
        """Refuse options of the other kind: of a campaign in a replay, of a replay elsewhere."""
        for each in fields(self):
            name, of_replay = each.name, each.name in _OF_REPLAY
            if name in _OF_BOTH or getattr(self, name) == each.default:
                continue
            if of_replay != (self.replay is not None):
                option = f"--{name.replace('_', '-')}"
                where = "for --replay only" if of_replay else "not for --replay"
                raise ArgumentError(f"{option} is {where}: leave it out")

    def _search(self, console: Console, asked: Campaign, folder: Folder, found: Findings) -> Path:
        """Search for the worst plants."""
        from grosmc_mj.campaign.findings.worst import worst
        from grosmc_mj.campaign.report.document import worst_document
        from grosmc_mj.campaign.runs.replay import WORST
        from grosmc_mj.results.document import write_json

        searched = []
        with screen.progress(2 * self.evaluations * len(asked.judged), "runs") as advance:
            for law in asked.judged:
                advance(f"worst plant under {law}", 0)
                searched.append(
                    worst(
                        asked,
                        law,
                        found.worst[law],
                        self.evaluations,
                        lambda runs: advance(f"worst plant under {law}", runs),  # noqa: B023
                    )
                )
        write_json(folder.path / WORST, worst_document(asked, searched))
        answer.say_worst(console, asked, searched, full=self.verbose)
        return folder.path / WORST

    def _grow(self, console: Console, asked: Campaign, folder: Folder) -> list[Radius]:
        """Look how far the uncertainty may grow."""
        from grosmc_mj.campaign.findings.radius import radius
        from grosmc_mj.campaign.report.document import radius_document
        from grosmc_mj.campaign.runs.replay import RADIUS
        from grosmc_mj.results.document import write_json

        reached = []
        with screen.progress(len(asked.judged), "controllers") as advance:
            for law in asked.judged:
                advance(f"radius under {law}", 0)
                reached.append(
                    radius(
                        asked,
                        law,
                        lambda runs: advance(f"radius under {law}: {runs} runs", 0),  # noqa: B023
                    )
                )
                advance(f"radius under {law}")
        write_json(folder.path / RADIUS, radius_document(asked, reached))
        answer.say_radius(console, asked, reached, full=self.verbose)
        return reached

    def _draw(
        self, asked: Campaign, folder: Folder, found: Findings, reached: Sequence[Radius]
    ) -> list[Path]:
        """Draw the figures; returns one file of each."""
        from grosmc_mj.campaign.report.margin_figure import write_margins
        from grosmc_mj.campaign.report.pass_map_figure import map_axes, write_pass_map
        from grosmc_mj.campaign.report.radius_figure import write_radius

        margins, plane, grown = (
            [folder.path / f"{name}.{suffix}" for suffix in ("png", "svg")]
            for name in ("margins", "map", "radius")
        )
        files = []
        if found.summaries:
            write_margins(asked, found, margins)
            files.append(margins[0])
        axes = map_axes(asked, found, self.axes)
        if axes is not None:
            write_pass_map(asked, folder, found, axes, plane)
            files.append(plane[0])
        if reached:
            write_radius(asked, reached, grown)
            files.append(grown[0])
        return files


def _check(command: CampaignCommand) -> None:
    """Refuse shares that are none, and too short a search, before anything is run."""
    from grosmc_mj.campaign.findings.worst import LEAST

    for name, value in (("confidence", command.confidence), ("at-least", command.at_least)):
        if value is not None and not 0 < value < 1:
            raise ArgumentError(f"--{name} {value:g} must lie between 0 and 1")
    if command.at_least is not None and command.sampler != "random":
        raise ArgumentError(
            f"--at-least takes independent runs, which --sampler {command.sampler} does not draw: "
            "take --sampler random"
        )
    if command.worst and not LEAST <= command.evaluations <= _MOST_EVALUATIONS:
        raise ArgumentError(
            f"--evaluations {command.evaluations} must be {LEAST} or more, up to "
            f"{_MOST_EVALUATIONS}"
        )


def _check_axes(command: CampaignCommand, asked: Campaign) -> None:
    """Refuse axes that are no uncertain numbers."""
    if command.axes and len(command.axes) != 2:
        raise ArgumentError(f"--axes names {len(command.axes)}: name two uncertain numbers")
    for name in command.axes:
        if name not in asked.family.names:
            raise ArgumentError(unknown_name("uncertain number", name, asked.family.names))
    if command.axes and command.axes[0] == command.axes[1]:
        raise ArgumentError(f"--axes {command.axes[0]!r} twice: name two different numbers")
