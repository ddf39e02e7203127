"""The worst disturbance within a bound: on a body, an input or a sensor of a loop."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from pydantic import BaseModel, ConfigDict

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, value_text
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.document import case_document
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import read_content
from grosmc_mj.experiments.file.user_code import is_named, named_in
from grosmc_mj.experiments.file.values import states_of
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.files import atomic_write
from grosmc_mj.plants import System
from grosmc_mj.plants.system import rate_unit
from grosmc_mj.requirements import KINDS
from grosmc_mj.requirements.judging import of_laws
from grosmc_mj.requirements.requirement import Requirement
from grosmc_mj.requirements.signals import named_units, signals_of
from grosmc_mj.results.document import json_text
from grosmc_mj.results.result import (
    KEPT,
    NOT_KEPT,
    Answer,
    LineChart,
    ReportTable,
    Series,
    StudyVerdict,
    Value,
    finite,
    result,
)
from grosmc_mj.results.tables import Table as ResultTable
from grosmc_mj.results.tables import names, numbers, table, words
from grosmc_mj.simulation.disturbances import (
    AnyDisturbance,
    Constant,
    Disturbance,
    InputDisturbance,
    OutputDisturbance,
    Pulse,
    SineFrom,
    Table,
)
from grosmc_mj.studies.studied import case_for
from grosmc_mj.sweep.plant_file import written
from grosmc_mj.sweep.runs import Row, recorded_runs, run_rows
from grosmc_mj.sweep.search import largest_passing
from grosmc_mj.sweep.signal_search import FoundError, SignalSearch
from grosmc_mj.units import number_in
from grosmc_mj.versions import source_digest, versions

# Shares of the limits with N and with 2 N pieces that agree.
_AGREES = 0.05
_MOST_PIECES = 640
# Runs of the flips for each piece.
_FLIPS = 10
# Width of the range of the largest bound, and the largest one that is tried, in parts of --bound.
_WIDTH = 0.05
_MOST = 1000.0
# Share beyond that of any run that reached its end.
_ENDED = 1e6
# The smallest share that is not kept.
_BEYOND = float(np.nextafter(1.0, 2.0))
# The control wins by more than rounding.
_BETTER = 1 + 1e-9
# Values in a piece of a signal with a bounded rate.
_LEVELS = 20
_AXES = "xyz"
_POINTS = 400


# -- the disturbance -------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class BoundedDisturbance:
    """A disturbance of which only its bound is known.

    Attributes:
        experiment: The case without a disturbance at this place.
        unit_disturbance: The disturbance at its bound.
        unit: Unit of the bound.
        bound: The bound, in its unit.
        slew: Bound of its rate, in the unit a second; infinite for none.
        starts: Bound of the deviation of each state at the start, by index.
        own: The case's own disturbance at this place; None if there is none.
        own_index: Its place among the case's disturbances.
    """

    experiment: Experiment
    unit_disturbance: AnyDisturbance
    unit: str
    bound: float
    slew: float = math.inf
    starts: Mapping[int, float] = field(default_factory=dict)
    own: AnyDisturbance | None = None
    own_index: int = -1

    @property
    def place(self) -> str:
        """Name of the body, the input or the state."""
        return self.unit_disturbance.of

    @property
    def timestep(self) -> float:
        """Timestep of the runs [s]."""
        return self.experiment.settings.timestep

    @property
    def levels(self) -> int:
        """Number of values of a piece."""
        return 1 if math.isinf(self.slew) else _LEVELS

    def hold(self, pieces: int) -> float:
        """Time for which a value is held: whole timesteps, so that all pieces fill a run [s]."""
        seconds = self.experiment.duration / pieces / self.levels
        return math.ceil(seconds / self.timestep - 1e-9) * self.timestep

    def profile(self, pieces: Array) -> Table:
        """Return the course in time of pieces, (N,).

        With a bounded rate a piece is the slope, and the signal stays within its bound.
        """
        hold = self.hold(len(pieces))
        if math.isinf(self.slew):
            return Table(tuple(pieces.tolist()), hold)

        values = [0.0]
        for slope in pieces * self.slew / self.bound:
            rise = slope * hold * np.arange(1, self.levels + 1)
            values += np.clip(values[-1] + rise, -1.0, 1.0).tolist()
        return Table(tuple(values[1:]), hold)

    def case_with(self, profile: Any, deviations: Sequence[float] = ()) -> Experiment:
        """Return the case with the disturbance of a profile.

        Args:
            profile: Function of t, in parts of the bound.
            deviations: Deviations of the start in parts of their bounds; none by default.
        """
        x0 = list(self.experiment.x0)
        for (index, bound), part in zip(self.starts.items(), deviations, strict=False):
            x0[index] += part * bound
        unit_disturbance: Any = self.unit_disturbance
        disturbance = replace(unit_disturbance, profile=profile, label=f"worst on {self.place}")
        disturbances = (*self.experiment.disturbances, disturbance)
        return self.experiment.varied(x0=tuple(x0), disturbances=disturbances)

    def case_of(self, signal: Array) -> Experiment:
        """Return the case with a signal of the search: pieces, then deviations of the start."""
        count = len(signal) - len(self.starts)
        return self.case_with(self.profile(signal[:count]), signal[count:].tolist())

    def scaled(self, factor: float) -> BoundedDisturbance:
        """Return a copy with the bounds of value and rate times a factor."""
        return replace(
            self,
            unit_disturbance=self.unit_disturbance.scaled(factor),
            bound=factor * self.bound,
            slew=factor * self.slew,
        )

    @property
    def compared(self) -> tuple[str, Any]:
        """Name and profile of what it is compared with: the case's own, or a constant."""
        if self.own is None:
            return "a constant one", Constant()
        profile = self.own.profile
        if isinstance(profile, Pulse):
            return f"a {profile.stop - profile.start:g} s pulse", profile
        if isinstance(profile, SineFrom):
            return f"a sine of {profile.frequency / 2 / math.pi:.3g} Hz", profile
        return "the file's own course", profile


