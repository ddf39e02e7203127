"""Faults to put in on purpose: claims that are worth something notice them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import mujoco

from grosmc_mj.control.controller import Controller
from grosmc_mj.control.law import Law
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Fault
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.jitable import jitable
from grosmc_mj.physics.edits import BodyEdit, apply_edits
from grosmc_mj.physics.files import compile_spec
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.disturbances import Disturbance


@cache
def _negated(law: Law) -> Law:
    """The law with the other sign of u."""
    sound = jitable(law)

    def negated(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        sound(t, x, memory, p, u)
        for i in range(len(u)):
            u[i] = -u[i]

    return negated


def _with(law: Controller, **factors: float) -> Controller:
    """The law with those of its parameters that it has, times these factors."""
    p = law.parameters
    own = {name: value * getattr(p, name) for name, value in factors.items() if hasattr(p, name)}
    return replace(law, parameters=replace(p, **own))


def _no_switching(law: Controller, _experiment: Experiment, _plant: PlantName) -> Controller:
    silent = _with(law, eta=0.0, gamma0=0.0, gamma1=0.0, k=0.0, epsilon=0.0)
    if not hasattr(law.parameters, "switching"):
        return silent
    off = replace(law.parameters.switching, gain=0.0)
    return replace(silent, parameters=replace(silent.parameters, switching=off))


def _printed_a(law: Controller, experiment: Experiment, _plant: PlantName) -> Controller:
    if experiment.case.system != "cart_pendulum":
        return law
    return experiment.law_for(experiment.nominal.equations("printed"), law.name)


def _knows_the_plant(law: Controller, experiment: Experiment, plant: PlantName) -> Controller:
    if plant == "printed":
        # With its printed a, eq. (40) is singular for the heavier poles of such a design.
        return law
    return experiment.law_for(experiment.plant("corrected").analytic(), law.name)


def _no_inertia(plant: MujocoPlant, experiment: Experiment) -> Plant:
    nominal, edited = compile_spec(plant.spec), apply_edits(plant.spec, experiment.case.edits)
    for edit in experiment.case.edits:
        if isinstance(edit, BodyEdit):
            body, before = edited.body(edit.body), nominal.body(edit.body)
            body.inertia, body.ipos = before.inertia, before.ipos
    return replace(plant, spec=edited, edits=())


def _gravity_up(plant: MujocoPlant, _experiment: Experiment) -> Plant:
    spec: mujoco.MjSpec = plant.spec.copy()
    spec.option.gravity = -spec.option.gravity
    return replace(plant, spec=spec)


def _in_physics(
    change: Callable[[MujocoPlant, Experiment], Plant],
) -> Callable[[Plant, Experiment, PlantName], Plant]:
    """A change of MuJoCo's plants alone."""
    return lambda plant, experiment, _name: (
        change(plant, experiment) if isinstance(plant, MujocoPlant) else plant
    )


def _tenfold(push: Disturbance) -> Disturbance:
    return replace(push, wrench=tuple(10 * entry for entry in push.wrench))


FAULTS = (
    Fault(
        "wrong sign of u",
        "every law pushes the other way",
        controller=lambda law, *_: replace(law, law=_negated(law.law)),
    ),
    Fault("zero switching gain", "η, γ0, γ1, k and ε are zero", controller=_no_switching),
    Fault(
        "integral left out",
        "s = G [z - z(0)]",
        controller=lambda law, *_: _with(law, S=0.0),
    ),
    Fault(
        "G too small",
        "G is a hundredth of B+",
        controller=lambda law, *_: _with(
            law, G=0.01, S=0.01, GB=0.01, GB_inverse=100.0, size_of_GB=0.01
        ),
    ),
    Fault("printed a in the law", "the pendulum's laws believe eq. (40)", controller=_printed_a),
    Fault(
        "mass without inertia",
        "an edit forgets inertia and centre of mass",
        plant=_in_physics(_no_inertia),
    ),
    Fault(
        "edit dropped",
        "MuJoCo runs the nominal model",
        plant=lambda plant, *_: plant.changed(),
    ),
    Fault(
        "edit done twice",
        "MuJoCo's model is edited once more",
        plant=_in_physics(
            lambda plant, _: replace(plant, spec=apply_edits(plant.spec, plant.edits))
        ),
    ),
    Fault(
        "disturbance dropped",
        "no wrench reaches the plant",
        experiment=lambda experiment: experiment.varied(disturbances=()),
    ),
    Fault(
        "decimal point misplaced",
        "every wrench is ten times as large",
        experiment=lambda experiment: experiment.varied(
            disturbances=tuple(map(_tenfold, experiment.case.disturbances))
        ),
    ),
    Fault("gravity upside down", "gravity points up in MuJoCo", plant=_in_physics(_gravity_up)),
    Fault(
        "slow sampling",
        "the law runs every 10 ms",
        settings=lambda settings: replace(settings, control_period=10 * settings.control_period),
    ),
    Fault(
        "laws know the plant",
        "controllers are designed from the perturbed parameters",
        controller=_knows_the_plant,
    ),
    Fault(
        "printed physics",
        "MuJoCo is replaced by the printed equations",
        plant=lambda plant, *_: plant.analytic(plant.system.variants[0]),
    ),
)
