"""The laws that a case file names, with its numbers."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller, custom_controller
from grosmc_mj.control.coordinates.feedback_linearization import feedback_linearization
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.design import (
    computed_torque_pd,
    linear_lqr,
    linearized_lqr,
    realized,
    tracking_grosmc,
)
from grosmc_mj.control.gains import Uncertainty
from grosmc_mj.control.references import TIME, ReferenceFunction, reference
from grosmc_mj.control.switching import find_switching
from grosmc_mj.control.task import Realization, Task
from grosmc_mj.errors import ArgumentError, GrosmcError, shown, unknown_name
from grosmc_mj.experiments.designs import DESIGNS, switching_for
from grosmc_mj.experiments.file.formula import formula
from grosmc_mj.experiments.file.schema import CaseFile, ControllerTable, TaskTable
from grosmc_mj.experiments.file.user_code import blamed, is_named, load_named
from grosmc_mj.experiments.plants import Subject
from grosmc_mj.experiments.runs import PlantName
from grosmc_mj.simulation.linearization import linearize
from grosmc_mj.simulation.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.prepare import ANALYTIC_TIMESTEP

Laws = Mapping[str, Callable[..., Controller]]

# Laws for any plant of one's own, and for a robot, whose equations are MuJoCo's.
GENERAL: Laws = {
    "lqr": linear_lqr,
    "fl-lqr": linearized_lqr,
    "pd": computed_torque_pd,
    "grosmc": tracking_grosmc,
}
COMPUTED_TORQUE: Laws = {
    "lqr": partial(linearized_lqr, name="lqr"),
    "pd": computed_torque_pd,
    "grosmc": tracking_grosmc,
}


_WEIGHTS = ("Q", "R")


@dataclass(frozen=True)
class Formulas:
    """Parameters of a reference that is written out: there are none."""


def controller_of(
    table: ControllerTable, file: CaseFile, subject: Subject, plant: PlantName, folder: Path
) -> Controller:
    """The controller of a table, designed for the nominal plant.

    Args:
        table: Its law and numbers.
        file: The case file, with the task.
        subject: The plant.
        plant: Which plant it shall run on.
        folder: Where the user's own Python is.

    Raises:
        GrosmcError: If there is no such law, a number does not fit, or the design fails.
    """
    try:
        if is_named(table.law):
            made = _users(table, file, subject, plant, folder)
        else:
            made = _ours(table, file, subject, plant, folder)
        made = realized(made, _realization(table, made, file, subject))
    except GrosmcError as error:
        raise ArgumentError(f"controller {_name(table)}: {error}") from error
    return replace(made, name=_name(table))


def _name(table: ControllerTable) -> str:
    """What a controller is called."""
    return table.name or table.law.split(":")[-1]


def control_period_of(file: CaseFile, subject: Subject) -> float:
    """Time between two samples of a file's laws [s]."""
    return file.run.control_period or max(ANALYTIC_TIMESTEP, subject.timestep)


def _realization(
    table: ControllerTable, made: Controller, file: CaseFile, subject: Subject
) -> Realization:
    """How a law is sampled."""
    given = {"switching", "surface"} & table.model_fields_set
    if made.design is None or made.design.with_reach is None:
        if given:
            raise ArgumentError(f"it does not switch, so it has no {', '.join(sorted(given))}")
        return Realization()
    design = file.task.design or made.design.error.system.name
    law = (
        switching_for(table.switching, design)
        if design in DESIGNS
        else find_switching(table.switching)
    )
    return Realization(
        law, control_period_of(file, subject) if table.surface == "discrete" else None
    )


def _ours(
    table: ControllerTable, file: CaseFile, subject: Subject, plant: PlantName, folder: Path
) -> Controller:
    """A law of the package."""
    task, build = _task(table, file.task, subject, plant, folder)
    if table.law not in build:
        raise ArgumentError(unknown_name("law", table.law, [*build, "module:name"]))
    maker, numbers = build[table.law], {k: v for k, v in table.numbers.items() if k not in _WEIGHTS}
    valid = _numbers_of(maker)
    for name in numbers:
        if name not in valid:
            keys = [*ControllerTable.model_fields, "Q", "R", *valid]
            raise ArgumentError(unknown_name("key", name, keys))
    if missing := [name for name, needed in valid.items() if needed and name not in numbers]:
        raise ArgumentError(f"{table.law} needs {' and '.join(missing)}")
    for name, value in numbers.items():
        if name not in {"G", "uncertainty"} and np.ndim(value):
            _refuse(f"{name} = {shown(value)} must be a number")
    return maker(task, **{name: _number(name, value) for name, value in numbers.items()})