def bounded_disturbance(
    experiment: Experiment,
    on: str,
    bound: str,
    *,
    axis: str = "",
    slew: str = "",
    starts: Sequence[str] = (),
) -> BoundedDisturbance:
    """Read what is known of a disturbance.

    Args:
        experiment: The case.
        on: A body, an input, or a state whose measurement is disturbed.
        bound: Its largest magnitude with its unit; on a body a force or a torque.
        axis: x, y or z of a force or torque; by default as in the case's own disturbance on the
            body, else x of a force and y of a torque.
        slew: Largest magnitude of its rate with its unit; unlimited by default.
        starts: ``STATE=BOUND`` each, by which the start may deviate.

    Raises:
        ArgumentError: If there is no such place, or a unit does not fit.
    """
    system = experiment.nominal.system
    inputs = {signal.name: signal.unit for signal in system.inputs}
    states = {state.name: state.unit for state in system.states}
    require_known("body, input or state", on, [*system.bodies, *inputs, *states])
    unit = inputs.get(on) or states.get(on) or ""
    if on in system.bodies:
        unit = _unit_on_body(bound)
    size = _magnitude("--bound", bound, unit)

    kind = _kind_of(on, system)
    own = None
    own_index = -1
    kept = list(experiment.disturbances)
    for index, disturbance in enumerate(experiment.disturbances):
        if type(disturbance) is kind and disturbance.of == on:
            own = kept.pop(index)
            own_index = index
            break

    if kind is Disturbance:
        unit_disturbance = Disturbance(on, _wrench(own, unit, size, axis))
    else:
        unit_disturbance = kind(on, size)
        if axis:
            raise ArgumentError(f"--axis {axis}: {on} is no body")
    return BoundedDisturbance(
        experiment=experiment.varied(disturbances=tuple(kept)),
        unit_disturbance=unit_disturbance,
        unit=unit,
        bound=size,
        slew=_magnitude("--slew", slew, rate_unit(unit)) if slew else math.inf,
        starts=_start_bounds(starts, system),
        own=own,
        own_index=own_index,
    )


def _kind_of(on: str, system: System) -> Any:
    """Return the class of disturbances at a place."""
    if on in system.bodies:
        return Disturbance
    if on in [signal.name for signal in system.inputs]:
        return InputDisturbance
    return OutputDisturbance


