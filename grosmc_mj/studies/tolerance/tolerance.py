"""Largest imperfections of its loop that each law stands: equations search, MuJoCo confirms."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.executors import executor_for
from grosmc_mj.output.results.verdicts import Verdict, Verdicts
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.studies.study import Advance, CellRunner, Study, StudyCell, dependencies
from grosmc_mj.studies.target import (
    BENCH,
    Condition,
    StudiedLaw,
    case_for,
    chosen_laws,
    conditions_of,
    limits_in,
    of_system,
)
from grosmc_mj.studies.tolerance.imperfections import (
    LEAST,
    MOST,
    Imperfection,
    LongerPeriod,
    imperfections,
)
from grosmc_mj.studies.tolerance.search import (
    BEYOND,
    FINER,
    PER_OCTAVE,
    RESOLUTION,
    ToleranceSearch,
    confirm_searches,
    search_tolerances,
)
from grosmc_mj.studies.trials import Trials


@dataclass(frozen=True, eq=False)
class ToleranceStudy(Study[Verdicts]):
    """A target, ready to be studied.

    Attributes:
        experiment: Experiment of the target, without a loop.
        bench: The loop whose numbers are the units.
        bench_of: SYSTEM/CASE of the bench.
        laws: The laws.
        imperfections: Imperfections of the loop.
        conditions: Plants and loads, the nominal one first.
        named: The target on the command line.
        draws: Runs of a loop in which something is drawn.
    """

    kind = "tolerance"
    row = Verdicts

    experiment: Experiment
    bench: Loop
    bench_of: str
    laws: Sequence[StudiedLaw]
    imperfections: Sequence[Imperfection]
    conditions: Sequence[Condition]
    named: str
    draws: int = 1

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process reads the target anew."""
        longer_period = any(isinstance(kind, LongerPeriod) for kind in self.imperfections)
        read = partial(tolerance_study, longer_period=longer_period, draws=self.draws)
        return read, (self.named, [law.name for law in self.laws])

    @property
    def target(self) -> str:
        """SYSTEM/CASE."""
        return self.experiment.target

    @property
    def kinds(self) -> dict[str, Imperfection]:
        """The imperfections by name."""
        return {kind.name: kind for kind in self.imperfections}

    @property
    def plants(self) -> list[PlantName]:
        """The equations, if the target has any, and physics, if it has it."""
        return [name for name in self.experiment.nominal.names if name != "printed"]

    @property
    def case(self) -> Experiment:
        """The experiment."""
        return self.experiment

    def limits(self, law: StudiedLaw, condition: Condition) -> tuple[Requirement, ...]:
        """Return the limits that a law must keep, whichever laws the file names."""
        return limits_in(self.experiment.file.requirement, law, condition, self.plants)

    def configuration(self) -> dict[str, Any]:
        """Return the configuration as the result has it."""
        settings = self.experiment.settings
        return {
            "target": self.target,
            "bench": self.bench_of,
            "control_period": {"value": settings.control_period, "unit": "s"},
            "timestep": {"value": settings.timestep, "unit": "s"},
            "draws": self.draws,
            "factors": {
                "least": LEAST,
                "most": MOST,
                "grid": 2.0 ** (1 / PER_OCTAVE),
                "grid_below_the_first_failure": 2.0 ** (1 / FINER),
                "beyond_the_last_kept": BEYOND,
                "resolution": RESOLUTION,
            },
        }

    def cells(self) -> list[StudyCell[Verdicts]]:
        """Return a cell for each law."""
        names = [kind.name for kind in self.imperfections]
        configuration = [self.configuration(), names, asdict(self.bench)]
        depends_on = dependencies(configuration, self.conditions)
        return [
            StudyCell(law.name, (law.name,), depends_on, partial(self._measure, index))
            for index, law in enumerate(self.laws)
        ]

    def _measure(self, index: int, _: Advance | None = None, *, threads: int = 0) -> Verdicts:
        """Return the row of a law, in this process or in another one."""
        return Verdicts(rows=tuple(tolerances(self, index, threads=threads)))

    def rows(
        self, cells: Sequence[StudyCell[Verdicts]], runner: CellRunner[Verdicts]
    ) -> Iterator[Verdicts]:
        """Yield the stored rows; then the others, in the order in which processes finish them."""
        missing = []
        for index, cell in enumerate(cells):
            row = runner.read(cell)
            if row is None:
                missing.append(index)
            else:
                runner.progress(cell.name)
                yield row
        if not missing:
            return

        executor = executor_for(len(missing))
        study_law = partial(self._measure, threads=executor.threads_per_worker)
        with closing(executor.run(study_law, missing, runner.notice)) as parts:
            for part in parts:
                cell = cells[part.index]
                runner.write(cell, part.report)
                runner.progress(cell.name)
                yield part.report

    def missing(self, rows: Sequence[Verdicts]) -> list[str]:
        """Return the laws that are not finished; rows come in the order of their processes."""
        finished = {verdict.law for row in rows for verdict in row.rows}
        return [law.name for law in self.laws if law.name not in finished]

    def tolerances(self, rows: Iterable[Verdicts]) -> list[Verdict]:
        """Return the answers of finished rows, law by law."""
        order = [law.name for law in self.laws]
        answers = [answer for row in rows for answer in row.rows]
        return sorted(answers, key=lambda answer: order.index(answer.law))


