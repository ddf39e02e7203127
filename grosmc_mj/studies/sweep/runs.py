"""Run many rows of a design as one batch, with nothing kept but their outcomes."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements.conditions import RecordedRun
from grosmc_mj.experiments.requirements.judging import margins_of, of_laws, windows_of
from grosmc_mj.experiments.requirements.measurement import Measurement
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.experiments.requirements.run_metrics import metrics_of_simulations
from grosmc_mj.experiments.requirements.transient import initial_error
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import GrosmcError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.output.results.verdicts import Verdict, share_of, verdict_of
from grosmc_mj.simulation.acting import with_acting
from grosmc_mj.simulation.loop import AppliedLoop
from grosmc_mj.simulation.prepare import number_of_steps
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import Plant

# Begin of the names of margins' columns.
MARGIN = "margin "
COMPLETED = Status.COMPLETED.name.lower()
# Status of a row of which there can be no run.
IMPOSSIBLE = "impossible"
# Order of a run that ended at once; none that was completed comes near it.
_CUT = 1e9
# Runs that are recorded at the same time: 64 of 20,000 timesteps take some 200 MB.
_RECORDED_AT_ONCE = 64


@dataclass(frozen=True, eq=False)
class Row:
    """One run of a design.

    Attributes:
        law: Name of a law of the experiment, or a controller.
        case: Start, edits, disturbances and loop; the experiment's by default.
        number: Number of the run, which sets what its loop draws at random; the case's by default.
        plant: A plant that has the values already; by default it is made.
        predict: Whether the law knows its loop; a law by its name as the file says, by default.
    """

    law: str | Controller
    case: Experiment | None = None
    number: int | None = None
    plant: Plant | None = None
    predict: bool | None = None


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Outcomes of n runs.

    Attributes:
        limits: The requirements.
        columns: (n,) each, by name: the metrics, NaN for runs that ended early; ``margin KEY`` of
            each limit, NaN where it is not required of the row's law, -inf for runs that ended
            early; ``relative``, the least margin in parts of its limit, of the limits that a run
            can fail: at most 1, which is all of a limit, -inf for runs that ended early;
            ``order``, by which a worse run is told from a better one, finite: ``relative``, which
            has no lower bound where a run never settles; of runs that ended early the earlier is
            the worse; ``status``, in lower case; ``ended``, up to when the run is valid [s];
            ``last``, the last state, (n, states).
        impossible: Reasons why there can be no run of a row, by number of the row.
    """

    limits: Sequence[Requirement]
    columns: Mapping[str, NDArray[Any]]
    impossible: Mapping[int, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    @property
    def completed(self) -> NDArray[np.bool_]:
        """True for each run that reached its end, (n,)."""
        return self["status"] == COMPLETED

    @property
    def shares(self) -> Array:
        """Margins in parts of their limits, (limits, n)."""
        shares = np.zeros((len(self.limits), len(self["status"])))
        for row, limit in zip(shares, self.limits, strict=True):
            row[:] = self[MARGIN + limit.name] / limit.number
        return shares

    @property
    def verdicts(self) -> NDArray[np.bool_]:
        """Whether each run reached its end, and kept each limit, (1 + limits, n)."""
        return np.vstack([self.completed, self.shares >= 0])

    def verdict(
        self, run: int, limits: Sequence[Requirement] | None = None, *, draw: int = 0
    ) -> Verdict:
        """Return the verdict on a run.

        Args:
            run: Number of its row.
            limits: Requirements of its law that it is judged by, whose metrics are among the
                columns; those of the outcomes by default.
            draw: Number of the draw.
        """
        if run in self.impossible:
            return Verdict(impossible=self.impossible[run], draw=draw)

        judged = self.limits if limits is None else limits
        if not self.completed[run]:
            nothing = {limit.name: math.inf for limit in judged}
            return verdict_of(nothing, ended=str(self["status"][run]), draw=draw)

        shares = {}
        for limit in judged:
            margin = float(limit.margin_of(self[limit.metric][run]))
            shares[limit.name] = share_of(margin, limit.number)
        return verdict_of(shares, draw=draw)

    def changed(self, **columns: Any) -> Outcomes:
        """Return the outcomes with other columns."""
        return replace(self, columns={**self.columns, **columns})

    def rows(self, rows: NDArray[np.intp]) -> Outcomes:
        """Return some of the runs."""
        return self.changed(**{name: column[rows] for name, column in self.columns.items()})

    def with_rows(self, rows: NDArray[np.intp], replacements: Outcomes) -> Outcomes:
        """Return the runs, some of them replaced."""
        columns = {name: column.copy() for name, column in self.columns.items()}
        for name, column in columns.items():
            column[rows] = replacements[name]
        return self.changed(**columns)


class Run(NamedTuple):
    """A row, ready to run."""

    plant: Plant
    law: Controller
    loop: AppliedLoop | None
    case: Experiment


def run_rows(
    experiment: Experiment,
    rows: Sequence[Row],
    limits: Sequence[Requirement] | None = None,
    plant: PlantName = "physics",
    *,
    keep_impossible: bool = False,
    unfailing: Collection[str] = (),
    threads: int = 0,
) -> Outcomes:
    """Run the rows of a design; those of one law and duration are one batch.

    Args:
        experiment: Gives laws, plant, settings, and the start that errors are measured by.
        rows: The n rows.
        limits: Requirements, each on the laws that it names; the experiment's by default.
        plant: ``physics``, or ``corrected`` for the equations with the numbers of the model.
        keep_impossible: Whether a row that cannot be run is one of the outcomes, with the status
            ``impossible``, instead of an error.
        unfailing: Names of limits that no run can fail: they have margins, but no part in
            ``relative`` and ``order`` unless there are no others: the margin of a saturated
            input, 0, would hide how bad a run is.
        threads: 0 for all cores.

    Raises:
        GrosmcError: If there can be no such run.
    """
    if limits is None:
        limits = of_laws(experiment.limits, experiment.controllers)

    plants: dict[Any, Plant] = {}
    # Runs of one law and duration, by number of their row.
    groups: dict[Any, dict[int, Run]] = {}
    impossible: dict[int, str] = {}
    for number, row in enumerate(rows):
        try:
            run = prepare_run(experiment, row, plant, plants)
        except GrosmcError as error:
            if not keep_impossible:
                raise
            impossible[number] = str(error)
            continue
        key = run.law.law, run.law.name, run.case.duration
        groups.setdefault(key, {})[number] = run

    columns = _columns_without_runs(len(rows), limits)
    for group in groups.values():
        numbers = list(group)
        outcome = _run_group(experiment, list(group.values()), limits, unfailing, threads)
        for name, values in outcome.items():
            if name not in columns:
                columns[name] = np.full((len(rows), *values.shape[1:]), np.nan)
            columns[name][numbers] = values
    return Outcomes(limits, columns, impossible)


def recorded_runs(
    experiment: Experiment,
    rows: Sequence[Row],
    plant: PlantName = "physics",
    threads: int = 0,
) -> Iterator[tuple[Trajectory, Controller]]:
    """Run the rows of a design of one law and duration, recorded in chunks.

    Args:
        experiment: As for ``run_rows``.
        rows: The rows.
        plant: As for ``run_rows``.
        threads: 0 for all cores.

    Yields:
        Each run, cut where it ended, with its law.

    Raises:
        GrosmcError: If there can be no such run.
    """
    plants: dict[Any, Plant] = {}
    for first in range(0, len(rows), _RECORDED_AT_ONCE):
        some = rows[first : first + _RECORDED_AT_ONCE]
        runs = [prepare_run(experiment, row, plant, plants) for row in some]
        x0 = np.array([run.case.x0 for run in runs], float)
        batch = _batch(experiment, runs, x0, (), record=True, threads=threads)
        for i, run in enumerate(runs):
            yield batch[i], run.law


def _columns_without_runs(count: int, limits: Sequence[Requirement]) -> dict[str, NDArray[Any]]:
    """Columns of rows none of which can be run, (count,) each; metrics are not among them."""
    columns: dict[str, NDArray[Any]] = {
        MARGIN + limit.name: np.full(count, np.nan) for limit in limits
    }
    columns["relative"] = np.full(count, -np.inf)
    columns["order"] = np.full(count, -np.inf)
    columns["status"] = np.full(count, IMPOSSIBLE, object)
    columns["ended"] = np.zeros(count)
    return columns


def prepare_run(
    experiment: Experiment,
    row: Row,
    name: PlantName = "physics",
    plants: dict[Any, Plant] | None = None,
) -> Run:
    """Return the plant, the law, the loop around it and the case of a row.

    Args:
        experiment: Experiment of the row.
        row: The row.
        name: Kind of the plant that is made, as for ``run_rows``.
        plants: Plants that were made already, by their numbers; those with equal ones are one.

    Raises:
        GrosmcError: If there can be no such run.
    """
    case = row.case or experiment
    plant = row.plant
    if plant is None:
        plant = _plant_of(experiment, case, name, {} if plants is None else plants)
    law = experiment.law(name, row.law) if isinstance(row.law, str) else row.law
    return Run(plant, law, _loop_around(law, experiment, row, case), case)


def plant_of(case: Experiment, like: Plant) -> Plant:
    """Return the plant of a case whose parameters have other values.

    Args:
        case: The case.
        like: Plant of the case before its parameters had other values.

    Raises:
        ArgumentError: If the case starts beyond one of its stops.
    """
    if not isinstance(like, MujocoPlant):
        return case.plant(like.kind)
    plant = like.changed(*case.edits)
    plant.require_start(np.array(case.x0))
    return plant


def _plant_of(
    experiment: Experiment, case: Experiment, name: PlantName, plants: dict[Any, Plant]
) -> Plant:
    """The plant with the numbers of a case; plants with equal numbers are one."""
    key = case.edits, case.nominal.scales
    if key not in plants:
        plant = plant_of(case, experiment.plant(experiment.nominal.truest))
        plants[key] = plant if name == "physics" else plant.analytic(name)

    plant = plants[key]
    plant.require_start(np.array(case.x0))
    return plant


def _loop_around(
    law: Controller, experiment: Experiment, row: Row, case: Experiment
) -> AppliedLoop | None:
    """The loop of a row's case around its law; None without a loop."""
    if case.loop is None:
        return None
    predict = row.predict
    if predict is None and isinstance(row.law, str):
        predict = experiment.predicts(row.law)
    number = case.run_number if row.number is None else row.number
    return experiment.loop_around(law, case.loop, predict=bool(predict), run=number)


def measurements_of(
    experiment: Experiment, runs: Sequence[Run], limits: Sequence[Requirement]
) -> list[Measurement]:
    """Return what is measured of each run of one law; runs with the same numbers share it.

    Runs may be of several designs of the law: each is measured by its own optimum.
    """
    timestep = experiment.settings.timestep
    shared: dict[Any, Measurement] = {}
    measurements = []
    for run in runs:
        onset = run.case.onset
        duration = number_of_steps(run.case.duration, timestep) * timestep
        input_limits = run.plant.input_limits
        key = run.law, onset, duration, input_limits.tobytes()
        if key not in shared:
            shared[key] = Measurement(
                controller=run.law,
                timestep=timestep,
                duration=duration,
                onset=onset,
                windows=windows_of(limits),
                input_limits=input_limits,
            )
        measurements.append(shared[key])
    return measurements


def _run_group(
    experiment: Experiment,
    runs: Sequence[Run],
    limits: Sequence[Requirement],
    unfailing: Collection[str],
    threads: int,
) -> dict[str, NDArray[Any]]:
    """The columns of ``Outcomes`` of runs of one law and duration."""
    law = runs[0].law
    duration = runs[0].case.duration
    x0 = np.array([run.case.x0 for run in runs], float)
    measurements = measurements_of(experiment, runs, limits)
    limits_of_law = [limit for limit in limits if law.name in limit.laws]
    recorded_limits = [limit for limit in limits_of_law if limit.recorded]
    ends = _simulated(experiment, runs, x0, measurements, recorded_limits, threads)

    status = np.array([end.name.lower() for end in ends.status], object)
    completed = status == COMPLETED
    ended = np.where(completed, duration, ends.valid_until)
    last = ends.last

    metrics = metrics_of_simulations(measurements, ends.accumulated, last, completed)
    metrics.update(ends.recorded)
    transient = np.array([item.transient for item in measurements])

    start = initial_error(law, experiment.x0)
    margins = margins_of(limits_of_law, metrics, completed)
    failing = [limit for limit in limits_of_law if limit.name not in unfailing]
    if not failing:
        failing = limits_of_law
    shares = [margins[limit.name] / limit.number for limit in failing]
    # A margin is at most all of its limit, also of a law of which nothing is required.
    shares.append(np.ones(len(runs)))
    order = _order(failing, shares, metrics, transient, start)

    columns = {name: np.where(completed, values, np.nan) for name, values in metrics.items()}
    for limit in limits:
        columns[MARGIN + limit.name] = margins.get(limit.name, np.full(len(runs), np.nan))
    columns["relative"] = np.where(completed, np.min(shares, axis=0), -np.inf)
    columns["order"] = np.where(completed, order, -_CUT / (1 + ended))
    columns["status"] = status
    columns["ended"] = ended
    columns["last"] = last
    return columns


class _Ends(NamedTuple):
    """Results of n runs of one law.

    Attributes:
        status: How each ended, (n,).
        valid_until: Up to when each is valid [s], (n,).
        last: Last states, (n, states).
        accumulated: Accumulated values, (n,).
        recorded: Metrics of recorded runs by name, (n,) each; infinite for runs that ended early.
    """

    status: NDArray[np.object_]
    valid_until: Array
    last: Array
    accumulated: Any
    recorded: Mapping[str, Array]


def _simulated(
    experiment: Experiment,
    runs: Sequence[Run],
    x0: Array,
    measurements: Sequence[Measurement],
    recorded: Sequence[Requirement],
    threads: int,
) -> _Ends:
    """Simulate runs of one law and duration: as one batch, or in chunks if they are recorded."""
    size = _RECORDED_AT_ONCE if recorded else len(runs)
    chunks: list[_Ends] = []
    for first in range(0, len(runs), size):
        part = slice(first, first + size)
        batch = _batch(
            experiment,
            runs[part],
            x0[part],
            measurements[part],
            record=bool(recorded),
            threads=threads,
        )
        chunks.append(
            _Ends(
                status=batch.status,
                valid_until=np.asarray(batch.valid_until, float),
                last=batch.state[:, -1].copy(),
                accumulated=batch.accumulated,
                recorded=_recorded_metrics(batch, runs[part], recorded, threads),
            )
        )
    if len(chunks) == 1:
        return chunks[0]
    return _Ends(
        status=np.concatenate([chunk.status for chunk in chunks]),
        valid_until=np.concatenate([chunk.valid_until for chunk in chunks]),
        last=np.concatenate([chunk.last for chunk in chunks]),
        accumulated=np.concatenate([chunk.accumulated for chunk in chunks]),
        recorded={
            limit.metric: np.concatenate([chunk.recorded[limit.metric] for chunk in chunks])
            for limit in recorded
        },
    )


def _recorded_metrics(
    batch: Trajectory, runs: Sequence[Run], limits: Sequence[Requirement], threads: int
) -> dict[str, Array]:
    """Return the metrics of recorded runs by name, (n,) each."""
    metrics = {limit.metric: np.full(len(runs), np.inf) for limit in limits}
    if not limits:
        return metrics
    completed = [i for i in range(len(runs)) if batch.status[i] is Status.COMPLETED]
    trajectories = [batch[i] for i in completed]
    plants = [runs[i].plant for i in completed]
    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        acting = pool.map(with_acting, trajectories, plants)
        for i, trajectory in zip(completed, acting, strict=True):
            run = runs[i]
            record = RecordedRun(trajectory, run.law, run.case.conditions(run.plant))
            for limit in limits:
                metrics[limit.metric][i] = limit.of_record(record)
    return metrics


def _batch(
    experiment: Experiment,
    runs: Sequence[Run],
    x0: Array,
    measurements: Sequence[Measurement],
    *,
    record: bool,
    threads: int,
) -> Trajectory:
    """Simulate runs of one law and duration as one batch, with metrics if there are any."""
    settings = experiment.settings
    return simulate(
        [run.plant for run in runs],
        [run.law for run in runs],
        x0,
        duration=runs[0].case.duration,
        loop=[run.loop for run in runs],
        control_period=settings.control_period,
        timestep=settings.timestep,
        disturbances=[list(run.case.disturbances) for run in runs],
        accumulator=[item.accumulator for item in measurements] or None,
        engine=settings.engine_for(runs[0].law),
        record=record,
        threads=threads,
    )


def _order(
    limits: Sequence[Requirement],
    shares: Sequence[Array],
    metrics: Mapping[str, Array],
    transient: Array,
    start: float,
) -> Array:
    """The least margin in parts of its limit, without the bound that a run's length gives it.

    Args:
        limits: Requirements of the runs' law.
        shares: Margins of each of them in parts of its limit, and those that no margin exceeds.
        metrics: Metrics of the runs.
        transient: Length of their transients [s].
        start: Size of the nominal error at the start.
    """
    unbounded = list(shares)
    for i, limit in enumerate(limits):
        unbounded[i] = limit.order_share(shares[i], metrics, transient, start)
    return np.min(unbounded, axis=0)