def _unit_on_body(bound: str) -> str:
    """Return N or N m, whichever a bound has."""
    for unit in ("N", "N m"):
        try:
            number_in(bound, unit)
        except ArgumentError:
            continue
        return unit
    raise ArgumentError(
        f"--bound {value_text(bound)}: on a body it is a force or a torque, such as 2 N or 1 N m"
    )


def _magnitude(option: str, text: str, unit: str) -> float:
    """Return a positive number with its unit."""
    try:
        number = number_in(text, unit)
    except ArgumentError as error:
        raise ArgumentError(f"{option}: {error}") from None
    if number <= 0:
        raise ArgumentError(f"{option} {value_text(text)} must be positive")
    return number


def _wrench(own: AnyDisturbance | None, unit: str, bound: float, axis: str) -> Any:
    """Return the wrench of a force or torque at its bound, (6,)."""
    first = 0 if unit == "N" else 3
    direction = np.zeros(3)
    if axis:
        require_known("axis", axis, tuple(_AXES))
        direction[_AXES.index(axis)] = 1.0
    elif own is not None and any(own.amplitudes[first : first + 3]):
        direction = np.array(own.amplitudes[first : first + 3])
        direction = direction / np.linalg.norm(direction)
    else:
        direction[0 if unit == "N" else 1] = 1.0
    wrench = np.zeros(6)
    wrench[first : first + 3] = bound * direction
    return tuple(wrench.tolist())


def _start_bounds(starts: Sequence[str], system: System) -> dict[int, float]:
    """Return the bounds of the deviations of the start by index of the state."""
    values = {}
    for text in starts:
        name, equals, bound = text.partition("=")
        if not equals:
            raise ArgumentError(f'--start {value_text(text)}: write "STATE=BOUND"')
        values[name.strip()] = bound.strip()
    bounds = states_of(values, system, "--start")
    for index, bound in bounds.items():
        if bound <= 0:
            raise ArgumentError(f"--start: the bound of {system.states[index].name} must be > 0")
    return bounds


# -- the search ------------------------------------------------------------------------------------


class Found(BaseModel):
    """The worst disturbance of a law that was found.

    Attributes:
        law: Name of the law.
        bound: Bound, in its unit.
        signal: Pieces and deviations of the start, in parts of their bounds.
        pieces: Number of pieces.
        share: Measured over allowed value of the requirement that is nearest to its limit.
        requirement: That requirement in words.
        compared_share: The share under the disturbance that it is compared with.
        search_share: The largest share by pulses and flips.
        telegraph_share: The largest share under random telegraph signals.
        runs: Runs of pulses and flips, and as many telegraph signals.
        change: Change of the share from half the pieces to all, in parts of it.
        confirmed: The share in MuJoCo; None where that made the runs, or there is none.
        largest: The largest bound up to which all was kept, and the smallest at which not.
    """

    model_config = ConfigDict(frozen=True)

    law: str
    bound: float
    signal: list[float]
    pieces: int
    share: float
    requirement: str
    compared_share: float
    search_share: float
    telegraph_share: float
    runs: int
    change: float
    confirmed: float | None = None
    largest: tuple[float, float] | None = None

    @property
    def switches(self) -> int:
        """Number of changes of its sign."""
        signs = np.sign(self.signal[: self.pieces])
        return int(np.count_nonzero(np.diff(signs)))

    @property
    def telegraph_won(self) -> bool:
        """Whether the control found a worse signal than the search."""
        return self.telegraph_share > self.search_share * _BETTER


