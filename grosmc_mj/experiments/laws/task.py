"""The task of a law, from the tables of a case file: outputs, reference and weights."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import sympy as sp

from grosmc_mj.experiments.file.formula import formula
from grosmc_mj.experiments.file.numbers import in_order, weight
from grosmc_mj.experiments.file.schema import OutputsTable
from grosmc_mj.experiments.file.user_code import blamed, is_named, load_named
from grosmc_mj.experiments.file.values import state_of
from grosmc_mj.experiments.laws.request import LawRequest
from grosmc_mj.experiments.plants import NominalPlant
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, PremiseError, name_list, placed, unknown_name
from grosmc_mj.theory.control.coordinates.feedback_linearization import feedback_linearization
from grosmc_mj.theory.control.coordinates.symbolic import ErrorCoordinates, error_names
from grosmc_mj.theory.control.kinds.kind import WEIGHTS
from grosmc_mj.theory.control.references import TIME, ReferenceFunction, reference
from grosmc_mj.theory.control.task import NoNumbers, Task, state_task
from grosmc_mj.theory.plants import AnalyticPlant, OperatingPoint, System
from grosmc_mj.theory.plants.two_link_arm import tip

if TYPE_CHECKING:
    from grosmc_mj.mechanics.robots.robot import Robot

# Further outputs of a system.
OUTPUTS: Mapping[str, Mapping[str, Callable[[], Any]]] = {"two_link_arm": {"tip": tip}}


def _is_weighed(request: LawRequest) -> bool:
    """Return whether a law has weights, which it may do without if it does not depend on them."""
    given = [name in request.table.numbers for name in WEIGHTS]
    given += [getattr(request.file.task, name) is not None for name in WEIGHTS]
    return request.needs_weights or any(given)


def _weight(name: str, request: LawRequest, names: Sequence[str]) -> Array:
    """Return Q or R of a law, its own or the task's, (n, n) of n names; units without any."""
    if not _is_weighed(request):
        return np.eye(len(names))
    if name in request.table.numbers:
        return weight(name, request.table.numbers[name], names)
    value = getattr(request.file.task, name)
    if value is None:
        needing = request.table.law if request.needs_weights else "the index"
        raise ArgumentError(
            f"task: {name} is missing: {needing} needs weights Q and R; {name} weighs "
            f"{name_list(names)}"
        )
    return weight(f"task: {name}", value, names)


def task_of_states(request: LawRequest) -> Task:
    """Return the task of a law on the linearization about the operating point."""
    task = request.file.task
    nominal = request.nominal
    if task.reference is not None or not task.outputs.own or task.sign != 1:
        held = f"under {request.table.law} all states are held at the operating point"
        if nominal.robot is not None and nominal.robot.undriven:
            held = f"{nominal.robot.undriven}, so {held}"
        raise ArgumentError(f"task: reference, outputs and sign: {held}: name that with [plant] at")
    Q = _weight("Q", request, [state.name for state in nominal.system.states])
    R = _weight("R", request, [signal.name for signal in nominal.system.inputs])
    states = state_task(nominal.believed or nominal.plant, Q, R, nominal.at)
    return replace(states, weighed=_is_weighed(request))


def task_of_outputs(request: LawRequest, *, linearizing: bool) -> Task:
    """Return the task of a law that follows outputs."""
    if request.nominal.robot is not None:
        return _robot_task(request, request.nominal.robot)

    task = request.file.task
    nominal = request.nominal
    equations = request.equations
    outputs = _outputs(task.outputs, nominal, request.folder)
    try:
        chains = feedback_linearization(equations.system.symbolic_equations, outputs)
    except PremiseError as error:
        raise PremiseError(f"{'task: outputs: ' if outputs else ''}{error}") from None

    names = error_names(chains, equations.system)
    formulas = _formulas(task.reference, [names[row] for row in chains.first_rows])
    if not formulas and nominal.at is not None:
        formulas = _outputs_at(nominal.at, equations, outputs)
    degrees = chains.relative_degree
    moving, parameters = _reference(formulas, degrees, equations, request.folder)

    guess = None
    if outputs or nominal.rest is not None:
        guess = state_of(task.outputs.guess, equations.system, "task: outputs: guess", nominal.rest)
    unit = task.outputs.unit if outputs else ""
    error = _coordinates(equations.system, moving, task.sign, outputs, guess, unit)
    Q = _weight("Q", request, error.names)
    R = _weight("R", request, error.input_names(linearizing=linearizing))
    return Task(equations, error, parameters, Q, R, weighed=_is_weighed(request))


