"""One-line notes beside the verdict of an experiment: ideals, loads, weights."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from grosmc_mj.experiments.assumptions.growth import growth
from grosmc_mj.experiments.assumptions.loads import idle_loads
from grosmc_mj.experiments.assumptions.matching import unmatched
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.laws.packaged import follows_weights
from grosmc_mj.experiments.requirements.judging import unfailing
from grosmc_mj.experiments.weights import weights_in_words
from grosmc_mj.ground.errors import name_list
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.mechanics.physics.dry_friction import creeping_joints
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import OutputDisturbance
from grosmc_mj.theory.plants import Plant

# Timestep [s] and integrator of a model that sets none.
_DEFAULT_STEPS = (0.002, "Euler")


def notes_on(experiment: Experiment, results: Sequence[RunResult]) -> list[str]:
    """Return the notes on an experiment's runs, the weightiest first.

    The loads are looked at on the truest plant that was run.

    Args:
        experiment: The experiment.
        results: Its runs.
    """
    truest = max(experiment.plant_names, key=experiment.nominal.names.index)
    on_truest = [result for result in results if result.plant == truest]

    notes = list(experiment.not_judged)
    notes += _unasked(experiment)
    notes += idle_loads(on_truest)
    notes += [never_acts(load, experiment.duration) for load in _late(experiment)]
    notes += _unmeasured(experiment)
    notes += growth(experiment, [result.controller for result in on_truest])
    notes += unmatched(experiment, on_truest)
    notes += unfailing(experiment.limits, results)
    notes += _neglected_poles(on_truest)
    notes += _names_left_out(experiment, on_truest)
    notes += _weights_by_order(experiment, on_truest)
    notes += _steps_by_default(experiment)
    notes += _masses_at_origins(experiment)
    notes += notes_on_plant(experiment, experiment.plant(experiment.nominal.truest))
    if experiment.nominal.robot is not None:
        notes += experiment.nominal.robot.notes
    return notes


def notes_on_plant(experiment: Experiment, plant: Plant) -> list[str]:
    """Return a line on rates that are known exactly, and one on dry friction that creeps.

    Args:
        experiment: The experiment, with its loop.
        plant: Its truest plant.
    """
    return [*_exact_rates(experiment), *_creeping_friction(plant)]


def _unasked(experiment: Experiment) -> Iterator[str]:
    """Yield a line on laws of which nothing is required, by an extended file that has others.

    A file that names the laws of its requirements itself has left the others out on purpose.
    """
    file = experiment.file
    base = file.base_of("requirement")
    if not base or file.base_of("controller"):
        return

    asked: set[str] = set()
    for requirement in experiment.required:
        asked.update(requirement.laws)
    unasked = [name for name in experiment.controllers if name not in asked]
    if unasked:
        yield (
            f"nothing is required of {name_list(unasked)}: the requirements of {base} are of "
            f"{name_list(sorted(asked))}; a [[requirement]] of your own replaces them"
        )


def _late(experiment: Experiment) -> Iterator[str]:
    """Yield the label, or the body or signal, of each disturbance that begins after the run."""
    for disturbance in experiment.disturbances:
        first, _ = disturbance.window
        if first >= experiment.duration:
            yield disturbance.label or disturbance.of


def never_acts(load: str, duration: float) -> str:
    """Return the note on a disturbance that begins when all runs have ended, at a duration [s]."""
    return f"{load} never acts: runs end at {duration:g} s, before it begins"


def _steps_by_default(experiment: Experiment) -> Iterator[str]:
    """Yield a line where neither a user's own model nor its file sets how MuJoCo steps."""
    run = experiment.file.run
    settings = experiment.settings
    if experiment.nominal.robot is None or run.timestep or run.integrator:
        return
    if (settings.timestep, settings.integrator) != _DEFAULT_STEPS:
        return
    yield (
        f"timestep {settings.timestep:g} s and integrator {settings.integrator} are MuJoCo's "
        'defaults: set [run] integrator = "RK4" or a shorter timestep, and compare'
    )


def _masses_at_origins(experiment: Experiment) -> Iterator[str]:
    """Yield a line for each added mass whose place the file does not give."""
    for table in experiment.file.edit:
        values = table.values
        if "added_mass" in values and "at" not in values:
            body = values["body"]
            yield (
                f"the added mass of {values['added_mass']} sits at the origin of {body}: at gives "
                "it another place in the frame of the body"
            )