@dataclass(frozen=True, eq=False)
class DisturbanceStudy:
    """Search for the worst disturbance of each law of a case.

    Attributes:
        disturbance: What is known of the disturbance.
        requirement: Key of the requirements that are to be missed; empty for all of the task.
        pieces: Number of pieces to begin with.
        threads: Threads of the runs; 0 for all cores.
    """

    disturbance: BoundedDisturbance
    requirement: str = ""
    pieces: int = 40
    threads: int = 0

    @property
    def experiment(self) -> Experiment:
        """The case without the disturbance."""
        return self.disturbance.experiment

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
        if self.requirement:
            return tuple(limit for limit in limits if limit.key == self.requirement)
        return tuple(limit for limit in limits if not limit.of_actuators)

    def with_required_laws(self, named: Sequence[str]) -> DisturbanceStudy:
        """Return the study of the named laws, or else of those of which something is required.

        Raises:
            ArgumentError: If nothing is required of a named law, or of any.
        """
        required = [law for law in self.experiment.controllers if self.limits(law)]
        for law in named or required[:1] or self.experiment.controllers[:1]:
            if law not in required:
                words = "nothing is required"
                if self.requirement:
                    words = f"{self.requirement} is not required"
                raise ArgumentError(f"{self.experiment.path}: {words} of {law}")
        experiment = self.experiment.with_laws(named or required)
        return replace(self, disturbance=replace(self.disturbance, experiment=experiment))

    def shares(self, law: str, cases: Sequence[Case], plant: PlantName | None = None) -> Array:
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
            watched = _watched(self.limits(law), controller.designed.error)
            course_of = signals_of(run, controller, watched)
            # The last values of a run that ended early stand for those that are missing.
            reached = np.minimum(instants, len(run.time) - 1)
            courses.append(np.concatenate([course_of[name][reached] for name in watched]))
        return np.array(courses)

    def search(
        self,
        law: str,
        disturbance: BoundedDisturbance,
        pieces: int,
        enough: float = math.inf,
    ) -> SignalSearch:
        """Return a search with so many pieces that has not begun."""
        return SignalSearch(
            shares=lambda signals: self.shares(law, list(map(disturbance.case_of, signals))),
            responses=lambda signals: self.responses(law, disturbance, signals),
            size=pieces + len(disturbance.starts),
            enough=enough,
        )

    def find(self, law: str, advance: Callable[[str], object]) -> Found:
        """Find the worst disturbance of a law: N pieces and 2 N, until they agree.

        Args:
            law: Name of the law.
            advance: Told how far the search is.
        """
        disturbance = self.disturbance
        extra = len(disturbance.starts)
        runs = 0
        before = None
        pieces = self.pieces
        while True:
            search = self.search(law, disturbance, pieces)
            if before is not None:
                coarse, deviations = np.split(before.best, [len(before.best) - extra])
                search.judge(np.concatenate([np.repeat(coarse, 2), deviations])[None])
            search.pulses()
            advance(f"{law}: {pieces} pieces, pulses {search.share:.3g}")
            search.flips(_FLIPS * search.size)
            advance(f"{law}: {pieces} pieces, flips {search.share:.3g}")

            runs += search.runs
            change = math.inf
            if before is not None:
                change = abs(search.share - before.share) / search.share
            before = search
            finest = disturbance.hold(2 * pieces) >= disturbance.hold(pieces)
            if change <= _AGREES or search.share > _ENDED or finest or 2 * pieces > _MOST_PIECES:
                break
            pieces *= 2

        control = self.search(law, disturbance, pieces)
        control.telegraphs(runs, np.random.default_rng(0))
        advance(f"{law}: {runs} telegraph signals {control.share:.3g}")
        return self._found(law, before, control, pieces, runs, change)

    def _found(
        self,
        law: str,
        search: SignalSearch,
        control: SignalSearch,
        pieces: int,
        runs: int,
        change: float,
    ) -> Found:
        """Return the result of a search, with the shares that it is compared with."""
        disturbance = self.disturbance
        best = control if control.share > search.share * _BETTER else search
        _, profile = disturbance.compared
        worst = disturbance.case_of(best.best)
        compared = self.shares(law, [disturbance.case_with(profile)])[0]
        truest = self.experiment.nominal.truest
        confirmed = None
        if truest != self.plant:
            confirmed = float(self.shares(law, [worst], truest)[0])

        limits = self.limits(law)
        outcomes = run_rows(self.experiment, [Row(law, case=worst)], limits, self.plant)
        nearest = int(np.argmin([share[0] for share in outcomes.shares]))
        return Found(
            law=law,
            bound=disturbance.bound,
            signal=best.best.tolist(),
            pieces=pieces,
            share=best.share,
            requirement=limits[nearest].words,
            compared_share=float(compared),
            search_share=search.share,
            telegraph_share=control.share,
            runs=runs,
            change=change,
            confirmed=confirmed,
        )

    def largest(self, law: str, advance: Callable[[str], object]) -> tuple[float, float]:
        """Return the largest bound up to which all was kept, and the smallest at which not.

        Raises:
            ArgumentError: If something is not kept without a disturbance.
        """
        (calm,) = self.shares(law, [self.experiment])
        if calm > 1:
            raise ArgumentError(f"{law} does not keep all without a disturbance: no bound is")

        def passes(factor: float) -> bool:
            disturbance = self.disturbance.scaled(factor)
            search = self.search(law, disturbance, self.pieces, enough=_BEYOND)
            try:
                search.pulses()
                search.flips(_FLIPS * search.size)
            except FoundError:
                pass
            advance(f"{law}: bound {disturbance.bound:.3g} {disturbance.unit}, {search.share:.3g}")
            return search.share <= 1

        low, high = largest_passing(passes, 0.0, 1.0, _MOST, _WIDTH)
        return low * self.disturbance.bound, high * self.disturbance.bound


