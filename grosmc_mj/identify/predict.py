"""A closed loop predicted beside its log: the law on the fitted machine, over seeds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.experiments.measured import MeasuredResult, partly_known, run_of_log
from grosmc_mj.ground.arrays import Array, as_rows
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.wording import spelled, unit_after
from grosmc_mj.identify.law_on_log import LawOnLog, law_on_log
from grosmc_mj.identify.model import LogModel
from grosmc_mj.identify.replay import Predictor
from grosmc_mj.identify.starts import fitted_starts
from grosmc_mj.simulation.loop import Loop, Sensor
from grosmc_mj.simulation.loop.timing import steps_to
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory

# The start is fitted to so much of the log [s].
_LEAD = 0.1
# Noise below this share of an encoder's step is not told apart from rounding, 1/sqrt(12) of it.
_LEAST_NOISE = 0.4
# Metrics that are compared beside the requirements.
_REPORTED = ("total_variation",)


class PredictedQuantity(NamedTuple):
    """A number of the measured run beside those of the predicted ones.

    Attributes:
        name: Words for it, unlike those of any other.
        label: Short words.
        unit: Its unit.
        required: Whether a requirement asks for it.
        measured: Value of the log; infinite for never.
        predicted: Values of the predicted runs, (seeds,); infinite for never.
    """

    name: str
    label: str
    unit: str
    required: bool
    measured: float
    predicted: Array = np.zeros(0)

    @property
    def median(self) -> float:
        """Median of the predicted values."""
        return float(np.median(self.predicted))

    @property
    def spread(self) -> tuple[float, float]:
        """Least and largest predicted value."""
        return float(self.predicted.min()), float(self.predicted.max())

    def contains(self, value: float) -> bool:
        """Whether a value lies within the spread."""
        low, high = self.spread
        return low <= value <= high


@dataclass(frozen=True, eq=False)
class Prediction:
    """Runs of one machine, as its own logs show them, beside the measured log.

    Attributes:
        log: The measured log.
        runs: Recorded runs, one for each seed.
        logs: What the machine would have logged.
        quantities: Measured and predicted numbers.
        misfits: RMS distance of each predicted log from the measured one, (seeds,).
    """

    log: Log
    runs: Sequence[Trajectory]
    logs: Sequence[Log]
    quantities: Sequence[PredictedQuantity]
    misfits: Array

    @property
    def nearest(self) -> int:
        """Seed of the run that is nearest to the log."""
        return int(self.misfits.argmin())


class PredictionQuestion(NamedTuple):
    """A law on a machine, whose closed loop a log is of.

    Attributes:
        experiment: The machine, with the start and the sensors of the log.
        law: Name of the law.
        log: The part of the log that is the run, its time from 0 on.
        law_on_log: Commands of the law on the logged states; None where it cannot be asked.
        notes: What may be wrong, in lines.
    """

    experiment: Experiment
    law: str
    log: Log
    law_on_log: LawOnLog | None
    notes: Sequence[str]


def question_of(
    experiment: Experiment, law: str, log: Log, noise_log: Log, start: float = 0.0
) -> PredictionQuestion:
    """Bring start and sensors of a log into the case of its machine.

    Args:
        experiment: The case of the machine, with its law, requirements and duration.
        law: Name of the law.
        log: The log.
        noise_log: The log that noise and resolution of the sensors are taken from.
        start: Earliest instant at which the run begins, from the log's first sample on [s].

    Raises:
        ArgumentError: If there is no such law or no requirement, the log does not have the whole
            run, or the machine cannot start there.
    """
    measured = run_of_log(experiment, log, law, Path(log.name), start)
    _require_judged(measured)
    for line in partly_known(log.name, measured.trajectory):
        raise ArgumentError(f"{line}: a prediction needs it from the first to the last sample")
    log = _part(log, measured.begin, experiment.duration)
    notes = [*measured.notes, *measured.not_judged]
    experiment = experiment.changed(loop=_instrumented(experiment, noise_log))

    asked = None
    start_of_run = _start(experiment, log, 0.0)
    try:
        asked = _asked(experiment, law, log, start_of_run, measured.input_limits)
        start_of_run = _start(experiment, log, asked.rows * log.sampling)
    except ArgumentError as error:
        notes.append(f"the law is not asked for the logged commands: {error}")
    return PredictionQuestion(
        experiment.changed(x0=tuple(start_of_run.tolist())), law, log, asked, notes
    )


def _asked(experiment: Experiment, law: str, log: Log, start: Array, limits: Array) -> LawOnLog:
    """Ask the law of an experiment for the commands of a log, see ``law_on_log``."""
    applied = experiment.applied_loop(experiment.nominal.truest, law)
    assert applied is not None
    return law_on_log(applied, log, start, limits)


def _require_judged(measured: MeasuredResult) -> None:
    """Refuse a log of which no requirement of its case can be judged.

    Raises:
        ArgumentError: With the reasons.
    """
    if measured.requirements:
        return
    case = measured.case
    reasons = "; ".join([*case.not_judged, *measured.not_judged])
    if not reasons:
        reasons = f"there is none of {measured.controller.name}: write a [[requirement]]"
    raise ArgumentError(f"{case.path}: no requirement that can be predicted: {reasons}")


def _part(log: Log, begin: float, duration: float) -> Log:
    """Return the samples of a log from an instant on, for some time, with their time from 0 on."""
    half = 0.5 * log.sampling
    first = int(np.searchsorted(log.time, begin - half))
    stop = int(np.searchsorted(log.time, begin + duration + half))
    part = slice(first, stop)
    return replace(
        log,
        time=log.time[part] - log.time[first],
        inputs=log.inputs[part],
        states={name: values[part] for name, values in log.states.items()},
        pieces=[slice(0, stop - first)],
    )


def _instrumented(experiment: Experiment, log: Log) -> Loop:
    """Return the loop with the noise and the resolution that a log shows.

    A logged rate is measured, not differenced. A state that the case estimates otherwise stays
    estimated: its logged values are those of the estimator.
    """
    loop = experiment.loop or Loop()
    estimators = []
    estimated: set[str] = set()
    for part in loop.estimators:
        if part.law != "difference":
            estimated.update(part.of)
        elif log.states.keys() & set(part.of):
            continue
        estimators.append(part)

    sensors = {sensor.of: sensor for sensor in loop.sensors}
    for name in log.states:
        if name not in estimated:
            sensors[name] = replace(
                sensors.get(name, Sensor(name)),
                exact=False,
                resolution=log.resolution(name),
                noise=_noise(log, name),
            )
    return replace(loop, sensors=tuple(sensors.values()), estimators=tuple(estimators))


def _noise(log: Log, state: str) -> float:
    """Return the standard deviation of a sensor's noise beside its rounding."""
    noise = log.noise(state)
    resolution = log.resolution(state)
    if noise < _LEAST_NOISE * resolution:
        return 0.0
    return math.sqrt(noise**2 - resolution**2 / 12)