def _users(
    table: ControllerTable, file: CaseFile, subject: Subject, plant: PlantName, folder: Path
) -> Controller:
    """A law of the user's own: a controller, a function that makes one, or a law."""
    # One that numba has compiled stands for its source.
    found = load_named(table.law, folder)
    found = getattr(found, "py_func", found)
    numbers = {name: _number(name, value) for name, value in table.numbers.items()}
    if isinstance(found, Controller):
        return found if not numbers else _refuse("a controller has its numbers already")
    if _is_law(found, table.law):
        task, build = _task(table, file.task, subject, plant, folder)
        like = build["fl-lqr" if "fl-lqr" in build else "lqr"](task)
        own = {name: value for name, value in numbers.items() if name not in _WEIGHTS}
        return custom_controller(_name(table), found, like, own)
    given = _wanted(found, subject, plant)
    try:
        inspect.signature(found).bind(*given, **numbers)
    except TypeError as error:
        _refuse(f"{table.law} cannot be called with {list(numbers) or 'no numbers'}: {error}")
    with blamed(folder):
        made = found(*given, **numbers)
    if not isinstance(made, Controller):
        _refuse(f"{table.law} returned a {type(made).__name__}, must return a Controller")
    return made


def _refuse(said: str) -> NoReturn:
    raise ArgumentError(said)


def _is_law(found: Any, text: str) -> bool:
    """Whether a function is a law (t, x, memory, p) -> u, and not one that makes a controller."""
    if not callable(found):
        _refuse(
            f"{text} is a {type(found).__name__}, must be a law (t, x, memory, p) -> u, a function "
            "(nominal plant, numbers ...) -> Controller, or a Controller"
        )
    names = [each.name for each in _needed(found)]
    if len(names) == 4 and names[:2] != ["t", "x"]:
        _refuse(f"{text} has the arguments {', '.join(names)}: a law has t, x, memory and p")
    return names[:2] == ["t", "x"] and not inspect.isclass(found)


def _needed(found: Any) -> list[inspect.Parameter]:
    """What a function must be given."""
    return [
        each
        for each in inspect.signature(found).parameters.values()
        if each.default is each.empty and each.kind is each.POSITIONAL_OR_KEYWORD
    ]


def _wanted(found: Any, subject: Subject, plant: PlantName) -> tuple[Any, ...]:
    """The nominal plant for a function that wants it: a robot as such, others by equations."""
    if not _needed(found):
        return ()
    return (subject.robot or subject.believed(plant),)


def _numbers_of(maker: Callable[..., Controller]) -> dict[str, bool]:
    """The numbers that a law may be given, and whether it needs them."""
    found = list(inspect.signature(maker).parameters.values())[1:]
    ours = {"name", "maker", "physics"}
    return {each.name: each.default is each.empty for each in found if each.name not in ours}


def _number(name: str, value: Any) -> Any:
    """A number, a matrix or an uncertainty of a file."""
    if name == "uncertainty":
        return _uncertainty(value)
    entries = np.ravel(np.asarray(value, object)).tolist()
    if any(isinstance(each, bool) or not isinstance(each, (int, float)) for each in entries):
        raise ArgumentError(f"{name} = {shown(value)} must be a number or the rows of a matrix")
    if not all(map(math.isfinite, entries)):
        raise ArgumentError(f"{name} = {shown(value)} must be finite")
    return float(value) if np.ndim(value) == 0 else np.array(value, float)


def _uncertainty(value: Any) -> Uncertainty:
    """A declared uncertainty."""
    keys = [each.name for each in fields(Uncertainty)]
    if not isinstance(value, dict):
        raise ArgumentError(f"uncertainty = {shown(value)} must be a table with {', '.join(keys)}")
    for key in value:
        if key not in keys:
            raise ArgumentError(f"uncertainty: {unknown_name('key', key, keys)}")
    if missing := [key for key in keys if key not in value]:
        raise ArgumentError(f"uncertainty: {', '.join(missing)} is missing")
    kinds = {"scales": dict, "wrench": list, "region": list, "reaching_rate": (int, float)}
    for key, kind in kinds.items():
        if not isinstance(value[key], kind):
            what = {dict: "a table", list: "a list of numbers"}.get(kind, "a number")
            raise ArgumentError(f"uncertainty: {key} = {shown(value[key])} must be {what}")
    for name, pair in value["scales"].items():
        if not (isinstance(pair, list) and len(pair) == 2):
            raise ArgumentError(f"uncertainty: {name} = {shown(pair)} must be [least, largest]")
    try:
        return Uncertainty(
            {name: (float(low), float(high)) for name, (low, high) in value["scales"].items()},
            tuple(map(float, value["wrench"])),
            tuple(map(float, value["region"])),
            float(value["reaching_rate"]),
        )
    except (TypeError, ValueError, AttributeError) as error:
        raise ArgumentError(f"uncertainty: {error}") from None