def _watched(limits: Sequence[Requirement], error: Any) -> list[str]:
    """Return the signals that requirements are about, whose responses tell signs."""
    names: list[str] = []
    for limit in limits:
        names += limit.watched(error)
    return list(dict.fromkeys(names))


# -- finished searches -----------------------------------------------------------------------------


@dataclass(frozen=True)
class FinishedSearches:
    """Finished searches, a file each, so that an interrupted study goes on where it was.

    Attributes:
        folder: Folder of the files.
        configuration: All that they depend on besides the law, as JSON.
    """

    folder: Path
    configuration: str

    @classmethod
    def of(cls, study: DisturbanceStudy, folder: Path) -> FinishedSearches:
        """Return the finished searches of a study in a folder."""
        case = case_document(study.experiment), study.experiment.document()
        content = [configuration(study), case, versions(), source_digest()]
        return cls(folder, json_text(content))

    def _path(self, law: str, *, largest: bool) -> Path:
        key = json.dumps([self.configuration, law, largest])
        return self.folder / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.json"

    def read(self, law: str, *, largest: bool) -> Found | None:
        """Return the result of a law; None if it is missing or cannot be read."""
        try:
            text = self._path(law, largest=largest).read_text(encoding="utf-8")
            return Found.model_validate(json.loads(text))
        except (OSError, ValueError):
            return None

    def write(self, found: Found, *, largest: bool) -> None:
        """Write a result aside and rename it.

        Raises:
            SetupError: If it cannot be written.
        """
        with atomic_write(self._path(found.law, largest=largest)) as part:
            # Not by pydantic, which writes infinite numbers as null.
            part.write_text(json.dumps(found.model_dump()), encoding="utf-8")


