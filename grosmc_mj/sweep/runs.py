"""Run many rows of a design as one batch, with nothing recorded but what became of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import GrosmcError
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.metrics import DWELL, Recording, meters_of, said_by, transient_of
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements import (
    Limit,
    costs_wanted,
    initial_error,
    margins_of,
    required,
    windows,
)
from grosmc_mj.loop import in_loop, relooped
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.problem import Meters
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status
from grosmc_mj.sweep.parameters import Parameter, varied

# How the columns of margins begin.
MARGIN = "margin "
COMPLETED = Status.COMPLETED.name.lower()
# Status of a row of which there can be no run.
IMPOSSIBLE = "impossible"
# Order of a run that ended at once; none that was completed comes near it.
_CUT = 1e9


@dataclass(frozen=True, eq=False)
class Row:
    """One run of a design.

    Attributes:
        law: Name of a law of the experiment, or a controller, in a loop or without one.
        values: Values by parameter, or by its path such as ``sensor.rotor angle.delay``, where
            they are not the case's.
        case: Start, edits, disturbances and loop; the experiment's by default.
        number: Number of the run, which sets what its loop draws at random; the case's by default.
        plant: A plant that has the values already; by default it is made.
        predict: Whether the law knows the loop that it is put into.
    """

    law: str | Controller
    values: Mapping[str | Parameter, float] = field(default_factory=dict)
    case: Case | None = None
    number: int | None = None
    plant: Plant | None = None
    predict: bool = False


@dataclass(frozen=True, eq=False)
class Outcomes:
    """What became of n runs.

    Attributes:
        limits: What was required.
        columns: (n,) each, by name: the metrics, NaN for runs that ended early; ``margin KEY`` of
            each limit, NaN where it is not required of the row's law, -inf for runs that ended
            early; ``relative``, the least margin in parts of its limit: at most 1, which is all of
            a limit, -inf for runs that ended early; ``order``, by which a worse run is told from a
            better one, finite: ``relative``, which has no lower bound where a run never settles; of
            runs that ended early the earlier is the worse; ``status``, in lower case; ``ended``, up
            to when the run is valid [s]; ``last``, the last state, (n, states).
        impossible: By number of the row: why there can be no such run.
    """

    limits: Sequence[Limit]
    columns: Mapping[str, NDArray[Any]]
    impossible: Mapping[int, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    @property
    def completed(self) -> NDArray[np.bool_]:
        """Which runs did, (n,)."""
        return self["status"] == COMPLETED

    @property
    def shares(self) -> list[Array]:
        """Margins in parts of their limits, of each limit, (n,)."""
        return [self[MARGIN + limit.key] / limit.value for limit in self.limits]

    def changed(self, **columns: Any) -> Outcomes:
        """The same with other columns."""
        return replace(self, columns={**self.columns, **columns})

    def rows(self, rows: NDArray[np.intp]) -> Outcomes:
        """Some of the runs."""
        return self.changed(**{name: column[rows] for name, column in self.columns.items()})

    def with_rows(self, rows: NDArray[np.intp], others: Outcomes) -> Outcomes:
        """The runs, some of them replaced by others."""
        columns = {name: column.copy() for name, column in self.columns.items()}
        for name, column in columns.items():
            column[rows] = others[name]
        return self.changed(**columns)


class Run(NamedTuple):
    """A row, ready to run."""

    plant: Plant
    law: Controller
    case: Case


def run_rows(
    experiment: Experiment,
    rows: Sequence[Row],
    limits: Sequence[Limit] | None = None,
    plant: PlantName = "physics",
    *,
    keep_impossible: bool = False,
    threads: int = 0,
) -> Outcomes:
    """Run the rows of a design; those of one law and duration are one batch.

    Args:
        experiment: Gives laws, plant, settings, and the start that errors are measured by.
        rows: n of them.
        limits: What is required, each of the laws that it names; the experiment's by default.
        plant: ``physics``, or ``corrected`` for the equations with the numbers of the model.
        keep_impossible: Whether a row of which there can be no run is one of the outcomes, with
            the status ``impossible``, instead of an error.
        threads: 0 for all cores.

    Raises:
        GrosmcError: If there can be no such run.
    """
    if limits is None:
        limits = required(experiment.limits, experiment.controllers)
    plants: dict[Any, Plant] = {}
    groups: dict[Any, dict[int, Run]] = {}
    impossible: dict[int, str] = {}
    for i, row in enumerate(rows):
        try:
            run = ready(experiment, row, plant, plants)
        except GrosmcError as error:
            if not keep_impossible:
                raise
            impossible[i] = str(error)
        else:
            groups.setdefault((run.law.law, run.law.name, run.case.duration), {})[i] = run
    count = len(rows)
    columns: dict[str, NDArray[Any]] = {MARGIN + x.key: np.full(count, np.nan) for x in limits}
    columns |= {name: np.full(count, -np.inf) for name in ("relative", "order")}
    columns |= {"status": np.full(count, IMPOSSIBLE, object), "ended": np.zeros(count)}
    for runs in groups.values():
        for name, values in _run_group(experiment, list(runs.values()), limits, threads).items():
            empty = np.full((count, *values.shape[1:]), np.nan)
            columns.setdefault(name, empty)[list(runs)] = values
    return Outcomes(limits, columns, impossible)


def ready(
    experiment: Experiment,
    row: Row,
    name: PlantName = "physics",
    plants: dict[Any, Plant] | None = None,
) -> Run:
    """The plant, the law in its loop and the case of a row.

    Args:
        experiment: Of the row.
        row: The row.
        name: The plant that is made, as of ``run_rows``.
        plants: Plants that were made already, by their numbers; those with equal ones are one.

    Raises:
        GrosmcError: If there can be no such run.
    """
    values = [
        (Parameter.at_path(key) if isinstance(key, str) else key, value)
        for key, value in row.values.items()
    ]
    changed, settings = varied(experiment, values, row.case), experiment.settings
    plant, case, plants = row.plant, changed.case, {} if plants is None else plants
    if plant is None:
        key = case.edits, changed.scales
        if key not in plants:
            own = changed.plant(experiment.plant(experiment.nominal.truest))
            plants[key] = own if name == "physics" else own.analytic(name)
        plant = plants[key]
        plant.require_start(np.array(case.x0))
    law = experiment.law(name, row.law) if isinstance(row.law, str) else row.law
    number = case.run if row.number is None else row.number
    if case.loop is not None and law.loop is not None:
        law = relooped(law, case.loop, number)
    elif case.loop is not None:
        law = in_loop(
            law, case.loop, experiment.nominal.system, control_period=settings.control_period,
            timestep=settings.timestep, predict=row.predict, run=number,
        )  # fmt: skip
    return Run(plant, law, case)


def meters_for(
    experiment: Experiment, runs: Sequence[Run], limits: Sequence[Limit]
) -> list[Meters]:
    """The meters that limits need, of each run; runs with the same ones share them."""

    @cache
    def meters(onset: float, input_limits: bytes, duration: float) -> Meters:
        return meters_of(
            runs[0].law,
            experiment.settings.timestep,
            windows(limits),
            onset,
            costs=costs_wanted(limits),
            limits=np.frombuffer(input_limits).reshape(shape),
            late=(1 - DWELL) * float(transient_of(onset, duration)),
        )

    shape = (2, len(experiment.nominal.system.inputs))
    limits_of = cache(lambda plant: plant.input_limits.tobytes())
    return [meters(run.case.onset, limits_of(run.plant), run.case.duration) for run in runs]


def _run_group(
    experiment: Experiment, runs: Sequence[Run], limits: Sequence[Limit], threads: int
) -> dict[str, NDArray[Any]]:
    """The columns of ``Outcomes`` of runs of one law and duration."""
    settings, law = experiment.settings, runs[0].law
    batch = simulate(
        [run.plant for run in runs],
        [run.law for run in runs],
        np.array([run.case.x0 for run in runs], float),
        duration=runs[0].case.duration,
        control_period=settings.control_period,
        timestep=settings.timestep,
        disturbances=[list(run.case.disturbances) for run in runs],
        meters=meters_for(experiment, runs, limits),
        engine=settings.engine_for(law),
        record=False,
        threads=threads,
    )
    duration, x0 = runs[0].case.duration, np.array([run.case.x0 for run in runs], float)
    onsets = np.array([run.case.onset for run in runs])
    recording = Recording.sampled(settings.timestep, duration, onsets, windows(limits))
    status = np.array([end.name.lower() for end in batch.status], object)
    completed = status == COMPLETED
    ended = np.where(completed, duration, np.asarray(batch.valid_until, float))
    last, costs = batch.state[:, -1], costs_wanted(limits)
    metrics = said_by(law, batch.meters, recording, x0, last, completed, costs=costs)
    own = [limit for limit in limits if law.name in limit.of]
    margins = margins_of(own, metrics, completed)
    shares = [np.ones(len(runs)), *(margins[limit.key] / limit.value for limit in own)]
    start, nothing = initial_error(law, experiment.case.x0), np.full(len(runs), np.nan)
    order = _order(own, shares, metrics, recording, start)
    return {
        **{name: np.where(completed, values, np.nan) for name, values in metrics.items()},
        **{MARGIN + limit.key: margins.get(limit.key, nothing) for limit in limits},
        "relative": np.where(completed, np.min(shares, axis=0), -np.inf),
        "order": np.where(completed, order, -_CUT / (1 + ended)),
        "status": status,
        "ended": ended,
        "last": last,
    }


def _order(
    limits: Sequence[Limit],
    shares: Sequence[Array],
    metrics: Mapping[str, Array],
    recording: Recording,
    start: float,
) -> Array:
    """The least margin in parts of its limit, without the bound that a run's length gives it.

    The margin of a settling time is that of the transient's end T where a run never settles. Then
    it is less the error left in the last tenth of T over the nominal error at the start, or over
    the band if that is wider: (limit - T) / limit - max|e| / max(|e(0)|, band). So the larger error
    is the worse one.
    """
    for limit in limits:
        if limit.kind == "settles_within":
            never = metrics[limit.metric] > (1 - DWELL) * recording.transient
            left = metrics["left"] / max(start, limit.band or 0.0)
            worse = 1 - recording.transient / limit.value - left
            shares = [*shares, np.where(never, worse, np.inf)]
    return np.min(shares, axis=0)
