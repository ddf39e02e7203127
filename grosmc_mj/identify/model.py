"""A machine that a log may be of: a plant, and what lies between the log and it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.ground.errors import GrosmcError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import AnyDisturbance, Constant, Pulse, SineFrom
from grosmc_mj.simulation.loop import Loop, Sensor
from grosmc_mj.theory.plants import Plant

# Time over which the speeds of a log are taken, in samples at least and in seconds.
_SPEED_SAMPLES = 5
_SPEED_TIME = 0.05


@dataclass(frozen=True, eq=False)
class LogModel:
    """A machine that a log may be of.

    Attributes:
        plant: Its plant.
        loop: What lies between log and plant, of which delays, biases and scales count.
        disturbances: Its disturbances, from the first instant of the log on.
    """

    plant: Plant
    loop: Loop | None = None
    disturbances: Sequence[AnyDisturbance] = ()

    @property
    def delay(self) -> float:
        """Delay of the inputs [s]; of several actuators, the fastest one's."""
        if self.loop is None:
            return 0.0
        delays = [actuator.delay for actuator in self.loop.actuators]
        return self.loop.computing.delay + min(delays, default=0.0)

    def sensor(self, state: str) -> Sensor:
        """The sensor of a state, an ideal one where it has none."""
        if self.loop is not None:
            for sensor in self.loop.sensors:
                if sensor.of == state:
                    return sensor
        return Sensor(state)

    def disturbances_from(self, start: float) -> Sequence[AnyDisturbance]:
        """The disturbances of a run that begins at an instant of the log [s]."""
        return [_begun(disturbance, start) for disturbance in self.disturbances]

    def require_speeds(self, log: Log) -> None:
        """Refuse a plant that the timestep makes unstable at the speeds of a log.

        Raises:
            ArgumentError: With the timestep that it needs.
        """
        if not isinstance(self.plant, MujocoPlant):
            return
        system = self.plant.system
        dof = system.degrees_of_freedom
        speeds = np.zeros(len(system.states))
        for index in range(dof):
            position = system.states[index].name
            rate = system.states[dof + index].name
            speeds[dof + index] = _top_speed(log, position, rate)
        self.plant.require_speeds(speeds)


@dataclass(frozen=True)
class _Later:
    """A course in time that began before the run.

    Attributes:
        profile: Function of the time since the beginning of the log [s].
        start: The run's first instant there [s].
    """

    profile: Any
    start: float

    def __call__(self, t: float) -> float:
        """Value at t [s] of the run."""
        return self.profile(t + self.start)


def _begun(disturbance: AnyDisturbance, start: float) -> AnyDisturbance:
    """A disturbance as a run sees it that begins at an instant of the log [s]."""
    profile: Any = disturbance.profile
    if type(profile) is Constant:
        return disturbance

    if type(profile) is Pulse:
        later: Any = Pulse(profile.start - start, profile.stop - start)
    elif type(profile) is SineFrom:
        phase = profile.phase + profile.frequency * start
        later = SineFrom(profile.frequency, profile.onset - start, phase)
    else:
        later = _Later(profile, start)
    # Each kind is a dataclass.
    kind: Any = disturbance
    return replace(kind, profile=later)


def _top_speed(log: Log, position: str, rate: str) -> float:
    """Largest mean speed of a coordinate over a short time; 0 where it is not measured."""
    if rate in log.states:
        return float(np.abs(log.states[rate]).max())
    if position not in log.states:
        return 0.0

    samples = max(_SPEED_SAMPLES, round(_SPEED_TIME / log.sampling))
    speeds = [0.0]
    for piece in log.pieces:
        values = log.states[position][piece]
        time = log.time[piece]
        if len(time) > samples:
            moved = values[samples:] - values[:-samples]
            speeds.append(float(np.abs(moved / (time[samples:] - time[:-samples])).max()))
    return max(speeds)


def models_of(experiment: Experiment) -> Mapping[str, LogModel]:
    """The plants of a case, the truest one behind its loop, and the machine of its system."""
    case = experiment
    rungs = {}
    for name in experiment.plant_names:
        rungs[name] = LogModel(experiment.plant(name), disturbances=case.disturbances)
    truest = experiment.plant(experiment.nominal.truest)
    if case.loop is not None:
        rungs["loop"] = LogModel(truest, case.loop, case.disturbances)
    if experiment.nominal.shipped and not experiment.on_machine:
        try:
            machine = find_experiment(case.system, "machine")
        except GrosmcError:
            return rungs
        plant = machine.plant(machine.nominal.truest)
        rungs["machine"] = LogModel(plant, disturbances=case.disturbances)
    return rungs
