"""The worst disturbance within a bound, for each law of a case."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements import KINDS
from grosmc_mj.experiments.requirements.judging import of_laws
from grosmc_mj.experiments.requirements.recovers_within import RecoversWithin
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.experiments.requirements.signals import signals_of
from grosmc_mj.experiments.requirements.transient import SettlesWithin
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.wording import counted, unit_after
from grosmc_mj.output.results.result import finite
from grosmc_mj.studies.disturbance.bounded import BoundedDisturbance, bounded_disturbance
from grosmc_mj.studies.disturbance.row import BETTER, ENDED, STEP, WorstDisturbance
from grosmc_mj.studies.disturbance.signal_search import EnoughError, SignalSearch
from grosmc_mj.studies.study import Advance, CellRunner, Study, StudyCell, dependencies
from grosmc_mj.studies.sweep.runs import Row, recorded_runs, run_rows
from grosmc_mj.studies.sweep.search import largest_passing
from grosmc_mj.studies.target import BENCH, UNDER_LOAD, Condition, case_for

# Shares of the limits with N and with 2 N pieces that agree.
AGREES = 0.05
_MOST_PIECES = 640
# Runs of the flips for each piece.
_FLIPS = 10
# Width of the range of the largest bound, over its lower end; the largest bound that is tried, and
# the smallest, in parts of --bound.
_WIDTH = 0.05
_MOST = 1000.0
_LEAST = 1e-6
# Stands for all requirements but the input's, as the help prints it.
_ANY = "any"
# Key of the requirement on recoveries, and the required times that are left for one.
_RECOVERS = RecoversWithin.key
_RECOVERIES = 2
# The smallest share that is not kept.
_BEYOND = float(np.nextafter(1.0, 2.0))


@dataclass(frozen=True, eq=False)
class DisturbanceStudy(Study[WorstDisturbance]):
    """Search for the worst disturbance of each law of a case.

    Attributes:
        disturbance: What is known of the disturbance.
        requirement: Key of the requirements that are to be missed; empty for all of the task.
        pieces: Number of pieces to begin with.
        bounded: Whether the largest bound is searched, too.
        threads: Threads of the runs; 0 for all cores.
    """

    kind = "disturbance"
    row = WorstDisturbance

    disturbance: BoundedDisturbance
    requirement: str = ""
    pieces: int = 40
    bounded: bool = False
    threads: int = 0

    @property
    def experiment(self) -> Experiment:
        """The case without the disturbance."""
        return self.disturbance.experiment

    @property
    def case(self) -> Experiment:
        """The experiment."""
        return self.experiment

    @property
    def plant(self) -> PlantName:
        """Plant of the search: equations where they are the whole machine."""
        nominal = self.experiment.nominal
        if "corrected" in nominal.names and not self.experiment.on_machine:
            return "corrected"
        return nominal.truest

    def limits(self, law: str) -> tuple[Requirement, ...]:
        """Return the requirements of a law that the disturbance is to miss."""
        limits = of_laws(self.experiment.limits, {law})
        return tuple(limit for limit in limits if not self._why_not_asked(limit, law))

    def _why_not_asked(self, limit: Requirement, law: str) -> str:
        """Return the reason why a requirement of a law is not searched; empty if it is."""
        if self.requirement and limit.key != self.requirement:
            return "another one is named"
        if isinstance(limit, SettlesWithin):
            return (
                "this disturbance may act after any settling: require recovers_within, and search "
                f"it with --requirement {_RECOVERS}"
            )
        if self.requirement:
            return ""
        if limit.of_onsets:
            return (
                "it is of a disturbance that ends, and this one may act at any time: search it "
                f"alone, with --requirement {limit.key}"
            )

        error = self.experiment.law(self.plant, law).design
        inputs = {signal.name for signal in self.experiment.nominal.system.inputs}
        of_inputs = error is not None and inputs.issuperset(limit.watched(error.error))
        return "it is of the input alone" if limit.of_actuators or of_inputs else ""

    def _reasons(self, laws: Sequence[str]) -> list[str]:
        """Return each requirement of laws that is not searched, with the reason."""
        reasons: dict[str, None] = {}
        for law in laws:
            for limit in of_laws(self.experiment.limits, {law}):
                reason = self._why_not_asked(limit, law)
                if reason:
                    reasons[f"{limit.words}: {reason}"] = None
        return list(reasons)

    @property
    def not_asked(self) -> list[str]:
        """A line for each requirement that is not searched, unless one is named."""
        if self.requirement:
            return []
        return [f"not asked: {reason}" for reason in self._reasons(self.experiment.controllers)]

    @property
    def about_recovery(self) -> list[str]:
        """A line on the time that counts as recovery, if that is searched."""
        end = self.disturbance.end
        if not math.isfinite(end):
            return []
        return [
            f"recovery: counted from {end:g} s, where each disturbance ends, the compared one at "
            f"the latest; a share of {_RECOVERIES:g}: not within the band again. run counts it "
            "from each onset, too"
        ]

    def with_required_laws(self, named: Sequence[str]) -> DisturbanceStudy:
        """Return the study of the named laws, or else of those of which something is required.

        Raises:
            ArgumentError: If nothing is required of a named law, or of any.
        """
        laws = self.experiment.controllers
        required = [law for law in laws if self.limits(law)]
        # The reason is that of a law of which something is required.
        judged = [law for law in laws if of_laws(self.experiment.limits, {law})]
        for law in named or required[:1] or judged[:1] or laws[:1]:
            if law not in required:
                raise ArgumentError(f"{self.experiment.path}: {self._why_nothing_of(law)}")
        experiment = self.experiment.changed(laws=named or required)
        study = replace(self, disturbance=replace(self.disturbance, experiment=experiment))
        return study.ending() if self.requirement == _RECOVERS else study

    def _why_nothing_of(self, law: str) -> str:
        """Return why there is nothing to search for a law."""
        limits = of_laws(self.experiment.limits, {law})
        if self.requirement and self.requirement not in [limit.key for limit in limits]:
            return (
                f"{self.requirement} is not required of {law}: write it into a [[requirement]] of "
                "a case file of your own"
            )
        words = f"nothing that may be searched is required of {law}"
        return "; ".join([words, *self._reasons([law])])

    def ending(self) -> DisturbanceStudy:
        """Return the study of a disturbance that ends, so that the loop can recover from it.

        It ends twice the longest required time before the run does: a recovery that takes longer
        than required is told up to that.

        Raises:
            ArgumentError: If the runs are too short, or the disturbance has a bounded rate.
        """
        limits = [limit for law in self.experiment.controllers for limit in self.limits(law)]
        needed = _RECOVERIES * max(limit.number for limit in limits)
        end = self.experiment.duration - needed
        if end < self.disturbance.timestep:
            raise ArgumentError(
                f"--requirement {_RECOVERS}: the disturbance ends {needed:g} s before the run "
                f"does, and a run has {self.experiment.duration:g} s: make run.duration longer"
            )
        if math.isfinite(self.disturbance.slew):
            raise ArgumentError(
                f"--requirement {_RECOVERS}: the disturbance ends at once: leave out --slew"
            )
        return replace(self, disturbance=replace(self.disturbance, end=end))

    def configuration(self) -> dict[str, Any]:
        """Return all that its answers depend on besides the case."""
        disturbance = self.disturbance
        return {
            "case": self.experiment.target,
            "on": disturbance.place,
            "amplitudes": list(disturbance.unit_disturbance.amplitudes),
            "bound": {"value": disturbance.bound, "unit": disturbance.unit},
            "slew": finite(disturbance.slew),
            "end": finite(disturbance.end),
            "starts": {str(index): bound for index, bound in disturbance.starts.items()},
            "requirement": self.requirement,
            "pieces": self.pieces,
            "plant": self.plant,
        }

    def cells(self) -> list[StudyCell[WorstDisturbance]]:
        """Return a cell for each law, without its largest bound."""
        condition = Condition(UNDER_LOAD, self.experiment.title, self.experiment)
        depends_on = dependencies(self.configuration(), [condition])
        return [
            StudyCell(law, (law, False), depends_on, partial(self.find, law))
            for law in self.experiment.controllers
        ]

    def rows(
        self,
        cells: Sequence[StudyCell[WorstDisturbance]],
        runner: CellRunner[WorstDisturbance],
    ) -> Iterator[WorstDisturbance]:
        """Yield the row of each law; with its largest bound it is stored once more."""
        for cell in cells:
            worst = runner.row(cell)
            if self.bounded:
                measure = partial(self._with_bound, worst)
                worst = runner.row(replace(cell, key=(worst.law, True), measure=measure))
            runner.progress(cell.name)
            yield worst

    def _with_bound(self, worst: WorstDisturbance, advance: Advance) -> WorstDisturbance:
        """Return a row with the largest bound."""
        if not worst.kept_when_calm:
            return worst
        kept, failed = self.largest(worst.law, advance)
        bounds = {"largest_kept": kept, "smallest_failed": finite(failed)}
        return worst.model_copy(update=bounds)

    # -- runs --------------------------------------------------------------------------------------

    def shares(
        self, law: str, cases: Sequence[Experiment], plant: PlantName | None = None
    ) -> Array:
        """Return the largest measured over allowed value of runs of cases, (n,)."""
        rows = [Row(law, case=case) for case in cases]
        outcomes = run_rows(
            self.experiment, rows, self.limits(law), plant or self.plant, threads=self.threads
        )
        return 1 - outcomes["order"].astype(float)

    def responses(self, law: str, disturbance: BoundedDisturbance, signals: Array) -> Array:
        """Return courses of all quantities that the requirements are about, (k, M)."""
        rows = [Row(law, case=disturbance.case_of(signal)) for signal in signals]
        size = signals.shape[1]
        steps = round(self.experiment.duration / disturbance.timestep)
        instants = np.unique(np.linspace(steps / size, steps, size).round().astype(int))

        courses = []
        for run, controller in recorded_runs(self.experiment, rows, self.plant, self.threads):
            names = watched(self.limits(law), controller.designed.error)
            course_of = signals_of(run, controller, names)
            # The last values of a run that ended early stand for those that are missing.
            reached = np.minimum(instants, len(run.time) - 1)
            courses.append(np.concatenate([course_of[name][reached] for name in names]))
        return np.array(courses)

    # -- the search --------------------------------------------------------------------------------

    def search(
        self,
        law: str,
        disturbance: BoundedDisturbance,
        pieces: int,
        enough: float = math.inf,
        advance: Advance = lambda _: None,
    ) -> SignalSearch:
        """Return a search with so many pieces that has not begun.

        Args:
            law: Name of the law.
            disturbance: The disturbance, whose bound may be another one.
            pieces: Number of pieces.
            enough: Share at which it ends.
            advance: Told how far it is.
        """
        bound = f"{disturbance.bound:.3g}{unit_after(disturbance.unit)}"
        name = f"{law}: {bound}, {counted(pieces, 'piece')}"
        return SignalSearch(
            shares=lambda signals: self.shares(law, list(map(disturbance.case_of, signals))),
            responses=lambda signals: self.responses(law, disturbance, signals),
            size=pieces + len(disturbance.starts),
            enough=enough,
            advance=lambda text: advance(f"{name}, {text}"),
        )

    def find(self, law: str, advance: Advance) -> WorstDisturbance:
        """Find the worst disturbance of a law: N pieces and 2 N, until they agree.

        Args:
            law: Name of the law.
            advance: Told how far the search is.
        """
        (calm_share,) = self.shares(law, [self.experiment])
        if calm_share > ENDED:
            return self._without_search(law, float(calm_share))

        pieces = self.pieces
        search = self.searched(law, pieces, advance=advance)
        runs = search.runs
        change = math.inf
        while change > AGREES and search.share <= ENDED and self._divisible(pieces):
            pieces *= 2
            finer = self.searched(law, pieces, search, advance)
            change = _relative_change(search.share, finer.share)
            runs += finer.runs
            search = finer

        control = self.search(law, self.disturbance, pieces, advance=advance)
        control.telegraphs(runs, np.random.default_rng(0))
        best = control if control.share > search.share * BETTER else search
        return self._row(
            law,
            best.best,
            best.share,
            pieces=pieces,
            calm_share=float(calm_share),
            search_share=search.share,
            telegraph_share=control.share,
            runs=runs,
            change=change,
        )

    def _without_search(self, law: str, share: float) -> WorstDisturbance:
        """Return the row of a law whose run ends early without any disturbance."""
        nothing = np.zeros(self.pieces + len(self.disturbance.starts))
        return self._row(
            law,
            nothing,
            share,
            pieces=self.pieces,
            calm_share=share,
            search_share=share,
            telegraph_share=share,
            runs=1,
            change=0.0,
        )

    def searched(
        self,
        law: str,
        pieces: int,
        coarser: SignalSearch | None = None,
        advance: Advance = lambda _: None,
    ) -> SignalSearch:
        """Return a search that has ended.

        Args:
            law: Name of the law.
            pieces: Number of pieces.
            coarser: Search with half as many, from whose worst signal it goes on.
            advance: Told how far it is.
        """
        search = self.search(law, self.disturbance, pieces, advance=advance)
        if coarser is not None:
            halves, deviations = np.split(coarser.best, [pieces // 2])
            search.judge(np.concatenate([np.repeat(halves, 2), deviations])[None])
        search.pulses()
        search.flips(_FLIPS * search.size)
        return search

    def _divisible(self, pieces: int) -> bool:
        """Whether pieces can be halved: not below a timestep."""
        shorter = self.disturbance.hold(2 * pieces) < self.disturbance.hold(pieces)
        return shorter and 2 * pieces <= _MOST_PIECES

    def _row(self, law: str, signal: Array, share: float, **found: Any) -> WorstDisturbance:
        """Return the row of a signal: what it is compared with, and the nearest requirement.

        Args:
            law: Name of the law.
            signal: The signal.
            share: Its share.
            found: Further fields of the row.
        """
        case = self.disturbance.case_of(signal)
        limits = self.limits(law)
        rows = [Row(law, case=case), Row(law, case=self.disturbance.compared_case)]
        outcomes = run_rows(self.experiment, rows, limits, self.plant, threads=self.threads)
        verdict = outcomes.verdict(0)

        confirmed = None
        truest = self.experiment.nominal.truest
        if truest != self.plant:
            confirmed = float(self.shares(law, [case], truest)[0])
        words = {limit.name: limit.words for limit in limits}
        nearest = verdict.tightest or limits[0].name
        return WorstDisturbance(
            law=law,
            step=STEP,
            condition=UNDER_LOAD,
            # Results of two places are compared apart.
            group=self.disturbance.place,
            share=share,
            tightest=nearest,
            ended=verdict.ended,
            shares=verdict.shares,
            kept_draws=int(share <= 1),
            words=words[nearest],
            bound=self.disturbance.bound,
            signal=signal.tolist(),
            compared_share=1 - float(outcomes["order"][1]),
            confirmed=confirmed,
            **found,
        )

    def largest(self, law: str, advance: Advance) -> tuple[float, float]:
        """Return the largest bound up to which all was kept, and the smallest at which not.

        All must be kept without a disturbance.
        """

        def passes(factor: float) -> bool:
            disturbance = self.disturbance.scaled(factor)
            search = self.search(law, disturbance, self.pieces, _BEYOND, advance)
            try:
                search.pulses()
                search.flips(_FLIPS * search.size)
            except EnoughError:
                pass
            return search.share <= 1

        low, high = largest_passing(passes, 0.0, 1.0, _MOST, _WIDTH, _LEAST)
        return low * self.disturbance.bound, high * self.disturbance.bound


def _relative_change(coarse: float, fine: float) -> float:
    """Difference of two shares in parts of the larger one; 0 if both are nothing."""
    if coarse == fine:
        return 0.0
    return abs(fine - coarse) / max(fine, coarse)


def watched(limits: Sequence[Requirement], error: Any) -> list[str]:
    """Return the signals that requirements are about, whose responses tell signs."""
    names: list[str] = []
    for limit in limits:
        names += limit.watched(error)
    return list(dict.fromkeys(names))


def disturbance_study(
    target: str,
    on: str,
    bound: str,
    laws: Sequence[str] = (),
    *,
    axis: str = "",
    slew: str = "",
    starts: Sequence[str] = (),
    requirement: str = "",
    pieces: int = 40,
    bounded: bool = False,
) -> DisturbanceStudy:
    """Return the study of a target: of a system it is the case of its bench.

    Args:
        target: System, case or case file.
        on: See ``bounded_disturbance``, as for ``bound``, ``axis``, ``slew`` and ``starts``.
        bound: Largest magnitude with its unit.
        laws: Laws of the file; all its controllers by default.
        axis: Axis of a force or torque.
        slew: Largest rate with its unit.
        starts: Bounds of the start.
        requirement: See ``DisturbanceStudy``, as for ``pieces`` and ``bounded``; ``any`` for none.
        pieces: Number of pieces to begin with.
        bounded: Whether the largest bound is searched, too.

    Raises:
        ArgumentError: If something does not fit.
    """
    if not 2 <= pieces <= _MOST_PIECES:
        raise ArgumentError(f"--pieces {pieces} must be from 2 to {_MOST_PIECES}")
    experiment = case_for(target, BENCH).changed(laws=laws)
    disturbance = bounded_disturbance(experiment, on, bound, axis=axis, slew=slew, starts=starts)
    if requirement == _ANY:
        requirement = ""
    if requirement:
        require_known("requirement", requirement, [_ANY, *(kind.key for kind in KINDS)])
    study = DisturbanceStudy(disturbance, requirement, pieces, bounded)
    return study.with_required_laws(laws)