# -- the answer ------------------------------------------------------------------------------------


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
        requirement: See ``DisturbanceStudy``, as for ``pieces``.
        pieces: Number of pieces to begin with.

    Raises:
        ArgumentError: If something does not fit.
    """
    if not 2 <= pieces <= _MOST_PIECES:
        raise ArgumentError(f"--pieces {pieces} must be from 2 to {_MOST_PIECES}")
    experiment = case_for(target, "bench").with_laws(laws)
    disturbance = bounded_disturbance(experiment, on, bound, axis=axis, slew=slew, starts=starts)
    if requirement:
        require_known("requirement", requirement, [kind.key for kind in KINDS])
    return DisturbanceStudy(disturbance, requirement, pieces).with_required_laws(laws)


def configuration(study: DisturbanceStudy) -> dict[str, Any]:
    """Return what a study depends on."""
    disturbance = study.disturbance
    return {
        "case": study.experiment.target,
        "on": disturbance.place,
        "amplitudes": list(disturbance.unit_disturbance.amplitudes),
        "bound": {"value": disturbance.bound, "unit": disturbance.unit},
        "slew": finite(disturbance.slew),
        "starts": {str(index): bound for index, bound in disturbance.starts.items()},
        "requirement": study.requirement,
        "pieces": study.pieces,
        "plant": study.plant,
    }


def words_of(study: DisturbanceStudy, found: Found) -> str:
    """Return the answer for a law in a line."""
    if found.share > _ENDED:
        return f"{found.law}: the run ends early; {found.runs} runs"
    compared, _ = study.disturbance.compared
    ratio = found.share / found.compared_share if found.compared_share > 0 else math.inf
    switches = "1 switch" if found.switches == 1 else f"{found.switches} switches"
    line = (
        f"{found.law}: {found.share:.3g} of {found.requirement}, {ratio:.2g} times {compared}; "
        f"{switches}; {found.runs} runs; telegraph {found.telegraph_share:.3g} "
        f"({found.runs})"
    )
    if found.change > _AGREES:
        line += f"; {found.pieces} pieces may be too few"
    if found.largest:
        line += f"; all is kept up to {found.largest[0]:.3g} {study.disturbance.unit}"
    return line


def verdict(study: DisturbanceStudy, rows: Sequence[Found]) -> str:
    """Return which laws keep everything under the worst disturbance that was found."""
    disturbance = study.disturbance
    keeping = [found.law for found in rows if found.share <= 1]
    return (
        f"{study.experiment.target}, {disturbance.bound:g} {disturbance.unit} on "
        f"{disturbance.place}: {len(keeping)} of {len(rows)} laws keep all under the worst "
        f"disturbance found{': ' if keeping else ''}{', '.join(keeping)}."
    )


def answer_table(study: DisturbanceStudy, rows: Sequence[Found]) -> ResultTable:
    """Return a row for each law, the one that breaks most first."""
    disturbance = study.disturbance
    compared, _ = disturbance.compared
    columns = [
        *names("law"),
        *numbers("share of\nits limit", "compared\nwith", "switches", "pieces", "runs"),
        *numbers("as many\ntelegraphs"),
        *words("worse\nis"),
        *numbers("in\nMuJoCo", "largest\nbound"),
    ]
    ordered = sorted(rows, key=lambda found: -found.share)
    texts = [_texts_of(found) for found in ordered]
    title = f"Worst disturbance within {disturbance.bound:g} {disturbance.unit}"
    legend = f"Shares: measured over allowed value. Compared with {compared}."
    return table(title, columns, texts, legend=legend)


def _texts_of(found: Found) -> list[str]:
    """Return the cells of a law."""
    return [
        found.law,
        _share_text(found.share),
        _share_text(found.compared_share),
        str(found.switches),
        str(found.pieces),
        str(found.runs),
        _share_text(found.telegraph_share),
        "telegraph" if found.telegraph_won else "search",
        _share_text(found.confirmed),
        f"{found.largest[0]:.3g}" if found.largest else "-",
    ]


def _share_text(share: float | None) -> str:
    """Write a share of a limit."""
    if share is None:
        return "-"
    return "run ends" if share > _ENDED else f"{share:.3g}"


def charts(study: DisturbanceStudy, rows: Sequence[Found]) -> list[list[LineChart]]:
    """Return for each law the worst signal over time, and the first quantity required under it."""
    return [_charts_of(study, found) for found in rows]


def _charts_of(study: DisturbanceStudy, found: Found) -> list[LineChart]:
    """Return the charts of a law."""
    disturbance = study.disturbance
    case = disturbance.case_of(np.array(found.signal))
    row = Row(found.law, case=case)
    ((run, law),) = recorded_runs(study.experiment, [row], study.plant)
    (name, *_) = _watched(study.limits(found.law), law.designed.error)
    unit = named_units(law, law.designed.sliding_unit or "1")[name]

    some = np.unique(np.linspace(0, len(run.time) - 1, _POINTS).astype(int))
    time = run.time[some].tolist()
    profile = case.disturbances[-1].profile
    values = [disturbance.bound * profile(t) for t in time[:-1]]
    course = signals_of(run, law, [name])[name][some].tolist()
    worst = LineChart(
        name=f"{found.law}: worst disturbance found",
        titles=("time [s]", f"{disturbance.place} [{disturbance.unit}]"),
        lines=[Series(name="disturbance", x=time[:-1], y=values)],
    )
    under_it = LineChart(
        name=f"{found.law}: under it",
        titles=("time [s]", f"{name} [{unit}]"),
        lines=[Series(name="under it", x=time, y=course)],
    )
    return [worst, under_it]


def disturbance_document(
    study: DisturbanceStudy, rows: Sequence[Found], *, complete: bool
) -> dict[str, Any]:
    """Return the content of disturbance_NAME.json; ``complete`` if it has every law."""
    target = study.experiment.target
    kept = all(found.share <= 1 for found in rows)
    answer = Answer(
        question=f"Worst disturbance of {target}",
        verdict=KEPT if kept else NOT_KEPT,
        words=verdict(study, rows),
        notes=[words_of(study, found) for found in rows],
    )
    standings = []
    values = []
    for found in rows:
        breaks_at = "" if found.share <= 1 else "worst disturbance"
        words_for_law = words_of(study, found)
        standings.append(
            StudyVerdict(case=target, law=found.law, breaks_at=breaks_at, words=words_for_law)
        )
        name = f"{target} {found.law} {study.disturbance.place} worst share"
        values.append(Value(name=name, value=finite(found.share), better=-1, relative=0.1))
    return result(
        "disturbance",
        configuration(study),
        seed=0,
        complete=complete,
        answers=[answer],
        standings=standings,
        sheets=[
            ReportTable(
                table=answer_table(study, rows),
                charts=[chart for row in charts(study, rows) for chart in row],
            )
        ],
        values=values,
        found=[found.model_dump() for found in rows],
    )


# -- the case file ---------------------------------------------------------------------------------


def require_replayable(study: DisturbanceStudy, folder: Path) -> None:
    """Refuse a folder for case files that lack the files beside the target.

    Raises:
        ArgumentError: With the folder that has them.
    """
    path = study.experiment.path
    file = study.experiment.file
    model = file.plant.model
    laws = [file.law(law).law for law in study.experiment.controllers]
    beside = any(map(is_named, (*named_in(file), *laws))) or (model and ":" not in model)
    if beside and folder.resolve() != path.parent.resolve():
        raise ArgumentError(f"{path} names files beside it: give --out {path.parent}")


def case_text(study: DisturbanceStudy, found: Found) -> str:
    """Return a complete case file that has the worst disturbance, and so replays it."""
    disturbance = study.disturbance
    case = disturbance.case_of(np.array(found.signal))
    content = read_content(study.experiment.path)
    content.pop("name", None)
    title = f"worst {disturbance.bound:g} {disturbance.unit} on {disturbance.place}"
    content["title"] = f"{study.experiment.title}: {title} for {found.law}"

    states = study.experiment.nominal.system.states
    for index in disturbance.starts:
        start = content["run"].setdefault("start", {})
        start[states[index].name] = written(case.x0[index], states[index].unit)
    if found.law not in [table.called for table in study.experiment.file.controller]:
        content["controller"].append({"law": found.law})

    tables = content.setdefault("disturbance", [])
    if disturbance.own is not None:
        tables.pop(disturbance.own_index)
    tables.append(_disturbance_table(disturbance, case.disturbances[-1]))
    share = f"{found.share!r} of {found.requirement}"
    return f"# {title} under {found.law}: {share}.\n{tomli_w.dumps(content)}"


def _disturbance_table(disturbance: BoundedDisturbance, worst: AnyDisturbance) -> dict[str, Any]:
    """Return the table of a disturbance with a table of values."""
    profile: Any = worst.profile
    key = {"w": "body", "input_disturbance": "input", "output_disturbance": "measured"}[worst.part]
    content: dict[str, Any] = {key: worst.of}
    if key == "body":
        content["force"] = [written(part, "N") for part in worst.amplitudes[:3]]
        content["torque"] = [written(part, "N m") for part in worst.amplitudes[3:]]
    else:
        content["amplitude"] = written(worst.amplitudes[0], disturbance.unit)
    return {
        **content,
        "profile": "table",
        "values": list(profile.values),
        "hold": written(profile.hold, "s"),
        "label": worst.label,
    }
