"""Contest of laws: each is tuned by the same budget to the same conditions, and judged alike."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.errors import ArgumentError, GrosmcError, SetupError
from grosmc_mj.output.results.verdicts import Verdict
from grosmc_mj.studies.contest.row import ContestLaw, Entry
from grosmc_mj.studies.disturbance.bounded import bounded_disturbance
from grosmc_mj.studies.disturbance.disturbance import DisturbanceStudy
from grosmc_mj.studies.margins.task import task_margins
from grosmc_mj.studies.rivals import variation_of
from grosmc_mj.studies.study import CellRunner, Study, StudyCell
from grosmc_mj.studies.target import MACHINE, Condition, StudiedLaw, case_for, laws_of, limits_in
from grosmc_mj.studies.trials import Trial, Trials
from grosmc_mj.studies.tune.case_text import with_requirements_of
from grosmc_mj.studies.tune.conditions import PLANTS
from grosmc_mj.studies.tune.laws import tunable_laws
from grosmc_mj.studies.tune.numbers import TunableLaw
from grosmc_mj.studies.tune.row import AS_IN_FILE, TUNED, TunedLaw
from grosmc_mj.studies.tune.tune import TuneStudy, tune_study

# Pieces of a disturbance, each with a sign of its own.
PIECES = 20


@dataclass(frozen=True, eq=False)
class ContestStudy(Study[ContestLaw]):
    """A target, ready for a contest.

    Attributes:
        tuning: The tuning of its laws.
        margin_draws: Draws that margins of gain and delay are searched on.
        left_out: Laws that have no part, with the reason.
        on: Body, input or state on which the worst disturbance is searched; empty for none.
        bound: Its largest magnitude with its unit.
    """

    kind = "contest"
    row = ContestLaw
    unit = "runs"

    tuning: TuneStudy
    margin_draws: int
    left_out: dict[str, str]
    on: str = ""
    bound: str = ""

    @property
    def case(self) -> Experiment:
        """Experiment of the target."""
        return self.tuning.experiment

    @property
    def target(self) -> str:
        """SYSTEM/CASE."""
        return self.tuning.target

    @property
    def has_plants(self) -> bool:
        """Whether random plants are among its conditions."""
        return any(item.name == PLANTS for item in self.tuning.conditions)

    def configuration(self) -> dict[str, Any]:
        """Return the configuration as the result has it."""
        return {
            **self.tuning.configuration(),
            "margin_draws": self.margin_draws,
            "disturbance": {"on": self.on, "bound": self.bound, "pieces": PIECES},
        }

    def cells(self) -> list[StudyCell[ContestLaw]]:
        """Return a cell for each law."""
        return [
            StudyCell(
                name=cell.name,
                key=("contest", str(self.margin_draws), self.on, self.bound, *cell.key),
                depends_on=cell.depends_on,
                measure=partial(_refuse_measuring, cell.name),
            )
            for cell in self.tuning.cells()
        ]

    def steps(self, cells: Sequence[StudyCell[ContestLaw]]) -> int:
        """Return the number of steps of the progress: the runs of all searches."""
        return self.tuning.runs * len(cells)

    def rows(
        self, cells: Sequence[StudyCell[ContestLaw]], runner: CellRunner[ContestLaw]
    ) -> Iterator[ContestLaw]:
        """Yield the row of each law; a law whose search is interrupted has none."""
        for cell, law, tuning_cell in zip(
            cells, self.tuning.laws, self.tuning.cells(), strict=True
        ):
            row = runner.read(cell)
            if row is not None:
                runner.progress(cell.name, self.tuning.runs)
                yield row
                continue

            try:
                row = self._row(law, tuning_cell, runner)
            except SetupError:
                raise
            except GrosmcError as error:
                row = ContestLaw(law=law.name, refused=str(error))
            runner.write(cell, row)
            yield row

    def _row(
        self, law: TunableLaw, cell: StudyCell[TunedLaw], runner: CellRunner[ContestLaw]
    ) -> ContestLaw:
        """Tune a law, and judge it with the numbers of the file and with tuned ones."""
        tuning_runner = CellRunner(
            runner.folder, TunedLaw, runner.resume, runner.progress, runner.notice
        )
        # Its batches and its row are pieces in the same folder.
        tuning = replace(self.tuning, laws=[law])
        (tuned,) = list(tuning.rows([cell], tuning_runner))

        entries = []
        for step, experiment, controller, verdicts in (
            (AS_IN_FILE, law.experiment, law.law.controller, tuned.before),
            (
                TUNED,
                law.with_numbers(tuned.values),
                law.designed(tuned.values).controller,
                tuned.after,
            ),
        ):
            runner.progress(f"{law.name}, {step}: worst disturbance", 0)
            share = self._worst_disturbance(law, experiment)
            runner.progress(f"{law.name}, {step}: margins", 0)
            studied = replace(law.law, controller=controller)
            entries.append(self._entry(step, studied, verdicts, share))
        return ContestLaw(
            law=law.name,
            numbers=tuned.numbers,
            runs=tuned.runs,
            tuned_share=tuned.share,
            entries=entries,
        )

    def _worst_disturbance(self, law: TunableLaw, experiment: Experiment) -> float | None:
        """Share of the tightest limit under the worst disturbance that is found.

        Args:
            law: The law.
            experiment: Experiment with the law as its only controller.

        Returns:
            The share; None if no disturbance is searched, nothing is asked under one, or there can
            be no run.
        """
        if not self.on:
            return None
        try:
            asked = with_requirements_of(experiment, self.case, law)
            disturbance = bounded_disturbance(asked, self.on, self.bound)
            study = DisturbanceStudy(disturbance, pieces=PIECES)
            if not study.limits(law.name):
                return None
            return study.searched(law.name, PIECES).share
        except SetupError:
            raise
        except GrosmcError:
            return None

    def _entry(
        self, step: str, law: StudiedLaw, verdicts: list[Verdict], worst_disturbance: float | None
    ) -> Entry:
        """Judge a law with some numbers."""
        trials = Trials(self.case.nominal.truest, self._limits, self.margin_draws)
        conditions = [item.condition for item in self.tuning.conditions]
        runs: list[RunResult] = []
        for condition in conditions:
            experiment = condition.experiment
            try:
                runs.append(trials.record(Trial(law, condition, experiment.loop)))
            except SetupError:
                raise
            except GrosmcError:
                continue
        return Entry(
            step=step,
            verdicts=verdicts,
            worst_disturbance=worst_disturbance,
            margins=task_margins(trials, law, conditions[0]),
            largest_input=_largest([_peak(run) for run in runs]),
            variation=_largest([variation_of(run) for run in runs]),
        )

    def _limits(self, law: StudiedLaw, condition: Condition) -> tuple[Requirement, ...]:
        """Limits of a law, as they were asked for in its search."""
        case = self.case
        return limits_in(case.file.requirement, law, condition, [case.nominal.truest])


def _refuse_measuring(law: str, _: Any) -> ContestLaw:
    """Refuse to measure a cell alone: its batches are stored, too."""
    raise NotImplementedError(f"{law}: see ContestStudy.rows")


def _peak(run: RunResult) -> float:
    """Largest entry of |u| of a run."""
    value = run.metrics["max_input"].value
    return math.nan if value is None else float(value)


def _largest(values: Sequence[float]) -> float | None:
    """The largest finite value; None if there is none."""
    return max((value for value in values if math.isfinite(value)), default=None)


def contest_study(
    target: str,
    laws: Sequence[str] = (),
    *,
    conditions: Sequence[str] = (),
    runs: int = 3000,
    draws: int = 4,
    held_out: int = 20,
    plants: int = 0,
    margin_draws: int = 2,
    on: str = "",
    bound: str = "",
    seed: int = 0,
) -> ContestStudy:
    """Return a target with the laws that contend.

    Args:
        target: A system, which means its machine, ``SYSTEM/CASE``, or the path of a case file.
        laws: Names of laws; by default all of the case and the rivals. A law that another one is
            with other numbers counts once then, and one without numbers has no part.
        conditions: Names of the conditions; all by default.
        runs: Runs of a law's search at most.
        draws: Draws that designs are tuned on.
        held_out: Other draws that laws are judged on.
        plants: Random plants of ``[[uncertain]]`` that designs are tuned on, too.
        margin_draws: Draws that margins of gain and delay are searched on.
        on: Body, input or state on which the worst disturbance is searched; none by default.
        bound: Its largest magnitude with its unit.
        seed: Seed of the searches and of the plants.

    Raises:
        ArgumentError: If there is no such target, law, condition or place, nothing is required, no
            law has numbers, or the runs are too few for one design.
    """
    if bool(on) != bool(bound):
        raise ArgumentError("--on and --bound go together: a place and the largest magnitude there")
    if on:
        bounded_disturbance(case_for(target, MACHINE), on, bound)
    left_out: dict[str, str] = {}
    names = list(laws)
    if not names:
        names, left_out = _contending(case_for(target, MACHINE))
    tuning = tune_study(
        target,
        names,
        conditions=conditions,
        runs=runs,
        draws=draws,
        held_out=held_out,
        plants=plants,
        seed=seed,
    )
    return ContestStudy(tuning, margin_draws, left_out, on, bound)


def _contending(experiment: Experiment) -> tuple[list[str], dict[str, str]]:
    """Names of the laws that have numbers of their own, and of others with the reason.

    Raises:
        ArgumentError: If no law has.
    """
    first: dict[tuple[Any, ...], str] = {}
    left_out: dict[str, str] = {}
    for studied in laws_of(experiment.changed(loop=None)):
        try:
            (law,) = tunable_laws(experiment, [studied.name])
        except ArgumentError as error:
            left_out[studied.name] = str(error)
            continue

        kept = [law.table.get(key) for key in ("law", "switching", "surface", "predict")]
        key = (*map(str, kept), *(number.name for number in law.numbers))
        other = first.setdefault(key, studied.name)
        if other != studied.name:
            left_out[studied.name] = f"{other} with other numbers"
    if not first:
        raise ArgumentError(f"{experiment.path}: no law has numbers to tune")
    return list(first.values()), left_out