def _start(experiment: Experiment, log: Log, logged_delay: float) -> Array:
    """Return the state at the first sample of a log, (n,), fitted to a short time after it.

    Args:
        experiment: The machine.
        log: The log.
        logged_delay: Delay of the computer that is in the log already, for a command stands beside
            later states [s].
    """
    loop = experiment.loop
    assert loop is not None
    delay = _unlogged_delay(experiment, logged_delay)
    replayed = loop.changed("computing", "", delay=delay)
    plant = experiment.plant(experiment.nominal.truest)
    model = LogModel(plant, replayed, experiment.disturbances)

    timestep = _timestep(experiment)
    horizon = min(10 * _LEAD, float(log.time[-1]))
    leads = Predictor.leading(_after_rest(log, model.delay), horizon, timestep).leads
    first = replace(leads, windows=leads.windows[:1])
    (start,) = fitted_starts(first, model)
    return start


def predict(question: PredictionQuestion, seeds: int) -> Prediction:
    """Simulate the closed loop over seeds, and measure each run as its log shows it.

    Args:
        question: The law, the machine and the log.
        seeds: Number of runs; each has its own noise.

    Raises:
        GrosmcError: If the law fails.
        ArgumentError: If no run gets beyond its first step.
    """
    case = question.experiment
    runs = _closed_loop(case, question.law, seeds)
    if all(len(run.time) == 1 for run in runs):
        raise ArgumentError(_no_step_words(case, question.log))
    timestep = _timestep(case)
    late = 0.0
    if question.law_on_log is not None:
        late = question.law_on_log.rows * question.log.sampling
    early = _unlogged_delay(case, late)
    logs = [_log_of(run, question.log, timestep, early) for run in runs]

    quantities = _quantities(question.experiment, question.log, question.law)
    predicted: dict[str, list[float]] = {name: [] for name in quantities}
    for run, log in zip(runs, logs, strict=True):
        of_run = _quantities(question.experiment, log, question.law)
        for name, values in predicted.items():
            completed = run.status is Status.COMPLETED
            values.append(of_run[name].measured if completed else math.inf)
    compared = []
    for name, quantity in quantities.items():
        compared.append(quantity._replace(predicted=np.array(predicted[name])))
    misfits = np.array([_misfit(case, log, question.log) for log in logs])
    return Prediction(question.log, runs, logs, compared, misfits)


