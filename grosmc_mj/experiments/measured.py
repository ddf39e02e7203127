"""Logs of the real machine as runs of a case, judged by its requirements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.file.schema import MeasuredTable
from grosmc_mj.experiments.logs.log import Log, name_of_log
from grosmc_mj.experiments.requirements.judging import Judgement, judge_runs
from grosmc_mj.experiments.requirements.measurement import NO_WINDOWS, Windows
from grosmc_mj.experiments.requirements.metrics import Metric, Metrics, largest_of
from grosmc_mj.experiments.requirements.optimum import Comparison
from grosmc_mj.experiments.requirements.requirement import Requirement, missing_signals
from grosmc_mj.experiments.requirements.signals import ERROR
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, name_list, placed
from grosmc_mj.simulation.trajectory import Status, Trajectory
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import System

# Name of the plant that made a log.
MEASURED = "measured"
# Metrics of the error of all outputs, and of the inputs.
_OF_ERROR = ("settling_time", "overshoot", "rms_error")
_OF_INPUT = ("total_variation", "max_input")
# An instant counts as reached when it is this close, in parts of the sampling.
_INSTANT = 1e-6
# Samples that the end of a log may lack, with half a one for their rounding.
_LACKING = 1.5


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredResult(RunResult):
    """A log as a run of its case, on the machine itself.

    States that the log does not have are NaN: no requirement that needs one is judged.

    Attributes:
        plant: ``measured``, with the name of the log where there are several.
        log: Path of the log.
        begin: Instant of the log at which the run begins, from its first sample on [s].
        notes: What may be wrong with it, in lines.
    """

    plant: str  # pyright: ignore[reportIncompatibleVariableOverride]
    log: Path
    begin: float
    notes: Sequence[str] = ()

    @property
    def simulated(self) -> bool:
        """Whether it is a simulation, not a log of the machine."""
        return False

    # Each requirement asks for them.
    @cached_property
    def known(self) -> frozenset[str]:
        """Names of the signals that it has for the whole run, see ``requirements.signals``."""
        return _known_signals(self.trajectory, self.controller, self.comparison)

    # As of a simulation: tables, figures and documents ask for them.
    @cached_property
    def metrics(self) -> Mapping[str, Metric]:
        """Usual metrics by name; without a value where the log does not tell it."""
        inputs = {signal.name for signal in self.trajectory.system.inputs}
        return Metrics(_known_metrics(super().metrics, self.known, inputs))

    def values(self, windows: Windows = NO_WINDOWS) -> Mapping[str, float]:
        """Return the metrics by name; sums over states that were not measured are NaN."""
        with np.errstate(invalid="ignore"):
            return super().values(windows)

    # As of a simulation: a page, a figure and a document ask for them.
    @cached_property
    def requirements(self) -> list[Judgement]:
        """Judgements by the requirements that the log can decide."""
        decided = [requirement for requirement, reason in self._limits if not reason]
        return judge_runs(decided, [self])

    @property
    def not_judged(self) -> list[str]:
        """A line on each requirement that the log cannot decide, with the reason."""
        return [
            f"not judged on {self.log.name}: {requirement.words}: {reason}"
            for requirement, reason in self._limits
            if reason
        ]

    @property
    def _limits(self) -> list[tuple[Requirement, str]]:
        """Requirements on the truest plant, each with the reason why no log decides it, if any."""
        limits = []
        for limit in self.case.limits:
            if self.case.plant_names[-1] in limit.plants and self.controller.name in limit.laws:
                reason = self._why_not(limit)
                limits.append((replace(limit, plants=(self.plant,)), reason))
        return limits

    def _why_not(self, limit: Requirement) -> str:
        """Return why the log cannot decide a requirement, or nothing."""
        reason = limit.why_not_measured(self.controller, self.known)
        inputs = [signal.name for signal in self.trajectory.system.inputs]
        if not reason and limit.of_actuators:
            reason = missing_signals(inputs, self.known)
        time = self.trajectory.time
        return reason or limit.why_too_few_samples(float(time[1]), float(time[-1]))


def measured_results(experiment: Experiment) -> list[MeasuredResult]:
    """Return the logs of a case's ``[[measured]]`` tables as runs, of the laws that are run.

    Raises:
        ArgumentError: If a log cannot be read or is too short, or its law is not clear.
    """
    declared = [controller.called for controller in experiment.file.controller]
    tables = []
    for table in experiment.file.measured:
        if table.law is not None:
            require_known("law", table.law, declared, f"{experiment.path}: measured: ")
        if table.law is None or table.law in experiment.controllers:
            tables.append(table)
    return results_of_logs(experiment, tables)


def disagreements(experiment: Experiment, judgements: Sequence[Judgement]) -> list[str]:
    """Return a line on each requirement that only one of model and machine keeps.

    Args:
        experiment: The case.
        judgements: Those of its runs and of its logs; the model is its truest plant.
    """
    truest = experiment.plant_names[-1]
    of_model = {}
    for item in judgements:
        if item.plant == truest:
            of_model[item.controller, item.requirement.words] = item.kept

    lines = []
    for item in judgements:
        key = item.controller, item.requirement.words
        if item.plant.startswith(MEASURED) and of_model.get(key, item.kept) != item.kept:
            kept = item.plant if item.kept else truest
            lines.append(f"model and machine disagree: {' '.join(key)}: kept on {kept} only")
    return lines


def results_of_logs(
    experiment: Experiment, tables: Sequence[MeasuredTable]
) -> list[MeasuredResult]:
    """Return logs as runs of a case.

    Args:
        experiment: The case.
        tables: The logs, whose paths begin at the case file's folder.

    Raises:
        ArgumentError: As ``measured_results`` does.
    """
    results = []
    for table in tables:
        path = experiment.path.parent / table.log
        plant = MEASURED
        if len(tables) > 1:
            plant = f"{MEASURED} {name_of_log(path)}"
        results.append(_result_of_log(experiment, path, table, plant))

    names = [result.key for result in results]
    for result in results:
        if names.count(result.key) > 1:
            raise ArgumentError(
                f"two logs are called {name_of_log(result.log)}: rename one, or judge them one by "
                "one"
            )
    return results


def _result_of_log(
    experiment: Experiment, path: Path, table: MeasuredTable, plant: str
) -> MeasuredResult:
    """Return a log as a run."""
    # Imported here: runs without a log need no pyarrow.
    from grosmc_mj.experiments.logs.read import read_log

    system = experiment.nominal.system
    law = _law_of(experiment, path, table.law)
    log = read_log(path, system, experiment.file.log, experiment.nominal.gears, to_learn=False)
    return run_of_log(experiment, log, law, path, table.start, plant)


def run_of_log(
    experiment: Experiment,
    log: Log,
    law: str,
    path: Path,
    start: float = 0.0,
    plant: str = MEASURED,
) -> MeasuredResult:
    """Return a log as a run of a case.

    Args:
        experiment: The case, with the duration of the run.
        log: The log.
        law: Name of the law under which it was made.
        path: Path of the log.
        start: Earliest instant at which the run begins, from the log's first sample on [s].
        plant: Name of the machine.

    Raises:
        ArgumentError: If there is no such law, or the log does not have the whole run.
    """
    truest = experiment.plant_names[-1]
    controller = experiment.law(truest, law)
    with placed(f"{path}: "):
        begin, trajectory = _as_trajectory(
            log, experiment.nominal.system, experiment.duration, start
        )

    notes = [*log.notes, *partly_known(log.name, trajectory)]
    lasts = float(trajectory.time[-1])
    if lasts < experiment.duration * (1 - _INSTANT):
        notes.append(
            f"{log.name} has {lasts:.4g} s of {experiment.duration:g} s: the last sample is missing"
        )
    return MeasuredResult(
        case=experiment,
        plant=plant,
        controller=controller,
        trajectory=trajectory,
        true=experiment.plant(truest),
        log=path,
        begin=begin,
        notes=notes,
    )


def _law_of(experiment: Experiment, path: Path, name: str | None) -> str:
    """Return the name of the law under which a log was made.

    Raises:
        ArgumentError: If there is no such law, or several are possible.
    """
    if name is not None:
        require_known("law", name, experiment.controllers, f"{path}: ")
        return name
    if len(experiment.controllers) > 1:
        raise ArgumentError(
            f"{path}: the case has the laws {name_list(experiment.controllers)}: name the one that "
            "made the log, by --laws NAME or law = in [[measured]]"
        )
    return experiment.controllers[0]


# -- the log as a trajectory ---------------------------------------------------------------------


def _as_trajectory(
    log: Log, system: System, duration: float, start: float
) -> tuple[float, Trajectory]:
    """Return a part of a log as a run, at equally spaced instants.

    States are interpolated by straight lines, inputs are held. At a constant sampling the instants
    are those of the samples.

    Args:
        log: The log.
        system: The plant's system.
        duration: Duration of the run [s].
        start: Earliest instant at which it begins, from the log's first sample on [s].

    Returns:
        The instant of the log at which the run begins [s], and the run.

    Raises:
        ArgumentError: If the log does not have the whole run, without a break.
    """
    begin = _first_instant(log, start)
    duration = _whole_duration(log, begin, duration)
    steps = max(1, round(duration / log.sampling))
    period = duration / steps

    time = np.arange(steps + 1) * period
    instants = begin + time
    held = np.searchsorted(log.time, instants[:-1] + _INSTANT * period, side="right") - 1
    inputs = log.inputs[held]
    if len(system.inputs) == 1:
        inputs = inputs[:, 0]
    return begin, Trajectory(
        system=system,
        time=time,
        state=_states_at(log, system, instants),
        command=inputs,
        input=inputs,
        sliding=None,
        weighed=np.full_like(inputs, np.nan),
        memory=np.zeros(steps, [("unknown", np.float64)]),
        wrench=None,
        physics=None,
        status=np.array([Status.COMPLETED], object)[0],
        valid_until=np.array(time[-1]),
    )


def _first_instant(log: Log, start: float) -> float:
    """Return the first sample that is used and not before ``start`` [s]."""
    for piece in log.pieces:
        instants = log.time[piece]
        later = instants[instants >= start - _INSTANT * log.sampling]
        if len(later):
            return float(later[0])
    raise ArgumentError(f"start = {start:g} s is after its end at {log.time[-1]:g} s")


def _whole_duration(log: Log, begin: float, duration: float) -> float:
    """Return the duration of a run that a log has from ``begin`` on, without a break [s].

    Its last sample may be missing: a log of 3 s often ends a sample before 3 s.

    Raises:
        ArgumentError: If the log lacks more.
    """
    end = begin + duration
    half = 0.5 * log.sampling
    pieces = [log.time[piece] for piece in log.pieces]
    lasts = [float(instants[-1]) for instants in pieces if instants[0] <= begin <= instants[-1]]
    if lasts and lasts[0] >= end - half:
        return duration
    if lasts and lasts[0] >= end - _LACKING * log.sampling:
        return lasts[0] - begin

    last = float(log.time[log.pieces[-1]][-1])
    if last < end - half:
        raise ArgumentError(
            f"it has {last - begin:.4g} s, the case runs {end - begin:g} s: log for longer, or "
            "give the case a shorter duration"
        )
    reached = max(float(log.time[piece][-1]) for piece in log.pieces if log.time[piece][0] <= begin)
    raise ArgumentError(
        f"nothing is used after {reached:.4g} s, by a gap or by use, mask and delays of [log]; the "
        f"case runs to {end:.4g} s: begin elsewhere by start in [[measured]], or mask nothing"
    )


def _states_at(log: Log, system: System, instants: Array) -> Array:
    """Return the states at some instants, (N, n); NaN where they were not measured."""
    states = np.full((len(instants), len(system.states)), np.nan)
    for i, state in enumerate(system.states):
        if state.name in log.states:
            states[:, i] = np.interp(instants, log.time, log.states[state.name])
    return states


# -- what a log tells ----------------------------------------------------------------------------


def _signals_of(trajectory: Trajectory) -> dict[str, Array]:
    """Return inputs and states of a run by name, (N,) each; NaN where a log does not show them."""
    system = trajectory.system
    inputs = trajectory.input.reshape(len(trajectory.input), -1)
    signals = {}
    for j, signal in enumerate(system.inputs):
        signals[signal.name] = inputs[:, j]
    for i, state in enumerate(system.states):
        signals[state.name] = trajectory.state[:, i]
    return signals


def partly_known(log: str, trajectory: Trajectory) -> list[str]:
    """Return a line on each signal of a run that its log shows for a part of the time."""
    lines = []
    for name, values in _signals_of(trajectory).items():
        shown = trajectory.time[: len(values)][np.isfinite(values)]
        if 0 < len(shown) < len(values):
            lines.append(
                f"{log} has {name} from {shown[0]:.4g} to {shown[-1]:.4g} s of the run only: no "
                "message shows it at other times"
            )
    return lines


def _known_signals(
    trajectory: Trajectory, law: Controller, comparison: Comparison
) -> frozenset[str]:
    """Return the names of the signals that a log has for the whole run."""
    error = law.designed.error
    known = {"t"}
    for name, values in _signals_of(trajectory).items():
        if np.all(np.isfinite(values)):
            known.add(name)
    for i, name in enumerate(error.names):
        if np.all(np.isfinite(comparison.z[:, i])):
            known |= {name, f"{name} error"}
    if np.all(np.isfinite(comparison.error)):
        known.add(ERROR)
    return frozenset(known)


def _known_metrics(
    metrics: Mapping[str, Metric], known: frozenset[str], inputs: set[str]
) -> dict[str, Metric]:
    """Return the usual metrics; without a value where a log does not tell it."""
    measured = set(map(largest_of, known))
    if inputs <= known:
        measured.update(_OF_INPUT)
    if ERROR in known:
        measured.update(_OF_ERROR)
    unknown = {
        name: Metric(None, metric.unit, "not in a log")
        for name, metric in metrics.items()
        if name not in measured
    }
    return {**metrics, **unknown}
