"""One part of a campaign: its plants, each under every controller."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.family.plant_sample import PlantSample
from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.metrics import (
    DWELL,
    METRICS,
    Recording,
    meters_of,
    said_by,
    transient_of,
)
from grosmc_mj.experiments.requirements import (
    costs_wanted,
    initial_error,
    margins_of,
    windows,
)
from grosmc_mj.loop import relooped
from grosmc_mj.plants import Plant
from grosmc_mj.plants.plant import Kind
from grosmc_mj.simulation.problem import Meters
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status

# What a run is judged by.
EQUATIONS, PHYSICS = "equations", "physics"
# Order of a run that ended at once; none that was completed comes near it.
_CUT = 1e9


@dataclass(frozen=True, eq=False)
class Outcomes:
    """What became of n plants under one controller.

    Attributes:
        controller: Its name.
        values: The uncertain numbers, (n, d).
        metrics: By name, (n,) each; NaN for runs that ended early.
        margins: By the requirement's key, (n,) each; NaN where it is not this controller's.
        status: How each run ended, in lower case, (n,).
        ended: Up to when it is valid [s], (n,).
        relative: The least margin in parts of its limit, (n,): at most 1, which is all of a limit;
            -inf for runs that ended early.
        order: By which a worse run is told from a better one, (n,), finite: ``relative``, which
            has no lower bound where a run never settles, see ``_order``; of runs that ended early
            the earlier is the worse.
        judged_by: What each run was made on, ``EQUATIONS`` or ``PHYSICS``, (n,).
        screened: ``relative`` by the equations of those that were screened, (n,); NaN of others.
        overturned: How many verdicts MuJoCo overturned of a run that was screened, (n,).
        drawn: 1 for a run that was confirmed in MuJoCo by chance alone, else 0, (n,).
        band: How near to its limit a screened margin is confirmed, in parts of the limit; 0 where
            nothing was screened.
    """

    controller: str
    values: Array
    metrics: dict[str, Array]
    margins: dict[str, Array]
    status: Sequence[str]
    ended: Array
    relative: Array
    order: Array
    judged_by: Sequence[str]
    screened: Array
    overturned: NDArray[np.int64]
    drawn: NDArray[np.int64]
    band: float = 0.0

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Which runs keep everything, (n,)."""
        return self.relative >= 0

    def rows(self, rows: NDArray[np.intp]) -> Outcomes:
        """Some of the runs."""
        return self._with(lambda column, _: column[rows], self)

    def with_rows(self, rows: NDArray[np.intp], others: Outcomes) -> Outcomes:
        """The runs, some of them replaced by others."""

        def replaced(column: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
            new = column.copy()
            new[rows] = other
            return new

        return self._with(replaced, others)

    def _with(
        self, change: Callable[[NDArray[Any], NDArray[Any]], NDArray[Any]], others: Outcomes
    ) -> Outcomes:
        """The same with each column changed, beside the same column of others."""

        def changed(own: Any, other: Any) -> Any:
            if isinstance(own, Mapping):
                return {name: change(own[name], other[name]) for name in own}
            if isinstance(own, np.ndarray):
                return change(own, other)
            return change(np.array(own, object), np.array(other, object)).tolist()

        names = ("values", "metrics", "margins", "status", "ended", "relative", "order")
        names = (*names, "judged_by", "screened", "overturned", "drawn")
        return replace(
            self, **{name: changed(getattr(self, name), getattr(others, name)) for name in names}
        )


def evaluate(campaign: Campaign, controller: str, values: Array, threads: int = 0) -> Outcomes:
    """Run plants under one controller, as ``evaluate_all`` does."""
    return evaluate_all(campaign, [controller], values, threads)[0]


def evaluate_all(
    campaign: Campaign,
    controllers: Iterable[str],
    values: Array,
    threads: int = 0,
    ids: Sequence[int] | None = None,
) -> list[Outcomes]:
    """Run the same plants under each controller, as one batch, with nothing recorded.

    Args:
        campaign: The campaign.
        controllers: Names of the controllers; their batches share the plants' compiled models.
        values: The uncertain numbers, (n, d).
        threads: 0 for all cores.
        ids: Numbers of the runs, (n,), for what their loops draw; 0 for each by default.
    """
    numbers = [0] * len(values) if ids is None else ids
    plant_samples = [
        campaign.plant_sample(row, run) for row, run in zip(values, numbers, strict=True)
    ]
    plants = plants_of(campaign, plant_samples)
    return [
        run_on(plants, campaign, controller, values, plant_samples, threads)
        for controller in controllers
    ]


def run_on(
    plants: Sequence[Plant],
    campaign: Campaign,
    controller: str,
    values: Array,
    plant_samples: Sequence[PlantSample],
    threads: int = 0,
) -> Outcomes:
    """Run n plants under one controller as a batch, with nothing recorded.

    Args:
        plants: In MuJoCo or as equations, n of them.
        campaign: The campaign.
        controller: Name of the controller.
        values: The uncertain numbers, (n, d).
        plant_samples: What these make of the case, n of them.
        threads: 0 for all cores.
    """
    law = campaign.laws[controller]
    laws, meters = laws_with_meters(campaign, law, plant_samples, plants)
    run = simulate(
        plants,
        laws,
        np.array([plant_sample.case.x0 for plant_sample in plant_samples]),
        duration=campaign.duration,
        control_period=campaign.control_period,
        timestep=campaign.experiment.settings.timestep,
        disturbances=[list(plant_sample.case.disturbances) for plant_sample in plant_samples],
        meters=meters,
        engine=campaign.experiment.settings.engine_for(law),
        record=False,
        threads=threads,
    )
    ends = (run.meters, run.state[:, -1], run.status, run.valid_until)
    return outcomes(campaign, controller, values, plant_samples, *ends, plants[0].kind)


def outcomes(
    campaign: Campaign,
    controller: str,
    values: Array,
    plant_samples: Sequence[PlantSample],
    meters: Any,
    last: Array,
    status: Iterable[Any],
    valid_until: Any,
    kind: Kind = "physics",
) -> Outcomes:
    """What the meters of n runs say.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        values: (n, d).
        plant_samples: n of them.
        meters: Of each, (n,).
        last: Their last states, (n, states).
        status: How each ended, ``Status`` values, (n,).
        valid_until: Up to when each is valid [s], (n,).
        kind: Of the plants.
    """
    duration = campaign.duration
    recording = Recording.sampled(
        campaign.experiment.settings.timestep,
        duration,
        np.array([plant_sample.case.onset for plant_sample in plant_samples]),
        windows(campaign.requirements),
    )
    words = [each.name.lower() for each in status]
    completed = np.array(words) == Status.COMPLETED.name.lower()
    ended = np.where(completed, duration, np.asarray(valid_until, float))
    found = said_by(
        campaign.laws[controller],
        meters,
        recording,
        np.array([plant_sample.case.x0 for plant_sample in plant_samples]),
        last,
        completed,
        costs=costs_wanted(campaign.requirements),
    )
    metrics = {name: np.where(completed, found[name], np.nan) for name in METRICS}
    own = [each for each in campaign.requirements if controller in each.of]
    margins = margins_of(own, found, completed)
    shares = [np.ones(len(values)), *(margins[each.key] / each.value for each in own)]
    nothing = np.full(len(values), np.nan)
    return Outcomes(
        controller=controller,
        values=values,
        metrics=metrics,
        margins={each.key: margins.get(each.key, nothing) for each in campaign.requirements},
        status=words,
        ended=ended,
        relative=np.where(completed, np.min(shares, axis=0), -np.inf),
        order=np.where(
            completed, _order(campaign, controller, shares, found, recording), -_CUT / (1 + ended)
        ),
        judged_by=[PHYSICS if kind == "physics" else EQUATIONS] * len(values),
        screened=nothing,
        overturned=np.zeros(len(values), np.int64),
        drawn=np.zeros(len(values), np.int64),
    )


def _order(
    campaign: Campaign,
    controller: str,
    shares: Sequence[Array],
    found: Mapping[str, Array],
    recording: Recording,
) -> Array:
    """The least margin in parts of its limit, without the bound that a run's length gives it.

    The margin of a settling time is that of the transient's end T where a run never settles. Then
    it is less the error left in the last tenth of T over the nominal error at the start, or over
    the band if that is wider: (limit - T) / limit - max|e| / max(|e(0)|, band). So the larger error
    is the worse one.
    """
    own = [each for each in campaign.requirements if controller in each.of]
    start = initial_error(campaign.laws[controller], campaign.experiment.case.x0)
    for limit in (each for each in own if each.kind == "settles_within"):
        never = found[limit.metric] > (1 - DWELL) * recording.transient
        left = found["left"] / max(start, limit.band or 0.0)
        worse = 1 - recording.transient / limit.value - left
        shares = [*shares, np.where(never, worse, np.inf)]
    return np.min(shares, axis=0)


def plants_of(campaign: Campaign, plant_samples: Sequence[PlantSample]) -> list[Plant]:
    """The members' plants; those with the same edits are one, compiled once."""
    made: dict[Any, Plant] = {}
    for plant_sample in plant_samples:
        key = (plant_sample.case.edits, plant_sample.scales)
        if key not in made:
            made[key] = plant_sample.plant(campaign.plant)
    return [made[plant_sample.case.edits, plant_sample.scales] for plant_sample in plant_samples]


def laws_with_meters(
    campaign: Campaign,
    law: Controller,
    plant_samples: Sequence[PlantSample],
    plants: Sequence[Plant],
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
    loops = [(sample.case.loop, sample.run) for sample in plant_samples]
    laws = [law if loop is None else relooped(law, loop, run) for loop, run in loops]
    return laws, [
        meters(sample.case.onset, limits_of(plant))
        for sample, plant in zip(plant_samples, plants, strict=True)
    ]