def tolerance_study(
    target: str,
    chosen: Sequence[str] = (),
    *,
    rivals: bool = False,
    longer_period: bool = False,
    draws: int = 1,
) -> ToleranceStudy:
    """Return a target with its bench, conditions and laws.

    Args:
        target: A system, which means its bench, ``SYSTEM/CASE``, or the path of a case file.
        chosen: Names of laws; all by default.
        rivals: Whether the default includes the rivals.
        longer_period: Whether a longer control period is one of the imperfections.
        draws: Runs of a loop in which something is drawn.

    Raises:
        ArgumentError: If there is no such target or law, no loop, or nothing is required.
    """
    experiment = case_for(target, BENCH)
    owner: Experiment | None = experiment
    if not experiment.loop:
        owner = of_system(experiment, BENCH)
    if owner is None or owner.loop is None:
        raise ArgumentError(
            f"{experiment.path}: there is no loop to take the amounts of imperfections from: give "
            "the file a [computing], a [[sensor]] or an [[actuator]]"
        )

    timestep = min(experiment.settings.timestep, owner.settings.timestep)
    bare = experiment.changed(loop=None).changed(timestep=timestep)
    kinds = imperfections(
        owner.loop,
        bare.nominal.system,
        timestep,
        bare.settings.control_period,
        longer_period=longer_period,
    )
    return ToleranceStudy(
        experiment=bare,
        bench=owner.loop,
        bench_of=owner.target,
        laws=chosen_laws(bare, chosen, rivals=rivals),
        imperfections=kinds,
        conditions=conditions_of(bare),
        named=target,
        draws=draws,
    )


def tolerances(studied: ToleranceStudy, index: int, threads: int = 0) -> list[Verdict]:
    """Return the tolerances of a law to each imperfection under each condition.

    MuJoCo runs at both ends of those answers of the equations that matter: of the least one over
    the conditions for each imperfection those next to a limit, the least of all, and some at
    random.

    Args:
        studied: The target.
        index: Number of one of its laws.
        threads: Threads of its runs; 0 for all cores.
    """
    law = studied.laws[index]
    equations, *physics = (
        Trials(plant, studied.limits, studied.draws, built=studied.bench, threads=threads)
        for plant in studied.plants
    )
    searches = [
        ToleranceSearch(law, imperfection, condition)
        for imperfection in studied.imperfections
        for condition in studied.conditions
    ]
    search_tolerances(searches, equations)

    agreed: dict[ToleranceSearch, bool] = {}
    if physics:
        chosen: list[ToleranceSearch] = []
        for imperfection in studied.imperfections:
            conditions = [search for search in searches if search.imperfection is imperfection]
            chosen.append(min(conditions, key=lambda search: search.weakness))
        chosen += [search for search in searches if search.fails_without]
        agreed = confirm_searches(list(dict.fromkeys(chosen)), physics[0])
    return [search.tolerance(agreed.get(search)) for search in searches]
