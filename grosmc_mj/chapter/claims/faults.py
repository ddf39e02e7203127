"""Faults put in on purpose, to see which claims notice."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import mujoco

from grosmc_mj.chapter.claims.claim import Claim, Verdict
from grosmc_mj.chapter.claims.ledger import CLAIMS, judge
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.laws import Law
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Fault, Laboratory
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.edits import BodyEdit, apply_edits
from grosmc_mj.simulation.models import compile_spec
from grosmc_mj.simulation.mujoco_plant import MujocoPlant
from grosmc_mj.vectors import each


class Caught(NamedTuple):
    """What a fault did to the ledger.

    Attributes:
        fault: The fault.
        claims: Ids of the claims that noticed: a verdict is not what it is in a sound laboratory.
        tried: How many claims were tried.
        became: Verdicts that were not given in the sound laboratory.
    """

    fault: Fault
    claims: tuple[str, ...]
    tried: int = 0
    became: tuple[Verdict, ...] = ()


@cache
def _negated(law: Law, m: int) -> Law:
    """The law of m inputs with the other sign of u."""
    sound, minus = jitable(law), each(m, lambda i, u: -u[i])

    def negated(t: float, x: Any, memory: Any, p: Any) -> float:
        return -sound(t, x, memory, p)

    def all_negated(t: float, x: Any, memory: Any, p: Any) -> Any:
        return minus(sound(t, x, memory, p))

    return negated if m == 1 else all_negated


def _wrong_sign(law: Controller, _experiment: Experiment, _plant: PlantName) -> Controller:
    return replace(law, law=_negated(law.law, law.designed.error.inputs))


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


def _gravity_up(plant: Plant, _experiment: Experiment, _name: PlantName) -> Plant:
    if not isinstance(plant, MujocoPlant):
        return plant
    spec: mujoco.MjSpec = plant.spec.copy()
    spec.option.gravity = -spec.option.gravity
    return replace(plant, spec=spec)


def _printed_physics(plant: Plant, _experiment: Experiment, _name: PlantName) -> Plant:
    return plant.analytic(plant.system.variants[0])


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
    Fault(
        "disturbance dropped",
        "no wrench reaches the plant",
        experiment=lambda experiment: experiment.varied(disturbances=()),
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


def self_test(
    settings: Settings,
    claims: Sequence[Claim] = CLAIMS,
    faults: Sequence[Fault] = FAULTS,
    advance: Callable[[str], object] = lambda _: None,
    *,
    thorough: bool = False,
) -> Iterator[Caught]:
    """Put in each fault in turn and see which claims change a verdict.

    Without refinement: a fault shows at the first look. A claim that has noticed a fault is asked
    again only where no other notices one.

    Args:
        settings: How cases are run.
        claims: Claims to try.
        faults: Faults to put in.
        advance: Called with a fault's name when it has been tried.
        thorough: Whether to ask every claim of every fault.
    """
    lab, sound = Laboratory(settings), {}
    noticed: set[str] = set()
    for fault in faults:
        faulty, found, became, tried = Laboratory(settings, fault), [], [], 0
        for claim in sorted(claims, key=lambda claim: claim.id in noticed):
            if not thorough and found and claim.id in noticed:
                break
            if claim.id not in sound:
                sound[claim.id] = _verdicts(lab, claim)
            verdicts, tried = _verdicts(faulty, claim), tried + 1
            if verdicts != sound[claim.id]:
                found.append(claim.id)
                was = sound[claim.id]
                became += [each for name, each in verdicts.items() if each != was.get(name)]
        noticed.update(found)
        yield Caught(fault, tuple(found), tried, tuple(v for v in Verdict if v in became))
        advance(fault.name)


def _verdicts(lab: Laboratory, claim: Claim) -> dict[str, Verdict | str]:
    """A claim's verdict on every plant."""
    try:
        judged = judge(lab, claim, refine=False)
    except (ValueError, RuntimeError) as error:
        # A laboratory so wrong that it cannot measure has been noticed as well.
        return {"error": type(error).__name__}
    return {name: each.verdict for name, each in judged.plants.items()}
