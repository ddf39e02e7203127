"""grosmc-mj campaign."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from tyro.conf import Positional, arg

from grosmc_mj import sweep as campaigns
from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command, Laws
from grosmc_mj.cli.commands.campaign import answer
from grosmc_mj.cli.commands.campaign.replay import replay_run
from grosmc_mj.cli.commands.campaign.running import run_parts
from grosmc_mj.cli.targets import TARGET
from grosmc_mj.errors import ArgumentError, unknown_name

if TYPE_CHECKING:
    from grosmc_mj.sweep.campaign import Campaign
    from grosmc_mj.sweep.findings import Findings
    from grosmc_mj.sweep.radius import Radius
    from grosmc_mj.sweep.store import Folder
    from grosmc_mj.sweep.worst import Worst

FOLDER = Path("renders") / "campaigns"
_MOST_EVALUATIONS = 10**7
# Options that are the specification's own.
_SPECIFIED = (
    "runs", "shard", "seed", "sampler", "controllers", "control_period", "duration", "integrator",
    "screen",
)  # fmt: skip
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
        """Run the missing parts, print the answer, search for worst plants and radii."""
        from grosmc_mj.executors import make_executor

        self._refuse_idle()
        if self.replay is not None:
            return replay_run(self, self.replay)
        if campaigns.store.Folder(Path(self.target)).begun:
            raise ArgumentError(
                f"{self.target} is a campaign's folder: --replay RUN repeats one of its runs; "
                "its case file with --resume and --out goes on"
            )
        self._refuse_numbers()
        specified: dict[str, Any] = {name: getattr(self, name) for name in _SPECIFIED}
        specification = campaigns.campaign.specification_of(self.target, **specified)
        folder = campaigns.store.Folder(self.out or FOLDER / specification.name)
        if folder.begun:
            there = campaigns.store.read_manifest(folder.path)
            campaigns.store.refuse_other_code(folder.path, there, specification)
        campaign = campaigns.campaign.Campaign.of(specification)
        self._refuse_axes(campaign.family.names)
        executor = make_executor(self.executor, workers=self.workers, scheduler=self.scheduler)
        console = screen.console()
        with folder.held():
            notices = folder.begin(campaign, resume=self.resume)
            if campaign.plant.restepped:
                notices.append(
                    f"Steps by {campaign.experiment.settings.integrator} instead of the model's "
                    "own integrator, which may judge some plants otherwise."
                )
            late = f"never acts: runs end at {campaign.duration:g} s, before it begins."
            notices += [*campaign.not_judged, *(f"{name} {late}" for name in campaign.idle)]
            for line in notices:
                screen.notice(line)
            progress = run_parts(campaign, folder, executor)
        found = campaigns.findings.findings(campaign, folder, self.confidence)
        document = campaigns.findings.results_document(campaign, found)
        files = [_written(folder, campaigns.findings.RESULTS, document)]
        code = answer.say_verdict(console, campaign, found, self.at_least, self.confidence)
        answer.say_findings(console, campaign, found, progress, full=self.verbose)
        reached: list[Radius] = []
        if self.worst:
            plants = self._worst(campaign, found)
            document = campaigns.worst.worst_document(campaign, plants)
            files.append(_written(folder, campaigns.worst.WORST, document))
            answer.say_worst(console, campaign, plants, full=self.verbose)
        if self.radius:
            reached = self._radii(campaign)
            document = campaigns.radius.radius_document(campaign, reached)
            files.append(_written(folder, campaigns.radius.RADIUS, document))
            answer.say_radius(console, campaign, reached, full=self.verbose)
        if self.figures:
            files += campaigns.map.write_figures(campaign, folder, found, reached, self.axes)
        screen.say_files(console, *files)
        return code

    def _refuse_idle(self) -> None:
        """Refuse options of the other kind: of a campaign in a replay, of a replay elsewhere."""
        for option in fields(self):
            name, of_replay = option.name, option.name in _OF_REPLAY
            idle = name not in _OF_BOTH and of_replay != (self.replay is not None)
            if idle and getattr(self, name) != option.default:
                where = "for --replay only" if of_replay else "not for --replay"
                raise ArgumentError(f"--{name.replace('_', '-')} is {where}: leave it out")

    def _refuse_numbers(self) -> None:
        """Refuse shares that are none, and too short a search, before anything is run."""
        for name, value in (("confidence", self.confidence), ("at-least", self.at_least)):
            if value is not None and not 0 < value < 1:
                raise ArgumentError(f"--{name} {value:g} must lie between 0 and 1")
        if self.at_least is not None and self.sampler != "random":
            raise ArgumentError(
                f"--at-least takes independent runs, which --sampler {self.sampler} does not draw: "
                "take --sampler random"
            )
        least = campaigns.worst.LEAST
        if self.worst and not least <= self.evaluations <= _MOST_EVALUATIONS:
            raise ArgumentError(
                f"--evaluations {self.evaluations} must be {least} or more, up to "
                f"{_MOST_EVALUATIONS}"
            )

    def _refuse_axes(self, names: list[str]) -> None:
        """Refuse axes that are no two uncertain numbers."""
        for name in self.axes:
            if name not in names:
                raise ArgumentError(unknown_name("uncertain number", name, names))
        if self.axes and not len(self.axes) == len(set(self.axes)) == 2:
            raise ArgumentError(f"--axes {' '.join(self.axes)}: name two uncertain numbers")

    def _worst(self, campaign: Campaign, found: Findings) -> list[Worst]:
        """The worst plant under each law."""
        with screen.progress(2 * self.evaluations * len(campaign.judged), "runs") as advance:
            return [
                campaigns.worst.worst(
                    campaign,
                    law,
                    found.worst[law],
                    self.evaluations,
                    partial(advance, f"worst plant under {law}"),
                )
                for law in campaign.judged
            ]

    def _radii(self, campaign: Campaign) -> list[Radius]:
        """How far the uncertainty may grow under each law."""
        reached = []
        with screen.progress(len(campaign.judged), "controllers") as advance:
            for law in campaign.judged:
                words = f"radius under {law}"
                advance(words, 0)
                step = partial(lambda words, _: advance(words, 0), words)
                reached.append(campaigns.radius.radius(campaign, law, step))
                advance(words)
        return reached


def _written(folder: Folder, name: str, document: dict[str, Any]) -> Path:
    """Write a result into the campaign's folder."""
    from grosmc_mj.results.document import write_json

    write_json(folder.path / name, document)
    return folder.path / name