def _closed_loop(experiment: Experiment, law: str, seeds: int) -> Sequence[Trajectory]:
    """Return recorded runs of an experiment, which differ in what its loop draws at random."""
    name = experiment.nominal.truest
    plant = experiment.plant(name)
    controller = experiment.law(name, law)
    loops = [
        experiment.changed(run_number=number).applied_loop(name, law) for number in range(seeds)
    ]
    batch = simulate(
        [plant] * seeds,
        controller,
        experiment.x0,
        duration=experiment.duration,
        loop=loops,
        control_period=experiment.settings.control_period,
        timestep=experiment.settings.timestep,
        disturbances=experiment.disturbances,
        engine=experiment.settings.engine_for(controller),
    )
    return [batch[number] for number in range(seeds)]


def _no_step_words(experiment: Experiment, log: Log) -> str:
    """Message of runs that end in their first step."""
    start = []
    for state, value in zip(experiment.nominal.system.states, experiment.x0, strict=True):
        start.append(f"{state.name} {value:.4g}{unit_after(state.unit)}")
    return (
        f"{log.name}: every predicted run ends in its first step, from {', '.join(start)}: check "
        "the units of the log, or give the run another start"
    )


def _timestep(experiment: Experiment) -> float:
    """Return the timestep of the runs of an experiment [s]."""
    plant = experiment.plant(experiment.nominal.truest)
    return plant.step_length or experiment.settings.timestep


def _unlogged_delay(experiment: Experiment, logged_delay: float) -> float:
    """Return the delay of the computer that a log does not have: by it a command stands early [s].

    Args:
        experiment: The machine.
        logged_delay: Time from a state to the command of it in the log [s].
    """
    loop = experiment.loop
    assert loop is not None
    return max(loop.computing.delay - logged_delay, 0.0)


def _log_of(run: Trajectory, like: Log, timestep: float, early: float) -> Log:
    """Return the log of a simulated run: what its sensors told at the instants of another log.

    Args:
        run: The run.
        like: The other log.
        timestep: Timestep of the run [s].
        early: Time by which that log has a command before it is applied [s]. A jump from rest at
            its first sample is in neither log then.
    """
    assert run.seen is not None
    commands = as_rows(run.input)
    rows = steps_to(like.time, timestep).clip(0, len(run.seen) - 1)
    applied = steps_to(like.time + early, timestep).clip(0, len(commands) - 1)
    names = [state.name for state in run.system.states]
    return replace(
        like,
        inputs=commands[applied],
        states={name: run.seen[rows, names.index(name)] for name in like.states},
    )


def _after_rest(log: Log, delay: float) -> Log:
    """Return a log whose inputs are zero for a delay [s] before 0: no output arrives sooner."""
    states = {}
    for name, values in log.states.items():
        states[name] = np.concatenate([values[:1], values])
    return replace(
        log,
        time=np.concatenate([[-delay - log.sampling], log.time]),
        inputs=np.vstack([0 * log.inputs[:1], log.inputs]),
        states=states,
        pieces=[slice(1, len(log.time) + 1)],
    )


def _quantities(experiment: Experiment, log: Log, law: str) -> Mapping[str, PredictedQuantity]:
    """Return the numbers of a log by their names: those that requirements ask for first."""
    run = run_of_log(experiment, log, law, Path(log.name))
    quantities = {}
    for judgement in run.requirements:
        requirement = judgement.requirement
        name = requirement.words
        label = requirement.key.removesuffix("_within").removesuffix("_below")
        label = spelled(f"{requirement.signal} {label}".strip())
        number = math.inf
        if judgement.measured is not None:
            number = judgement.measured
        elif judgement.margin is not None:
            number = judgement.margin
            label = f"margin of {label}"
        quantities[name] = PredictedQuantity(name, label, requirement.unit, True, number)
    for key in _REPORTED:
        metric = run.metrics[key]
        if metric.value is not None:
            name = spelled(key)
            quantities[name] = PredictedQuantity(name, name, metric.unit, False, metric.value)
    return quantities


def _misfit(experiment: Experiment, log: Log, measured: Log) -> float:
    """Return the RMS distance of a log from the measured one, over the controlled states."""
    system = experiment.nominal.system
    squares = []
    for index in system.controlled:
        name = system.states[index].name
        if name in measured.states:
            distance = log.states[name] - measured.states[name]
            squares.append(np.square(_turned(experiment, name, distance)))
    return float(np.sqrt(np.mean(squares)))


def _turned(experiment: Experiment, state: str, distance: Array) -> Array:
    """Return a distance, within half a turn of an angle that a requirement counts modulo a turn."""
    for limit in experiment.limits:
        if limit.periodic and limit.signal in ("", state):
            return np.remainder(distance + math.pi, 2 * math.pi) - math.pi
    return distance
