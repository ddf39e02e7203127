"""grosmc-mj campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from grosmc_mj.cli.answering import AnsweringCommand, Question
from grosmc_mj.cli.command import OUTPUT, Figures, Flag, Laws, WholeNumber, command
from grosmc_mj.cli.targets import TARGET
from grosmc_mj.ground.errors import ArgumentError

if TYPE_CHECKING:
    from grosmc_mj.studies.campaign.specification import Specification

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

# Panel of the help below the options that matter most.
_RUNS = Group("Runs", sort_key=2)

_Seconds = Annotated[
    float | None,
    Parameter(metavar="S", group=_RUNS, show_default="the file's"),
]


@command
class CampaignCommand(AnsweringCommand):
    """Run thousands of uncertain plants and say what share of them keeps what is required.

    The uncertainty is a case file's [[uncertain]] tables; the package's systems have files. Every
    plant meets every law. The answer is pass rates with intervals, margins, and the numbers that
    drive them; the folder keeps a row for each run, the results and the figures.

    Exit code: 0 if done, 1 if a law keeps everything on no plant, --at-least is missed or, without
    it, a search finds a declared plant that fails, 2 if the command or the set-up is wrong.

    Attributes:
        target: A system, a case or a case file; for --plant a campaign's folder.
        runs: Number of plants.
        controllers: Laws to run, or the one of --plant.
        at_least: Share of the declared design that each law must keep by its one-sided lower
            bound, else exit code 1. For random runs only.
        worst: Search for the worst plant under each law, and shrink it.
        radius: Search for the scale of the uncertainty at which each law first fails.
        out: Folder of the campaign or of the new file.
        resume: Go on with what is in the folder.
        plant: Write one plant of a campaign's folder as a case file: the number of its run; or
            worst, shrunk or outside, which --worst and --radius found.
        evaluations: Runs that --worst may take for each law, 128 or more.
        sampler: random (gives intervals) or corners of the ranges.
        seed: Seed of the sampler; run i depends on it and on i alone.
        confidence: Confidence of the intervals.
        duration: Duration of each run, in s.
        control_period: Time between two samples of the laws, in s.
        integrator: MuJoCo's integrator. implicitfast takes less than half the time of RK4, and
            passes some plants that RK4 fails.
        screen: Plants that run on equations, critical ones confirmed in MuJoCo: auto (where both
            agree), equations (where there are) or none.
        executor: batch (this process, on all cores), processes, or dask (the workers of a Dask
            scheduler).
        workers: Worker processes; for dask only without a scheduler.
        scheduler: Address or file of a Dask scheduler.
        shard: Plants of one part of the work, which is kept as a whole.
        axes: Two uncertain numbers of the map.
        figures: Draw the figures.
        case_file: For --plant: the campaign's case file, if it names a model or Python, which is
            imported only if it is the recorded one.
    """

    target: Annotated[str, Parameter(metavar=f"{TARGET}|FOLDER")]
    _: KW_ONLY
    runs: WholeNumber = 1024
    controllers: Laws = ()
    at_least: Annotated[float | None, Parameter(metavar="SHARE", show_default="none")] = None
    worst: Flag = False
    radius: Flag = False
    out: Annotated[
        Path | None,
        Parameter(metavar="DIR", show_default=str(_FOLDER / "NAME")),
    ] = None
    resume: Flag = False
    plant: Annotated[str | None, Parameter(metavar="WHICH", show_default="none")] = None

    evaluations: Annotated[WholeNumber, Parameter(group=_RUNS)] = 1024

    sampler: Annotated[str, Parameter(metavar="NAME", group=_RUNS)] = "random"
    seed: Annotated[WholeNumber, Parameter(group=_RUNS)] = 0
    confidence: Annotated[float, Parameter(metavar="SHARE", group=_RUNS)] = 0.95

    duration: _Seconds = None
    control_period: _Seconds = None
    integrator: Annotated[
        str | None,
        Parameter(metavar="NAME", group=_RUNS, show_default="the file's"),
    ] = None
    screen: Annotated[str, Parameter(metavar="NAME", group=_RUNS)] = "auto"

    executor: Annotated[
        str,
        Parameter(metavar="NAME", group=_RUNS),
    ] = "batch"
    workers: Annotated[
        WholeNumber | None,
        Parameter(group=_RUNS, show_default="one a core"),
    ] = None
    scheduler: Annotated[
        str | None,
        Parameter(metavar="ADDRESS", group=_RUNS, show_default="none"),
    ] = None
    shard: Annotated[WholeNumber, Parameter(group=_RUNS)] = 512

    axes: Annotated[
        tuple[str, ...],
        Parameter(metavar="X Y", group=OUTPUT, show_default="those that drive margins"),
    ] = ()
    figures: Figures = True
    case_file: Annotated[
        Path | None,
        Parameter(metavar="FILE", group=OUTPUT, show_default="none"),
    ] = None

    @property
    def case_target(self) -> str | None:
        """The target, if it is not the folder of a campaign."""
        if self.plant is not None or Path(self.target).is_dir():
            return None
        return self.target

    def execute(self) -> int:
        """Run the missing parts, print the answer, search; or write the case file of a plant."""
        self._refuse_idle()
        if self.plant is not None:
            return self._write_plant(self.plant)
        return super().execute()

    def _write_plant(self, which: str) -> int:
        """Write the case file of one plant of the folder; returns the exit code."""
        from grosmc_mj.cli.commands.campaign.plant import write_plant

        if len(self.controllers) > 1:
            raise ArgumentError(f"--laws {' '.join(self.controllers)}: name one, for --plant")
        law = self.controllers[0] if self.controllers else None
        return write_plant(Path(self.target), which, law, self.case_file, self.out)

    def questions(self) -> Sequence[Question]:
        """Return the question of the runs and of the searches that are asked for."""
        from grosmc_mj.cli.commands.campaign.running import (
            CampaignQuestion,
            RadiusQuestion,
            RunsQuestion,
            WorstQuestion,
        )
        from grosmc_mj.ground.executors import make_executor
        from grosmc_mj.studies.campaign.campaign import Campaign
        from grosmc_mj.studies.campaign.folder import Folder
        from grosmc_mj.studies.campaign.manifest import read_manifest, refuse_other_code

        specification = self._specification()
        folder = Folder(self.out or _FOLDER / specification.name)
        if folder.begun:
            refuse_other_code(folder.path, read_manifest(folder.path), specification)
        campaign = Campaign.of(specification)
        self._refuse_axes(campaign.family.names)
        executor = make_executor(self.executor, workers=self.workers, scheduler=self.scheduler)

        runs = RunsQuestion(
            campaign=campaign,
            folder=folder,
            executor=executor,
            resume=self.resume,
            confidence=self.confidence,
            at_least=self.at_least,
        )
        searches: list[WorstQuestion | RadiusQuestion] = []
        if self.worst:
            searches.append(WorstQuestion(runs, self.evaluations))
        if self.radius:
            searches.append(RadiusQuestion(runs))
        return [CampaignQuestion(runs, searches, self.axes, self.figures)]

    def _specification(self) -> Specification:
        """Return the family of plants and how much of it is run.

        Raises:
            ArgumentError: If the target is a campaign's folder, or a number does not fit.
        """
        from grosmc_mj.studies.campaign.folder import Folder
        from grosmc_mj.studies.campaign.specification import specification_of

        if Folder(Path(self.target)).begun:
            raise ArgumentError(
                f"{self.target} is a campaign's folder: --plant WHICH writes the case file of one "
                "of its plants; its case file with --resume and --out goes on"
            )
        self._refuse_numbers()
        specified: dict[str, Any] = {name: getattr(self, name) for name in _SPECIFIED}
        return specification_of(self.target, **specified)

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
        from grosmc_mj.studies.campaign.worst import LEAST

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
        from grosmc_mj.ground.arguments import require_known

        for name in self.axes:
            require_known("uncertain number", name, names)
        if self.axes and not len(self.axes) == len(set(self.axes)) == 2:
            raise ArgumentError(f"--axes {' '.join(self.axes)}: name two uncertain numbers")