def _unmeasured(experiment: Experiment) -> Iterator[str]:
    """Yield a line on each disturbance of a measurement that the loop does not make."""
    loop = experiment.loop
    if loop is None:
        return

    measured = {sensor.of for sensor in loop.sensors}
    estimated: set[str] = set()
    for part in loop.completed(experiment.nominal.system).estimators:
        estimated.update(part.of)
    for disturbance in experiment.disturbances:
        of = disturbance.of
        of_measurement = isinstance(disturbance, OutputDisturbance)
        if of_measurement and of in estimated and of not in measured:
            yield f"the disturbance of measured {of} does nothing: {of} is estimated, not measured"


def _exact_rates(experiment: Experiment) -> Iterator[str]:
    """Yield a line on the rates that the loop knows exactly beside measured positions."""
    loop = experiment.loop
    exact = loop.exact_rates(experiment.nominal.system) if loop is not None else []
    if exact:
        verb = "is" if len(exact) == 1 else "are"
        yield f"ideal: {', '.join(exact)} {verb} known exactly"


def _creeping_friction(plant: Plant) -> Iterator[str]:
    """Yield a line on the joints of a model whose own dry friction does not hold."""
    if not isinstance(plant, MujocoPlant):
        return
    creeping = creeping_joints(plant.model)
    if not creeping:
        return

    joint, distance = max(creeping.items(), key=lambda item: item[1])
    units = {
        name: position.unit
        for name, position in zip(plant.system.joints, plant.system.positions, strict=True)
    }
    # A joint that is no coordinate of the system has no unit there.
    unit = units.get(joint, "")
    yield (
        f"the model's own dry friction of {name_list(creeping)} does not hold: under half of it "
        f"{joint} creeps by {distance:.2g}{unit_after(unit)} in 10 s; set it by an [[edit]] with "
        "friction, which holds"
    )


def _neglected_poles(results: Sequence[RunResult]) -> Iterator[str]:
    """Yield a line for each law whose gains were computed without poles of the plant."""
    for result in results:
        design = result.controller.design
        if design is not None and design.neglected:
            poles = ", ".join(f"{pole:.3g}" for pole in map(_real_if_so, design.neglected))
            yield (
                f"gains of {result.controller.name} leave out the plant's pole at {poles} 1/s: "
                "much faster than what is asked for"
            )


def _real_if_so(pole: complex) -> complex | float:
    """Return a pole as a plain number if it is real."""
    return pole if pole.imag else pole.real


def _names_left_out(experiment: Experiment, results: Sequence[RunResult]) -> Iterator[str]:
    """Yield a line for the names that a Q by name leaves out."""
    laws: dict[str, list[str]] = {}
    for result in results:
        law = result.controller
        Q = _weight(experiment, law.name, "Q")
        if law.design is None or not isinstance(Q, dict) or not _follows(experiment, law.name):
            continue
        left_out = [name for name in law.design.error.names if name not in Q]
        if left_out:
            laws.setdefault(name_list(left_out), []).append(law.name)
    for names, of_laws in laws.items():
        yield f"Q of {name_list(of_laws)} leaves out {names}: weight 0"


def _follows(experiment: Experiment, law: str) -> bool:
    """Whether a law depends on its weights, which otherwise only weigh its runs."""
    return follows_weights(experiment.file.law(law), experiment.nominal)


def _weight(experiment: Experiment, law: str, key: str) -> Any:
    """Return Q or R of a law as the file has it."""
    numbers = experiment.file.law(law).numbers
    return numbers.get(key, getattr(experiment.file.task, key))


def _weights_by_order(experiment: Experiment, results: Sequence[RunResult]) -> Iterator[str]:
    """Yield the weights of a robot's laws by name where the file gives them in a list.

    Nobody but the model knows in which order its joints are.
    """
    if experiment.nominal.robot is None:
        return
    laws: dict[str, list[str]] = {}
    for result in results:
        law = result.controller
        if law.design is None or not _follows(experiment, law.name):
            continue
        weights = [_weight(experiment, law.name, key) for key in ("Q", "R")]
        if any(isinstance(weight, list) for weight in weights):
            laws.setdefault(weights_in_words(law.design), []).append(law.name)
    for words, names in laws.items():
        yield f"weights of {name_list(names)}, by the order of the list: {words}"
