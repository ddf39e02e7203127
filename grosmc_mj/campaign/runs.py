"""Runs of many plants under one controller, with nothing recorded but what became of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.campaign import Campaign
from grosmc_mj.campaign.family import MARGIN
from grosmc_mj.campaign.plant_sample import PlantSample
from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.metrics import (
    DWELL,
    METRICS,
    Recording,
    meters_of,
    said_by,
    transient_of,
)
from grosmc_mj.experiments.requirements import costs_wanted, initial_error, margins_of, windows
from grosmc_mj.loop import relooped
from grosmc_mj.plants import AnalyticPlant, Plant
from grosmc_mj.simulation.problem import Meters
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status

# What a run is judged by.
EQUATIONS, PHYSICS = "equations", "physics"
# Order of a run that ended at once; none that was completed comes near it.
_CUT = 1e9
_COMPLETED = Status.COMPLETED.name.lower()


@dataclass(frozen=True, eq=False)
class Outcomes:
    """What became of n plants under one controller.

    Attributes:
        campaign: The campaign.
        controller: Name of the controller.
        columns: (n,) each, by the names of a part's columns: ``id``; the uncertain numbers; the
            metrics, NaN for runs that ended early; ``margin KEY`` of each requirement, NaN where it
            is not this controller's; ``status``, in lower case; ``ended``, up to when the run is
            valid [s]; ``relative``, the least margin in parts of its limit: at most 1, which is all
            of a limit, -inf for runs that ended early; ``order``, by which a worse run is told from
            a better one, finite: ``relative``, which has no lower bound where a run never settles,
            see ``_order``; of runs that ended early the earlier is the worse. Then, of screening:
            ``judged_by``, ``EQUATIONS`` or ``PHYSICS``; ``screened``, ``relative`` by the equations
            of those that were screened, NaN of others; ``overturned``, how many verdicts MuJoCo
            overturned; ``drawn``, 1 for a run that was confirmed in MuJoCo by chance alone;
            ``band``, how near to its limit a screened margin is confirmed, in parts of the limit.
    """

    campaign: Campaign
    controller: str
    columns: Mapping[str, NDArray[Any]]

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    @property
    def completed(self) -> NDArray[np.bool_]:
        """Which runs did, (n,)."""
        return self["status"] == _COMPLETED

    @property
    def shares(self) -> list[Array]:
        """Margins in parts of their limits, of each requirement of the controller, (n,)."""
        limits = self.campaign.limits_of(self.controller)
        return [self[MARGIN + limit.key] / limit.value for limit in limits]

    def changed(self, **columns: Any) -> Outcomes:
        """The same with other columns."""
        return Outcomes(self.campaign, self.controller, {**self.columns, **columns})

    def rows(self, rows: NDArray[np.intp]) -> Outcomes:
        """Some of the runs."""
        return self.changed(**{name: column[rows] for name, column in self.columns.items()})

    def with_rows(self, rows: NDArray[np.intp], others: Outcomes) -> Outcomes:
        """The runs, some of them replaced by others."""
        columns = {name: column.copy() for name, column in self.columns.items()}
        for name, column in columns.items():
            column[rows] = others[name]
        return self.changed(**columns)


@dataclass(frozen=True, eq=False)
class Batch:
    """Plants that each controller meets; compiled once for all of them.

    Attributes:
        campaign: The campaign.
        values: The uncertain numbers, (n, d).
        ids: Numbers of the runs, (n,), for what their loops draw; 0 for plants that are no runs.
        threads: 0 for all cores.
    """

    campaign: Campaign
    values: Array
    ids: Sequence[int]
    threads: int = 0

    @cached_property
    def samples(self) -> list[PlantSample]:
        """What the values make of the case, n of them."""
        pairs = zip(self.values, self.ids, strict=True)
        return [self.campaign.plant_sample(row, run) for row, run in pairs]

    @cached_property
    def physics(self) -> list[Plant]:
        """The plants; those with the same edits are one."""
        plants: dict[Any, Plant] = {}
        keys = [(sample.case.edits, sample.scales) for sample in self.samples]
        for key, sample in zip(keys, self.samples, strict=True):
            plants[key] = plants.get(key) or sample.plant(self.campaign.plant)
        return [plants[key] for key in keys]

    @cached_property
    def equations(self) -> list[AnalyticPlant]:
        """The equations with the numbers of the plants' models.

        Raises:
            ModelError: If a plant has what its equations have no term for.
        """
        equations = {plant: plant.analytic() for plant in dict.fromkeys(self.physics)}
        return [equations[plant] for plant in self.physics]

    def run(self, controller: str, rows: NDArray[np.intp] | None = None) -> Outcomes:
        """Run the plants, or some of them, in MuJoCo where there is a model."""
        return self._run(controller, self.physics, rows)

    def run_equations(self, controller: str) -> Outcomes:
        """Run the plants on their equations."""
        return self._run(controller, self.equations)

    def _run(
        self, controller: str, plants: Sequence[Plant], rows: NDArray[np.intp] | None = None
    ) -> Outcomes:
        numbers = range(len(self.values)) if rows is None else rows.tolist()
        campaign, samples = self.campaign, [self.samples[row] for row in numbers]
        chosen, law = [plants[row] for row in numbers], campaign.laws[controller]
        laws, meters = laws_with_meters(campaign, law, samples, chosen)
        run = simulate(
            chosen,
            laws,
            np.array([sample.case.x0 for sample in samples]),
            duration=campaign.duration,
            control_period=campaign.control_period,
            timestep=campaign.experiment.settings.timestep,
            disturbances=[list(sample.case.disturbances) for sample in samples],
            meters=meters,
            engine=campaign.experiment.settings.engine_for(law),
            record=False,
            threads=self.threads,
        )
        ends = (run.meters, run.state[:, -1], run.status, run.valid_until)
        ids, kind = np.asarray(self.ids, np.int64)[numbers], chosen[0].kind
        return outcomes(campaign, controller, ids, self.values[numbers], samples, *ends, kind)


def evaluate(campaign: Campaign, controller: str, values: Array) -> Outcomes:
    """Run plants (n, d) that are no runs of the campaign, in MuJoCo where there is a model."""
    return Batch(campaign, values, [0] * len(values)).run(controller)


def outcomes(
    campaign: Campaign,
    controller: str,
    ids: NDArray[np.int64],
    values: Array,
    samples: Sequence[PlantSample],
    meters: Any,
    last: Array,
    status: Iterable[Any],
    valid_until: Any,
    kind: str,
) -> Outcomes:
    """What the meters of n runs say.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        ids: Numbers of the runs, (n,).
        values: (n, d).
        samples: n of them.
        meters: Of each, (n,).
        last: Their last states, (n, states).
        status: How each ended, ``Status`` values, (n,).
        valid_until: Up to when each is valid [s], (n,).
        kind: Of the plants.
    """
    duration, law, runs = campaign.duration, campaign.laws[controller], len(values)
    onsets = np.array([sample.case.onset for sample in samples])
    recording = Recording.sampled(
        campaign.experiment.settings.timestep, duration, onsets, windows(campaign.requirements)
    )
    words = np.array([end.name.lower() for end in status], object)
    completed = words == _COMPLETED
    ended = np.where(completed, duration, np.asarray(valid_until, float))
    x0 = np.array([sample.case.x0 for sample in samples])
    costs = costs_wanted(campaign.requirements)
    metrics = said_by(law, meters, recording, x0, last, completed, costs=costs)
    limits = campaign.limits_of(controller)
    margins = margins_of(limits, metrics, completed)
    shares = [np.ones(runs), *(margins[limit.key] / limit.value for limit in limits)]
    order = _order(campaign, controller, shares, metrics, recording)
    nothing, none = np.full(runs, np.nan), np.zeros(runs, np.int64)
    judge = PHYSICS if kind == "physics" else EQUATIONS
    columns = {
        "id": ids,
        **dict(zip(campaign.family.names, values.T, strict=True)),
        **{name: np.where(completed, metrics[name], np.nan) for name in METRICS},
        **{MARGIN + of.key: margins.get(of.key, nothing) for of in campaign.requirements},
        "relative": np.where(completed, np.min(shares, axis=0), -np.inf),
        "order": np.where(completed, order, -_CUT / (1 + ended)),
        "status": words,
        "ended": ended,
        "judged_by": np.array([judge] * runs, object),
        "screened": nothing,
        "overturned": none,
        "drawn": none,
        "band": np.zeros(runs),
    }
    return Outcomes(campaign, controller, columns)


def _order(
    campaign: Campaign,
    controller: str,
    shares: Sequence[Array],
    metrics: Mapping[str, Array],
    recording: Recording,
) -> Array:
    """The least margin in parts of its limit, without the bound that a run's length gives it.

    The margin of a settling time is that of the transient's end T where a run never settles. Then
    it is less the error left in the last tenth of T over the nominal error at the start, or over
    the band if that is wider: (limit - T) / limit - max|e| / max(|e(0)|, band). So the larger error
    is the worse one.
    """
    start = initial_error(campaign.laws[controller], campaign.experiment.case.x0)
    for limit in campaign.limits_of(controller):
        if limit.kind == "settles_within":
            never = metrics[limit.metric] > (1 - DWELL) * recording.transient
            left = metrics["left"] / max(start, limit.band or 0.0)
            worse = 1 - recording.transient / limit.value - left
            shares = [*shares, np.where(never, worse, np.inf)]
    return np.min(shares, axis=0)


def laws_with_meters(
    campaign: Campaign, law: Controller, samples: Sequence[PlantSample], plants: Sequence[Plant]
) -> tuple[list[Controller], list[Meters]]:
    """A law in the loop of each run, and the meters that the requirements need.

    Runs whose disturbances begin together have the same meters, if their plants limit the input
    alike.
    """
    shape = (2, len(campaign.plant.system.inputs))

    @cache
    def meters(onset: float, limits: bytes) -> Meters:
        return meters_of(
            law,
            campaign.experiment.settings.timestep,
            windows(campaign.requirements),
            onset,
            costs=costs_wanted(campaign.requirements),
            limits=np.frombuffer(limits).reshape(shape),
            late=(1 - DWELL) * float(transient_of(onset, campaign.duration)),
        )

    limits_of = cache(lambda plant: plant.input_limits.tobytes())
    loops = [(sample.case.loop, sample.run) for sample in samples]
    laws = [law if loop is None else relooped(law, loop, run) for loop, run in loops]
    pairs = zip(samples, plants, strict=True)
    return laws, [meters(sample.case.onset, limits_of(plant)) for sample, plant in pairs]
