"""Tuning of laws: numbers that keep all requirements, over conditions, draws and plants."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, placed
from grosmc_mj.ground.wording import counted
from grosmc_mj.output.results.verdicts import Verdict
from grosmc_mj.studies.pieces import Piece, PieceStore, Rows
from grosmc_mj.studies.study import CellRunner, Study, StudyCell, dependencies
from grosmc_mj.studies.target import MACHINE, case_for
from grosmc_mj.studies.tune.conditions import TuningCondition, tuning_conditions, uncertain_plants
from grosmc_mj.studies.tune.laws import tunable_laws
from grosmc_mj.studies.tune.numbers import TunableLaw, ranges_of, start_of
from grosmc_mj.studies.tune.row import AS_IN_FILE, TUNED, TunedLaw, TunedNumberRow
from grosmc_mj.studies.tune.search import Search
from grosmc_mj.studies.tune.shares import Measure, TriedDesign, TriedDesigns

# Number of the first draw that designs are judged on; no search has so many.
HELD_OUT = 1000
# Share of the tightest limit at which a search ends.
TARGET = 0.5


@dataclass(frozen=True, eq=False)
class TuneStudy(Study[TunedLaw]):
    """A target, ready to be tuned.

    Attributes:
        experiment: Experiment of the target, with loop and machine.
        laws: The laws with their numbers.
        conditions: Conditions that all is asked under.
        runs: Runs of a law at most.
        draws: Draws that designs are tuned on.
        held_out: Other draws that they are judged on.
        seed: Seed of the searches.
        target_share: Share of the tightest limit at which a search ends.
    """

    kind = "tune"
    row = TunedLaw
    unit = "runs"

    experiment: Experiment
    laws: Sequence[TunableLaw]
    conditions: Sequence[TuningCondition]
    runs: int = 3000
    draws: int = 4
    held_out: int = 20
    seed: int = 0
    target_share: float = TARGET
    races: bool = True

    @property
    def case(self) -> Experiment:
        """Experiment of the target."""
        return self.experiment

    @property
    def target(self) -> str:
        """SYSTEM/CASE."""
        return self.experiment.target

    def configuration(self) -> dict[str, Any]:
        """Return the configuration as the result has it."""
        return {
            "target": self.target,
            "conditions": [item.name for item in self.conditions],
            "runs": self.runs,
            "draws": self.draws,
            "held_out": self.held_out,
            "seed": self.seed,
            "target_share": self.target_share,
            "races": self.races,
        }

    def cells(self) -> list[StudyCell[TunedLaw]]:
        """Return a cell for each law."""
        configuration = self.configuration()
        # A batch is the same whatever the budget: a longer search goes on from a shorter one.
        del configuration["runs"]
        depends_on = dependencies(configuration, [item.condition for item in self.conditions])
        return [
            StudyCell(
                name=law.name,
                key=(*_numbers_of(law), f"{self.runs} runs"),
                depends_on=depends_on,
                measure=partial(_refuse_measuring, law.name),
            )
            for law in self.laws
        ]

    def steps(self, cells: Sequence[StudyCell[TunedLaw]]) -> int:
        """Return the number of steps of the progress: the runs of all laws."""
        return self.runs * len(cells)

    def missing(self, rows: Sequence[TunedLaw]) -> list[str]:
        """Return the laws whose search has not ended; an interrupted one has a row, too."""
        return super().missing([row for row in rows if row.complete])

    def rows(
        self, cells: Sequence[StudyCell[TunedLaw]], runner: CellRunner[TunedLaw]
    ) -> Iterator[TunedLaw]:
        """Yield the row of each law; of one whose search is interrupted what is found so far."""
        for cell, law in zip(cells, self.laws, strict=True):
            row = runner.read(cell)
            if row is not None:
                runner.progress(cell.name, self.runs)
                yield row
                continue

            tuning = LawTuning(self, law, cell, runner)
            try:
                row = tuning.tuned()
            except KeyboardInterrupt:
                if tuning.designs:
                    yield tuning.row(complete=False)
                raise
            runner.write(cell, row)
            yield row


def _numbers_of(law: TunableLaw) -> tuple[str, ...]:
    """Return a law and its numbers, by which what is stored of it is named."""
    return law.name, repr(law.table), repr(law.numbers)


def _refuse_measuring(law: str, _: Any) -> TunedLaw:
    """Refuse to measure a cell alone: its batches are stored, too."""
    raise NotImplementedError(f"{law}: see TuneStudy.rows")


class LawTuning:
    """Tuning of a law, batch by batch; each is stored.

    Attributes:
        designs: Designs that have been tried.
    """

    def __init__(
        self,
        study: TuneStudy,
        law: TunableLaw,
        cell: StudyCell[TunedLaw],
        runner: CellRunner[TunedLaw],
    ) -> None:
        """Begin without a run.

        Args:
            study: The study.
            law: The law.
            cell: Its cell.
            runner: Has the folder of what is finished.
        """
        self.designs: list[TriedDesign] = []
        self._study = study
        self._law = law
        self._cell = cell
        self._runner = runner
        self._store = PieceStore(runner.folder, Rows(TriedDesigns))
        self._batches = 0
        self._runs = 0
        self._measure = Measure(law, list(study.conditions), races=study.races)
        self._search = Search(
            self,
            ranges_of(law.numbers),
            start_of(law.numbers),
            budget=study.runs,
            target=math.log(study.target_share),
            seed=study.seed,
        )

    @property
    def runs_of_point(self) -> int:
        """Runs of a design at most."""
        return self._measure.runs_of_point

    def __call__(self, points: Array, beat: Array) -> tuple[Array, int]:
        """Return the values of designs and their number of runs: read, or run and stored."""
        piece = self._piece([points.tolist(), beat.tolist()])
        self._batches += 1
        batch = self._store.read(piece) if self._runner.resume else None
        if batch is None:
            batch = self._measure.tried(points, beat)
            self._store.write(piece, batch)

        first = not self.designs
        self.designs += batch.designs
        self._runs += batch.runs
        if first:
            self._refuse_impossible()
            self._sort_conditions()
        self._runner.progress(f"{self._law.name}: {self._words()}", batch.runs)
        return batch.values, batch.runs

    def _piece(self, asked: Any) -> Piece:
        """Return a batch among stored pieces."""
        depends_on = [self._cell.depends_on, _numbers_of(self._law), self._batches, asked]
        return Piece.named_by(depends_on, f"batch {self._batches} of {self._law.name}")

    def _refuse_impossible(self) -> None:
        """Refuse a law none of whose first designs can be made."""
        reasons = [design.refused for design in self.designs]
        if all(reasons):
            designs = counted(len(reasons), "design")
            raise ArgumentError(
                f"law {self._law.name}: none of {designs} within the ranges can be "
                f"made: {reasons[0]}"
            )

    def _sort_conditions(self) -> None:
        """Put the condition first that is the hardest for the first designs: it decides races."""
        worst = dict.fromkeys(self._measure.limits, 0.0)
        for design in self.designs:
            for name, shares in design.shares.items():
                worst[name] += math.log(max(1e-6, min(max(shares.values()), 1e6)))
        self._measure.conditions.sort(key=lambda item: -worst[item.name])

    def _words(self) -> str:
        """The best share so far, in words."""
        return f"{self.designs[self._best].share:.3g} of the tightest limit"

    @property
    def _best(self) -> int:
        """Index of the best design."""
        values = [design.value if design.complete else math.inf for design in self.designs]
        return int(np.argmin(values))

    def tuned(self) -> TunedLaw:
        """Search, judge the best design on other draws, and return the row."""
        self._search.run()
        # Those of the search that were not needed.
        self._runner.progress(f"{self._law.name}: judged", self._study.runs - self._runs)
        return self.row(complete=True)

    def row(self, *, complete: bool) -> TunedLaw:
        """Return the row of what is found so far.

        Args:
            complete: Whether the search has ended, so that its best design is judged.
        """
        best = self.designs[self._best]
        found = self._law.values_at(np.array(best.point))
        # Judged as the case file will have them.
        values = {number.name: number.rounded(found[number.name]) for number in self._law.numbers}
        before: list[Verdict] = []
        after: list[Verdict] = []
        if complete:
            held_out = (HELD_OUT, self._study.held_out)
            before = self._measure.judged(self._law.as_in_file, AS_IN_FILE, *held_out)
            after = self._measure.judged(self._law.designed(values), TUNED, *held_out)
        return TunedLaw(
            law=self._law.name,
            numbers=self._number_rows(values),
            share=best.share,
            history=[
                (found.runs, self.designs[found.index].share) for found in self._search.history
            ],
            designs=self.designs,
            best=self._best,
            runs=self._runs,
            before=before,
            after=after,
            complete=complete,
        )

    def _number_rows(self, values: dict[str, float]) -> list[TunedNumberRow]:
        """Numbers of the law before and after."""
        ranges = self._search.ranges
        best = np.array(self.designs[self._best].point)
        at_end = ranges.at_end(best)
        grown = {coordinate for coordinate, _ in ranges.grown}
        return [
            TunedNumberRow(
                path=number.name,
                unit=number.number.unit,
                before=number.start,
                after=values[number.name],
                low=number.value(float(ranges.low[index])),
                high=number.value(float(ranges.high[index])),
                grown=index in grown,
                at_end=bool(at_end[index]),
                logarithmic=number.logarithmic,
            )
            for index, number in enumerate(self._law.numbers)
        ]


def tune_study(
    target: str,
    laws: Sequence[str],
    numbers: Sequence[str] = (),
    *,
    conditions: Sequence[str] = (),
    runs: int = 3000,
    draws: int = 4,
    held_out: int = 20,
    plants: int = 0,
    seed: int = 0,
) -> TuneStudy:
    """Return a target with the laws and the numbers that are tuned.

    Args:
        target: A system, which means its machine, ``SYSTEM/CASE``, or the path of a case file.
        laws: Names of laws.
        numbers: Numbers and their ranges, such as ``laws.mine.k=0.1..100``.
        conditions: Names of the conditions; all by default.
        runs: Runs of a law at most.
        draws: Draws that designs are tuned on.
        held_out: Other draws that they are judged on.
        plants: Random plants of ``[[uncertain]]`` that designs are tuned on, too.
        seed: Seed of the searches and of the plants.

    Raises:
        ArgumentError: If there is no such target, law, number or condition, or nothing is required.
    """
    experiment = case_for(target, MACHINE)
    asked = tuning_conditions(experiment, conditions, draws)
    if plants:
        asked.append(uncertain_plants(experiment, plants, seed))
        _require_plants(asked[-1], [*range(plants), *range(HELD_OUT, HELD_OUT + held_out)])
    if seed < 0:
        raise ArgumentError(f"--seed {seed} must be 0 at least")
    least = sum(item.draws for item in asked)
    if runs < least:
        raise ArgumentError(f"--runs {runs} must be {least} at least, those of one design")
    tunable = tunable_laws(experiment, laws, numbers)
    for law in tunable:
        # A law of which no run can judge anything is refused before all work.
        Measure(law, asked)
    return TuneStudy(
        experiment=experiment,
        laws=tunable,
        conditions=asked,
        runs=runs,
        draws=draws,
        held_out=held_out,
        seed=seed,
    )


def _require_plants(item: TuningCondition, numbers: Iterable[int]) -> None:
    """Refuse a condition one of whose plants cannot be made."""
    path = item.condition.experiment.path
    for number in numbers:
        with placed(f"{path}: random plant {number} of [[uncertain]]: "):
            case = item.case(number)
            # A model is compiled when something of it is asked.
            case.input_limits(case.plant(case.nominal.truest))
