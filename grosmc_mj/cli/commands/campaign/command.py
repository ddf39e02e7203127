"""grosmc-mj campaign."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command, Flag, Laws, OptionalName
from grosmc_mj.cli.targets import TARGET
from grosmc_mj.errors import ArgumentError

if TYPE_CHECKING:
    from grosmc_mj.sweep.campaign import Campaign, Specification
    from grosmc_mj.sweep.findings import Findings
    from grosmc_mj.sweep.radius import Radius
    from grosmc_mj.sweep.store import Folder

# Options of --plant alone, and those that a campaign has, too.
_FOR_PLANT = ("case_file",)
_FOR_BOTH = ("target", "controllers", "out", "verbose", "plant")
# Options that are fields of the specification.
_SPECIFIED = (
    "runs",
    "shard",
    "seed",
    "sampler",
    "controllers",
    "control_period",
    "duration",
    "integrator",
    "screen",
)
_FOLDER = Path("renders") / "campaigns"
_MOST_EVALUATIONS = 10**7


@dataclass(frozen=True)
class CampaignCommand(Command):
    """Run thousands of uncertain plants and say what share of them keeps what is required.

    The uncertainty is a case file's [[uncertain]] tables; the package has a file for servo,
    cart_pendulum and arm. Every plant meets every controller, in MuJoCo or, where --screen lets
    it, on its equations, and nothing is recorded but what it did: pass rates with intervals,
    margins, differences between the controllers and what drives the margins go to standard output.
    The folder keeps manifest.json, one row a run in parts/*.parquet, results.json and figures.

    With --plant the target is such a folder, and one of its plants is written as a case file,
    which run, film and diff take like any other. The folder is data: no Python is imported from
    it.

    Exit code: 0 if done, 1 if --at-least is missed, 2 if the command or the set-up is wrong.

    Attributes:
        target: A system, a case of the package or a case file; for --plant a campaign's folder.
        runs: Plants.
        shard: Plants of one part, the smallest piece of work that is done, kept and handed out.
        seed: Of the sampler; run i depends on it and on i alone.
        sampler: random or corners. Random runs are independent, so that they alone give intervals;
            corners are all combinations of the ranges' ends.
        controllers: Laws to run, of the file's controllers or of its [laws]; for --plant the one
            that ran on the plant, the campaign's last one by default.
        control_period: Time between two samples of the laws, in s, instead of the file's.
        duration: Of each run, in s, instead of the file's.
        screen: Which runs are made on the equations, with all that are near a limit, ended early or
            are worse than the worst of a sample confirmed in MuJoCo, and 2 % of the rest: auto
            those of plants that equations describe as MuJoCo does, which is measured first;
            equations all that equations can describe; none no run.
        integrator: MuJoCo's, instead of the file's. implicitfast takes less than half the time of
            RK4, the packaged models' own, and passes plants that RK4 fails: of 9 verdicts on 256
            arms in which they differ RK4 was right in 8, by steps a tenth as long.
        out: The campaign's folder, by default renders/campaigns/NAME; for --plant where to write.
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
        plant: Number of the run whose plant is written as a case file; or worst, shrunk or outside,
            the plants that --worst and --radius found.
        case_file: For --plant: the campaign's case file. The new file is written beside it and
            extends it. It is needed if it names a model or Python, which is imported from beside it
            if it is what the campaign recorded.
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
    integrator: OptionalName = None
    out: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")] = None
    resume: Flag = False
    executor: Annotated[str, arg(metavar="NAME")] = "batch"
    workers: Annotated[int | None, arg(metavar="N", help_behavior_hint="(default: one a core)")] = (
        None
    )
    scheduler: Annotated[str | None, arg(metavar="ADDRESS", help_behavior_hint="")] = None
    confidence: Annotated[float, arg(metavar="SHARE")] = 0.95
    worst: Flag = False
    evaluations: Annotated[int, arg(metavar="N")] = 1024
    radius: Flag = False
    axes: Annotated[
        tuple[str, ...],
        arg(metavar="X Y", help_behavior_hint="(default: those that drive margins most)"),
    ] = ()
    at_least: Annotated[float | None, arg(metavar="SHARE", help_behavior_hint="")] = None
    figures: bool = True
    plant: Annotated[str | None, arg(metavar="WHICH", help_behavior_hint="")] = None
    case_file: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None

    def execute(self) -> int:
        """Run the missing parts, print the answer, search; or write the case file of a plant."""
        self._refuse_idle()
        if self.plant is not None:
            return self._write_plant(self.plant)
        return self._run()

    def _write_plant(self, which: str) -> int:
        """Write the case file of one plant of the folder; returns the exit code."""
        from grosmc_mj.cli.commands.campaign.plant import write_plant

        if len(self.controllers) > 1:
            raise ArgumentError(f"--laws {' '.join(self.controllers)}: name one, for --plant")
        law = self.controllers[0] if self.controllers else None
        return write_plant(Path(self.target), which, law, self.case_file, self.out)

    def _run(self) -> int:
        """Carry out a campaign; returns the exit code."""
        from grosmc_mj.cli.commands.campaign import answer
        from grosmc_mj.cli.commands.campaign.running import notices, run_parts
        from grosmc_mj.executors import make_executor
        from grosmc_mj.results.document import write_json
        from grosmc_mj.sweep.campaign import Campaign
        from grosmc_mj.sweep.findings import RESULTS, findings, results_document
        from grosmc_mj.sweep.store import Folder, read_manifest, refuse_other_code

        specification = self._specification()
        folder = Folder(self.out or _FOLDER / specification.name)
        if folder.begun:
            refuse_other_code(folder.path, read_manifest(folder.path), specification)
        campaign = Campaign.of(specification)
        self._refuse_axes(campaign.family.names)
        executor = make_executor(self.executor, workers=self.workers, scheduler=self.scheduler)

        with folder.held():
            lines = folder.begin(campaign, resume=self.resume)
            for line in (*lines, *notices(campaign)):
                screen.notice(line)
            progress = run_parts(campaign, folder, executor)

        result = findings(campaign, folder, self.confidence)
        write_json(folder.path / RESULTS, results_document(campaign, result))
        console = screen.console()
        code = answer.say_campaign_verdict(
            console, campaign, result, self.at_least, self.confidence
        )
        answer.say_findings(console, campaign, result, progress, full=self.verbose)
        self._search(campaign, folder, result)
        return code

    def _specification(self) -> Specification:
        """Return the family of plants and how much of it is run.

        Raises:
            ArgumentError: If the target is a campaign's folder, or a number does not fit.
        """
        from grosmc_mj.sweep.campaign import specification_of
        from grosmc_mj.sweep.store import Folder

        if Folder(Path(self.target)).begun:
            raise ArgumentError(
                f"{self.target} is a campaign's folder: --plant WHICH writes the case file of one "
                "of its plants; its case file with --resume and --out goes on"
            )
        self._refuse_numbers()
        specified: dict[str, Any] = {name: getattr(self, name) for name in _SPECIFIED}
        return specification_of(self.target, **specified)

    def _search(self, campaign: Campaign, folder: Folder, result: Findings) -> None:
        """Make the searches and the figures that are asked for, and print where all results are."""
        from grosmc_mj.sweep.findings import RESULTS
        from grosmc_mj.sweep.map import write_figures
        from grosmc_mj.sweep.radius import RADIUS

        files = [folder.path / RESULTS]
        if self.worst:
            files.append(self._search_worst(campaign, folder, result))
        radii: list[Radius] = []
        if self.radius:
            path = folder.path / RADIUS
            radii = self._search_radii(campaign, path)
            files.append(path)
        if self.figures:
            files += write_figures(campaign, folder, result, radii, self.axes)
        screen.say_files(screen.console(), *files)

    def _search_worst(self, campaign: Campaign, folder: Folder, result: Findings) -> Path:
        """Search the worst plants, write and print them; returns the path of their document."""
        from grosmc_mj.cli.commands.campaign.answer import say_worst
        from grosmc_mj.cli.commands.campaign.running import search_worst
        from grosmc_mj.results.document import write_json
        from grosmc_mj.sweep.worst import WORST, worst_document

        path = folder.path / WORST
        plants = search_worst(campaign, result, self.evaluations)
        write_json(path, worst_document(campaign, plants))
        say_worst(screen.console(), campaign, plants, full=self.verbose)
        return path

    def _search_radii(self, campaign: Campaign, path: Path) -> list[Radius]:
        """Search the radii, write their document and print them."""
        from grosmc_mj.cli.commands.campaign.answer import say_radius
        from grosmc_mj.cli.commands.campaign.running import search_radii
        from grosmc_mj.results.document import write_json
        from grosmc_mj.sweep.radius import radius_document

        radii = search_radii(campaign)
        write_json(path, radius_document(campaign, radii))
        say_radius(screen.console(), campaign, radii, full=self.verbose)
        return radii

    def _refuse_idle(self) -> None:
        """Refuse options of the other kind: of a campaign for --plant, of --plant elsewhere."""
        for option in fields(self):
            name = option.name
            for_plant = name in _FOR_PLANT
            if name in _FOR_BOTH or for_plant == (self.plant is not None):
                continue
            if getattr(self, name) != option.default:
                where = "for --plant only" if for_plant else "not for --plant"
                raise ArgumentError(f"--{name.replace('_', '-')} is {where}: leave it out")

    def _refuse_numbers(self) -> None:
        """Refuse shares that are none, and too short a search, before anything is run."""
        from grosmc_mj.sweep.worst import LEAST

        for name, share in (("confidence", self.confidence), ("at-least", self.at_least)):
            if share is not None and not 0 < share < 1:
                raise ArgumentError(f"--{name} {share:g} must lie between 0 and 1")
        if self.at_least is not None and self.sampler != "random":
            raise ArgumentError(
                f"--at-least takes independent runs, which --sampler {self.sampler} does not "
                "draw: take --sampler random"
            )
        if self.worst and not LEAST <= self.evaluations <= _MOST_EVALUATIONS:
            raise ArgumentError(
                f"--evaluations {self.evaluations} must be {LEAST} or more, up to "
                f"{_MOST_EVALUATIONS}"
            )

    def _refuse_axes(self, names: list[str]) -> None:
        """Refuse axes that are no two uncertain numbers."""
        from grosmc_mj.arguments import require_known

        for name in self.axes:
            require_known("uncertain number", name, names)
        if self.axes and not len(self.axes) == len(set(self.axes)) == 2:
            raise ArgumentError(f"--axes {' '.join(self.axes)}: name two uncertain numbers")