def _task(
    table: ControllerTable, wanted: TaskTable, subject: Subject, plant: PlantName, folder: Path
) -> tuple[Task, Laws]:
    """What a law is designed for, and the laws that there are."""
    Q, R = table.numbers.get("Q", wanted.Q), table.numbers.get("R", wanted.R)
    if subject.shipped:
        return _shipped_task(wanted, subject, plant, Q, R, folder)
    if wanted.design is not None:
        raise ArgumentError("task: design: only the package's systems have designs")
    if Q is None or R is None:
        raise ArgumentError("task: Q and R are missing: a plant of your own needs weights")
    if subject.robot is not None:
        n = subject.robot.joints
        moving, parameters = _reference(wanted.reference, (2,) * n, subject.robot, folder)
        weights = _weight("Q", Q, 2 * n), _weight("R", R, n)
        return subject.robot.task(moving, parameters, *weights), COMPUTED_TORQUE
    nominal = subject.believed(plant)
    degrees = feedback_linearization(nominal.system.equations).relative_degree
    moving, parameters = _reference(wanted.reference, degrees, nominal, folder)
    error = ErrorCoordinates(nominal.system, moving)
    weights = _weight("Q", Q, error.size), _weight("R", R, error.inputs)
    return Task(nominal, error, parameters, *weights), GENERAL


def _shipped_task(
    wanted: TaskTable, subject: Subject, plant: PlantName, Q: Any, R: Any, folder: Path
) -> tuple[Task, Laws]:
    """The task of a system of the package, with what the file changes of it."""
    nominal, design = subject.believed(plant), wanted.design or subject.system.name
    valid = [name for name in DESIGNS if name.split()[0] == subject.system.name]
    if design not in valid:
        raise ArgumentError(f"task: {unknown_name('design', design, valid)}")
    designs = DESIGNS[design]
    task = designs.task(nominal)
    if wanted.reference is not None:
        degrees = task.error.linearization.relative_degree
        moving, parameters = _reference(wanted.reference, degrees, nominal, folder)
        task = replace(task, error=replace(task.error, reference=moving), reference=parameters)
    task = replace(
        task,
        Q=task.Q if Q is None else _weight("Q", Q, task.error.size),
        R=task.R if R is None else _weight("R", R, task.error.inputs),
    )
    aliases = {alias: designs.build[same] for alias, (same, _) in designs.aliases.items()}
    # As the package designs them: from MuJoCo's own linear model, with weights of their own.
    assert isinstance(subject.nominal, MujocoPlant)
    further = {
        name: partial(_of_plant, maker=maker, physics=subject.nominal)
        for name, maker in designs.further.items()
        if Q is None and R is None and wanted.reference is None
    }
    return task, {**designs.build, **aliases, **further}


def _of_plant(task: Task, maker: Callable[..., Controller], physics: MujocoPlant) -> Controller:
    """A further law of a system, which is designed from the plant and MuJoCo's linear model."""
    corrected = task.plant.variant == "corrected"
    return maker(task.plant, linearize(physics) if corrected else None)


def _weight(name: str, value: Any, size: int) -> Array:
    """A weight as a matrix."""
    try:
        found = np.asarray(value, float)
    except (ValueError, TypeError):
        found = np.zeros((0, 0))
    found = found * np.eye(size) if found.ndim == 0 else found
    found = np.diag(found) if found.ndim == 1 else found
    if found.shape != (size, size):
        raise ArgumentError(
            f"{name} = {value} must be a number, {size} numbers or a {size} x {size} matrix"
        )
    return found


def _reference(
    formulas: list[str] | None, degrees: tuple[int, ...], nominal: Any, folder: Path
) -> tuple[ReferenceFunction, Any]:
    """A reference from formulas in t, or from Python; zero by default."""
    formulas = formulas or ["0"] * len(degrees)
    if len(formulas) == 1 and is_named(formulas[0]):
        found = load_named(formulas[0], folder)
        if inspect.isfunction(found):
            with blamed(folder):
                found = found(nominal)
        if not (isinstance(found, tuple) and len(found) >= 2 and callable(found[0])):
            _refuse(
                f"task: reference: {formulas[0]} must be a pair (reference, its parameters), or a "
                "function of the nominal plant that returns it"
            )
        moving: Any = found[0]
        return moving, found[1]
    if len(formulas) != len(degrees):
        raise ArgumentError(
            f"task: reference: {len(formulas)} formulas, there are {len(degrees)} outputs"
        )
    try:
        outputs = [formula(each, TIME) for each in formulas]
    except ArgumentError as error:
        raise ArgumentError(f"task: reference: {error}") from None
    return reference(outputs, degrees), Formulas()