def _robot_task(request: LawRequest, robot: Robot) -> Task:
    """Return the task of a law that follows a robot's joint angles."""
    task = request.file.task
    if not task.outputs.own or task.sign != 1:
        raise ArgumentError("task: outputs and sign: a robot's are its joint angles and 1")
    n = robot.joints
    formulas = _formulas(task.reference, robot.plant.system.joints)
    if not formulas and request.nominal.at is not None:
        formulas = [repr(angle) for angle in request.nominal.at.x[:n].tolist()]
    moving, parameters = _reference(formulas, (2,) * n, robot, request.folder)
    error = robot.coordinates(moving)
    Q = _weight("Q", request, error.names)
    R = _weight("R", request, error.input_names(linearizing=True))
    joints = robot.task(moving, parameters, Q, R)
    return replace(joints, weighed=_is_weighed(request))


def _formulas(
    reference: list[str] | dict[str, str] | None, names: Sequence[str]
) -> list[str] | None:
    """Return the formulas of a reference in the order of the outputs."""
    if isinstance(reference, dict):
        return in_order("task: reference", reference, names)
    return reference


def _outputs_at(
    point: OperatingPoint, plant: AnalyticPlant, outputs: tuple[sp.Expr, ...] | None
) -> list[str]:
    """Return the outputs at an operating point, as formulas."""
    equations = plant.system.symbolic_equations
    parameters = vars(plant.parameters)
    values = [(symbol, parameters[str(symbol)]) for symbol in equations.parameters]
    values += zip(equations.x, point.x.tolist(), strict=True)
    return [repr(float(y.subs(values))) for y in outputs or equations.h]


# A law is compiled for its coordinates: all laws on them share one object.
@lru_cache(maxsize=64)
def _coordinates(
    system: System,
    moving: ReferenceFunction,
    sign: Literal[1, -1],
    outputs: tuple[sp.Expr, ...] | None,
    guess: tuple[float, ...] | None,
    unit: str,
) -> ErrorCoordinates:
    """Return error coordinates."""
    return ErrorCoordinates(system, moving, sign, outputs=outputs, guess=guess, unit=unit)


def _outputs(
    table: OutputsTable, nominal: NominalPlant, folder: Path
) -> tuple[sp.Expr, ...] | None:
    """Return the regulated outputs in symbols; None for the plant's own outputs."""
    if table.own:
        return None
    if table.formulas is not None:
        if table.of != "plant":
            raise ArgumentError("task: outputs: of and formulas are the same: give one of them")
        return _outputs_by_formulas(table.formulas, nominal.system)

    name = table.of
    packaged = OUTPUTS.get(nominal.system.name, {})
    if is_named(name):
        outputs = load_named(name, folder)
    elif name in packaged:
        outputs = packaged[name]
    else:
        raise ArgumentError(f"task: outputs: {unknown_name('outputs', name, ['plant', *packaged])}")
    with blamed(folder):
        outputs = outputs() if callable(outputs) else outputs
    if not isinstance(outputs, tuple) or not all(isinstance(output, sp.Expr) for output in outputs):
        raise ArgumentError(
            f"task: outputs: {name} must be, or return, a tuple of expressions in the states"
        )
    return outputs


def _outputs_by_formulas(formulas: list[str], system: System) -> tuple[sp.Expr, ...]:
    """Return outputs from formulas in the names of the states."""
    symbols = [sp.Symbol(state.name) for state in system.states]
    states: Any = dict(zip(symbols, system.symbolic_equations.x, strict=True))
    with placed("task: outputs: "):
        outputs = [formula(text, *symbols) for text in formulas]
    return tuple(output.subs(states, simultaneous=True) for output in outputs)


def _reference(
    formulas: list[str] | None,
    degrees: tuple[int, ...],
    nominal: Any,
    folder: Path,
) -> tuple[ReferenceFunction, Any]:
    """Return a reference and its parameters, from formulas in t or from Python; zero by default."""
    formulas = formulas or ["0"] * len(degrees)
    if len(formulas) == 1 and is_named(formulas[0]):
        return _users_reference(formulas[0], nominal, folder)
    if len(formulas) != len(degrees):
        raise ArgumentError(
            f"task: reference: {len(formulas)} formulas, there are {len(degrees)} outputs"
        )
    with placed("task: reference: "):
        return _reference_by_formulas(tuple(formulas), degrees), NoNumbers()


def _users_reference(name: str, nominal: Any, folder: Path) -> tuple[ReferenceFunction, Any]:
    """Return a user's own reference with its parameters."""
    pair = load_named(name, folder)
    if inspect.isfunction(pair):
        with blamed(folder):
            pair = pair(nominal)
    if not (isinstance(pair, tuple) and len(pair) >= 2 and callable(pair[0])):
        raise ArgumentError(
            f"task: reference: {name} must be a pair (reference, its parameters), or a "
            "function of the nominal plant that returns it"
        )
    moving: Any = pair[0]
    return moving, pair[1]


# A law is compiled for its reference: all laws on it share one function.
@lru_cache(maxsize=64)
def _reference_by_formulas(
    formulas: tuple[str, ...], degrees: tuple[int, ...]
) -> ReferenceFunction:
    """Return the reference of formulas in t."""
    return reference([formula(text, TIME, steps=True) for text in formulas], degrees)
