"""Fourteen faults of laws, plants and settings, which the claims must notice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.mechanics.physics.edits import BodyEdit, apply_edits
from grosmc_mj.mechanics.physics.files import compile_spec
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import AnyDisturbance
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.law import Law
from grosmc_mj.theory.plants import Plant

ChangeLaw = Callable[[Controller, Experiment, PlantName], Controller]
ChangePlant = Callable[[Plant, Experiment], Plant]
Disturbances = tuple[AnyDisturbance, ...]
ChangeDisturbances = Callable[[Disturbances], Disturbances]


class OtherLaws(RunCache):
    """Laboratory whose controllers are changed."""

    def __init__(self, change: ChangeLaw, settings: Settings | None = None) -> None:
        super().__init__(settings or Settings())
        self._change = change

    def controller(self, experiment: Experiment, plant: PlantName, name: str) -> Controller:
        law = super().controller(experiment, plant, name)
        return self._change(law, experiment, plant)


class OtherPlants(RunCache):
    """Laboratory whose plants are changed."""

    def __init__(self, change: ChangePlant) -> None:
        super().__init__(Settings())
        self._change = change

    def plant(self, experiment: Experiment, name: PlantName) -> Plant:
        return self._change(super().plant(experiment, name), experiment)


class OtherDisturbances(RunCache):
    """Laboratory whose disturbances are changed."""

    def __init__(self, change: ChangeDisturbances) -> None:
        super().__init__(Settings())
        self._change = change

    def as_set(self, experiment: Experiment) -> Experiment:
        disturbances = self._change(experiment.disturbances)
        return super().as_set(experiment).changed(disturbances=disturbances)


# Laws


@cache
def _negated(law: Law) -> Law:
    """Law with the other sign of u."""
    sound = jitable(law)

    def negated(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        sound(t, x, memory, p, u)
        for i in range(len(u)):
            u[i] = -u[i]

    return negated


def wrong_sign(law: Controller, _experiment: Experiment, _plant: PlantName) -> Controller:
    return replace(law, law=_negated(law.law))


def no_switching(law: Controller, _experiment: Experiment, _plant: PlantName) -> Controller:
    """eta, gamma0, gamma1, k and epsilon are zero."""
    silent = _scaled(law, eta=0.0, gamma0=0.0, gamma1=0.0, k=0.0, epsilon=0.0)
    if not hasattr(law.parameters, "switching"):
        return silent
    off = replace(law.parameters.switching, gain=0.0)
    return replace(silent, parameters=replace(silent.parameters, switching=off))


def no_integral(law: Controller, _experiment: Experiment, _plant: PlantName) -> Controller:
    """s = G [z - z(0)]."""
    return _scaled(law, S=0.0)


def small_G(law: Controller, _experiment: Experiment, _plant: PlantName) -> Controller:
    """G is a hundredth of B+."""
    return _scaled(law, G=0.01, S=0.01, GB=0.01, GB_inverse=100.0, size_of_GB=0.01)


def _scaled(law: Controller, **factors: float) -> Controller:
    """Law with those of its parameters that it has times these factors."""
    p = law.parameters
    scaled = {
        name: factor * getattr(p, name) for name, factor in factors.items() if hasattr(p, name)
    }
    return replace(law, parameters=replace(p, **scaled))


def printed_a(law: Controller, experiment: Experiment, _plant: PlantName) -> Controller:
    """The laws of the pendulum are designed for eq. (40)."""
    if experiment.system != "cart_pendulum":
        return law
    return experiment.law_for(experiment.nominal.equations("printed"), law.name)


def knows_the_plant(law: Controller, experiment: Experiment, plant: PlantName) -> Controller:
    """Laws are designed from the perturbed parameters."""
    if plant == "printed":
        # With its printed a, eq. (40) is singular for the heavier poles of such a design.
        return law
    return experiment.law_for(experiment.plant("corrected").analytic(), law.name)


# Plants


def no_inertia(plant: Plant, experiment: Experiment) -> Plant:
    """An edit forgets inertia and centre of mass."""
    if not isinstance(plant, MujocoPlant):
        return plant

    nominal = compile_spec(plant.spec)
    edited = apply_edits(plant.spec, experiment.edits)
    for edit in experiment.edits:
        if isinstance(edit, BodyEdit):
            body = edited.body(edit.body)
            before = nominal.body(edit.body)
            body.inertia = before.inertia
            body.ipos = before.ipos
    return replace(plant, spec=edited, edits=())


def no_edits(plant: Plant, _experiment: Experiment) -> Plant:
    return plant.changed()


def edited_twice(plant: Plant, _experiment: Experiment) -> Plant:
    if not isinstance(plant, MujocoPlant):
        return plant
    return replace(plant, spec=apply_edits(plant.spec, plant.edits))


def gravity_up(plant: Plant, _experiment: Experiment) -> Plant:
    if not isinstance(plant, MujocoPlant):
        return plant
    spec = plant.spec.copy()
    spec.option.gravity = -spec.option.gravity
    return replace(plant, spec=spec)


def printed(plant: Plant, _experiment: Experiment) -> Plant:
    """MuJoCo is replaced by the printed equations."""
    return plant.analytic(plant.system.variants[0])


# Disturbances and settings


def no_disturbances(_disturbances: Disturbances) -> Disturbances:
    return ()


def tenfold(disturbances: Disturbances) -> Disturbances:
    return tuple(disturbance.scaled(10.0) for disturbance in disturbances)


SLOW = replace(Settings(), control_period=10 * Settings().control_period)
FAULTS: dict[str, Callable[[], RunCache]] = {
    "wrong sign of u": lambda: OtherLaws(wrong_sign),
    "zero switching gain": lambda: OtherLaws(no_switching),
    "integral left out": lambda: OtherLaws(no_integral),
    "G too small": lambda: OtherLaws(small_G),
    "printed a in the law": lambda: OtherLaws(printed_a),
    "laws know the plant": lambda: OtherLaws(knows_the_plant),
    "mass without inertia": lambda: OtherPlants(no_inertia),
    "edit dropped": lambda: OtherPlants(no_edits),
    "edit done twice": lambda: OtherPlants(edited_twice),
    "gravity upside down": lambda: OtherPlants(gravity_up),
    "printed physics": lambda: OtherPlants(printed),
    "disturbance dropped": lambda: OtherDisturbances(no_disturbances),
    "decimal point misplaced": lambda: OtherDisturbances(tenfold),
    "slow sampling": lambda: RunCache(SLOW),
}
