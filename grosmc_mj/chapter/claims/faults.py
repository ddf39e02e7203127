"""Faults to put in on purpose: claims that are worth something notice them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import mujoco

from grosmc_mj.control.controller import Controller
from grosmc_mj.control.law import Law
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Fault
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.jitable import jitable
from grosmc_mj.physics.edits import BodyEdit, apply_edits
from grosmc_mj.physics.files import compile_spec
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import Plant


@cache
def _negated(law: Law) -> Law:
    """The law with the other sign of u."""
    sound = jitable(law)

    def negated(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        sound(t, x, memory, p, u)
        for i in range(len(u)):
            u[i] = -u[i]

    return negated


def _wrong_sign(law: Controller, _experiment: Experiment, _plant: PlantName) -> Controller:
    return replace(law, law=_negated(law.law))


def _no_switching(law: Controller, _experiment: Experiment, _plant: PlantName) -> Controller:
    gains = dict.fromkeys(("eta", "gamma0", "gamma1", "k", "epsilon"), 0.0)
    own: dict[str, Any] = {
        name: value for name, value in gains.items() if hasattr(law.parameters, name)
    }
    if hasattr(law.parameters, "switching"):
        own["switching"] = replace(law.parameters.switching, gain=0.0)
    return replace(law, parameters=replace(law.parameters, **own))


def _no_integral(law: Controller, _experiment: Experiment, _plant: PlantName) -> Controller:
    if not hasattr(law.parameters, "S"):
        return law
    return replace(law, parameters=replace(law.parameters, S=0 * law.parameters.S))


def _small_g(law: Controller, _experiment: Experiment, _plant: PlantName) -> Controller:
    p = law.parameters
    if not hasattr(p, "S"):
        return law
    small = replace(
        p,
        G=0.01 * p.G,
        S=0.01 * p.S,
        GB=0.01 * p.GB,
        GB_inverse=100 * p.GB_inverse,
        size_of_GB=0.01 * p.size_of_GB,
    )
    return replace(law, parameters=small)


def _printed_a(law: Controller, experiment: Experiment, _plant: PlantName) -> Controller:
    if experiment.case.system != "cart_pendulum":
        return law
    printed = experiment.nominal.equations("printed")
    return experiment.law_for(printed, law.name)


def _knows_the_plant(law: Controller, experiment: Experiment, plant: PlantName) -> Controller:
    if plant == "printed":
        # With its printed a, eq. (40) is singular for the heavier poles of such a design.
        return law
    return experiment.law_for(experiment.plant("corrected").analytic(), law.name)


def _no_inertia(plant: Plant, experiment: Experiment, _name: PlantName) -> Plant:
    if not isinstance(plant, MujocoPlant) or not experiment.case.edits:
        return plant
    nominal, edited = compile_spec(plant.spec), apply_edits(plant.spec, experiment.case.edits)
    for edit in experiment.case.edits:
        if not isinstance(edit, BodyEdit):
            continue
        body = edited.body(edit.body)
        body.inertia = nominal.body(edit.body).inertia
        body.ipos = nominal.body(edit.body).ipos
    return replace(plant, spec=edited, edits=())


def _no_edit(plant: Plant, _experiment: Experiment, _name: PlantName) -> Plant:
    return plant.changed()


def _edit_twice(plant: Plant, _experiment: Experiment, _name: PlantName) -> Plant:
    if not isinstance(plant, MujocoPlant) or not plant.edits:
        return plant
    return replace(plant, spec=apply_edits(plant.spec, plant.edits))


def _gravity_up(plant: Plant, _experiment: Experiment, _name: PlantName) -> Plant:
    if not isinstance(plant, MujocoPlant):
        return plant
    spec: mujoco.MjSpec = plant.spec.copy()
    spec.option.gravity = -spec.option.gravity
    return replace(plant, spec=spec)


def _printed_physics(plant: Plant, _experiment: Experiment, _name: PlantName) -> Plant:
    return plant.analytic(plant.system.variants[0])


def _tenfold(experiment: Experiment) -> Experiment:
    pushes = [
        replace(each, wrench=tuple(10 * entry for entry in each.wrench))
        for each in experiment.case.disturbances
    ]
    return experiment.varied(disturbances=tuple(pushes))


def _slowly(settings: Settings) -> Settings:
    return replace(settings, control_period=10 * settings.control_period)


FAULTS = (
    Fault("wrong sign of u", "every law pushes the other way", controller=_wrong_sign),
    Fault("zero switching gain", "η, γ0, γ1, k and ε are zero", controller=_no_switching),
    Fault("integral left out", "s = G [z - z(0)]", controller=_no_integral),
    Fault("G too small", "G is a hundredth of B+", controller=_small_g),
    Fault("printed a in the law", "the pendulum's laws believe eq. (40)", controller=_printed_a),
    Fault("mass without inertia", "an edit forgets inertia and centre of mass", plant=_no_inertia),
    Fault("edit dropped", "MuJoCo runs the nominal model", plant=_no_edit),
    Fault("edit done twice", "MuJoCo's model is edited once more", plant=_edit_twice),
    Fault(
        "disturbance dropped",
        "no wrench reaches the plant",
        experiment=lambda experiment: experiment.varied(disturbances=()),
    ),
    Fault(
        "decimal point misplaced",
        "every wrench is ten times as large",
        experiment=_tenfold,
    ),
    Fault("gravity upside down", "gravity points up in MuJoCo", plant=_gravity_up),
    Fault("slow sampling", "the law runs every 10 ms", settings=_slowly),
    Fault(
        "laws know the plant",
        "controllers are designed from the perturbed parameters",
        controller=_knows_the_plant,
    ),
    Fault(
        "printed physics",
        "MuJoCo is replaced by the printed equations",
        plant=_printed_physics,
    ),
)
