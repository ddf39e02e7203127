"""The laws that a case file names, with its numbers."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal, NoReturn

import sympy as sp

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.cases.cart_pendulum.cart import holding_ism, holding_lqr, holding_pfl
from grosmc_mj.control.controller import Controller, custom_controller
from grosmc_mj.control.coordinates.feedback_linearization import feedback_linearization
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.design import (
    computed_torque_pd,
    linear_grosmc,
    linear_lqr,
    linearized_lqr,
    regulating_grosmc,
    state_grosmc,
    tracking_grosmc,
)
from grosmc_mj.control.from_control import from_control, is_linear_system
from grosmc_mj.control.references import TIME, ReferenceFunction, reference
from grosmc_mj.control.rivals.adaptive import adaptive
from grosmc_mj.control.rivals.integral import lqi, pid
from grosmc_mj.control.rivals.observer import adrc
from grosmc_mj.control.task import NoNumbers, Task, state_task
from grosmc_mj.errors import ArgumentError, PremiseError, listed, shown, unknown_name
from grosmc_mj.experiments.case import state_of
from grosmc_mj.experiments.file.formula import formula
from grosmc_mj.experiments.file.numbers import law_number, weight
from grosmc_mj.experiments.file.schema import CaseFile, ControllerTable, OutputsTable
from grosmc_mj.experiments.file.user_code import blamed, is_named, load_named
from grosmc_mj.experiments.plants import NominalPlant, PlantName, design_variant
from grosmc_mj.plants import AnalyticPlant, OperatingPoint, System
from grosmc_mj.plants.two_link_arm import tip

Maker = Callable[..., Controller]
Laws = Mapping[str, Maker]

# Laws for any plant with equations, and for a robot, whose equations are MuJoCo's.
GENERAL: Laws = {
    "lqr": linear_lqr,
    "fl-lqr": linearized_lqr,
    "pd": computed_torque_pd,
    "grosmc": tracking_grosmc,
    "linear-grosmc": linear_grosmc,
    "regulating-grosmc": regulating_grosmc,
    "lqi": lqi,
    "pid": pid,
    "adrc": adrc,
    "adaptive": adaptive,
    "linear-lqi": partial(lqi, linearizing=False),
    "linear-pid": partial(pid, linearizing=False),
    "linear-adrc": partial(adrc, linearizing=False),
    "linear-adaptive": partial(adaptive, linearizing=False),
}
COMPUTED_TORQUE: Laws = {
    "lqr": partial(linearized_lqr, name="lqr"),
    "pd": computed_torque_pd,
    "grosmc": tracking_grosmc,
    "lqi": lqi,
    "pid": pid,
    "adrc": adrc,
}
# Laws on the linearization about an operating point, and those of a model in MuJoCo with fewer
# actuators than joints, which has no others.
AT_REST: Laws = {"lqr": linear_lqr, "linear-grosmc": state_grosmc}
UNDERACTUATED: Laws = {"lqr": linear_lqr, "grosmc": state_grosmc}
# Laws of one system, with weights of their own: from its nominal plant and its linear model.
FURTHER: Mapping[str, Mapping[str, Callable[[AnalyticPlant, Any], Controller]]] = {
    "cart_pendulum": {
        "cart-lqr": holding_lqr,
        "cart-ism": holding_ism,
        "cart-pfl": lambda plant, _: holding_pfl(plant),
    }
}
# Outputs of a system beside its own.
OUTPUTS: Mapping[str, Mapping[str, Callable[[], Any]]] = {"two_link_arm": {"tip": tip}}

_WEIGHTS = ("Q", "R")
# Arguments of a law that are no numbers of a file's: its name there says them.
_OURS = ("name", "linearizing")


def design(
    table: ControllerTable,
    file: CaseFile,
    nominal: NominalPlant,
    plant: PlantName,
    folder: Path,
    control_period: float,
) -> Controller:
    """The controller of a table, designed for the nominal plant and sampled as printed.

    Args:
        table: Its law and numbers.
        file: The case file, with the task.
        nominal: The plant that it believes in.
        plant: Which plant it shall run on.
        folder: Where the user's own Python is.
        control_period: Of its runs [s].

    Raises:
        GrosmcError: If there is no such law, a number does not fit, or the design fails.
    """
    if is_named(table.law):
        law = _users(table, file, nominal, plant, folder, control_period)
    else:
        law = _packaged(table, file, nominal, plant, folder)
    return replace(law, name=table.called)


def _packaged(
    table: ControllerTable, file: CaseFile, nominal: NominalPlant, plant: PlantName, folder: Path
) -> Controller:
    """A law of the package."""
    _refuse_memory(table)
    further = FURTHER.get(nominal.system.name, {}) if nominal.shipped else {}
    if table.law in further:
        if table.numbers:
            _refuse(f"{table.law} has weights and numbers of its own, not {list(table.numbers)}")
        # MuJoCo's linear model, if the law is designed from the corrected equations.
        corrected = design_variant(plant) == "corrected" and nominal.plant.kind == "physics"
        model = nominal.plant.linearization() if corrected else None
        return further[table.law](nominal.equations(plant), model)
    laws = laws_of(nominal)
    if table.law not in laws:
        valid = dict.fromkeys([*file.laws, *laws, *further, "module:name"])
        if nominal.robot is not None and table.law in GENERAL:
            raise ArgumentError(
                f"law {table.law!r} does not fit {nominal.system.name}, a model in MuJoCo without "
                f"equations in symbols: take {listed(valid)}"
            )
        raise ArgumentError(unknown_name("law", table.law, valid))
    maker, numbers = laws[table.law], {k: v for k, v in table.numbers.items() if k not in _WEIGHTS}
    of_states = nominal.at is not None and maker in (linear_lqr, state_grosmc)
    make_task = _state_task if of_states else _task
    task = make_task(table, file, nominal, plant, folder)
    parameters = list(inspect.signature(maker).parameters.values())[1:]
    needed = {
        item.name: item.default is item.empty for item in parameters if item.name not in _OURS
    }
    for name in numbers:
        require_known("key", name, [*ControllerTable.model_fields, *_WEIGHTS, *needed])
    if missing := [name for name, must in needed.items() if must and name not in numbers]:
        raise ArgumentError(f"{table.law} needs {' and '.join(missing)}")
    for name, value in numbers.items():
        if name not in {"G", "uncertainty"} and isinstance(value, list):
            _refuse(f"{name} = {shown(value)} must be a number")
    arguments: dict[str, Any] = {
        name: law_number(name, value, of_states=of_states) for name, value in numbers.items()
    }
    return maker(task, **arguments)


def laws_of(nominal: NominalPlant) -> Laws:
    """The package's laws for a plant, by name."""
    robot = nominal.robot
    if robot is not None:
        return UNDERACTUATED if robot.underactuated else COMPUTED_TORQUE
    return GENERAL if nominal.at is None else {**GENERAL, **AT_REST}


def _users(
    table: ControllerTable,
    file: CaseFile,
    nominal: NominalPlant,
    plant: PlantName,
    folder: Path,
    control_period: float,
) -> Controller:
    """A law of the user's own: a controller, a function that makes one, a linear system, a law."""
    # One that numba has compiled stands for its source.
    named = load_named(table.law, folder)
    named = getattr(named, "py_func", named)
    numbers = {name: law_number(name, value) for name, value in table.numbers.items()}
    linear = not isinstance(named, Controller) and is_linear_system(named)
    law = not linear and not isinstance(named, Controller) and _is_law(named, table.law)
    if not law:
        _refuse_memory(table)
    if isinstance(named, Controller):
        return named if not numbers else _refuse("a controller has its numbers already")
    if linear or law:
        at_rest = nominal.robot is not None or nominal.at is not None
        like = file.law("lqr" if at_rest else "fl-lqr").law
        weights = {k: v for k, v in table.numbers.items() if k in _WEIGHTS}
        followed = ControllerTable.model_validate({"law": like, **weights})
        like = _packaged(followed, file, nominal, plant, folder)
        own = {name: value for name, value in numbers.items() if name not in _WEIGHTS}
        if law:
            memory = {name: law_number(f"memory: {name}", v) for name, v in table.memory.items()}
            return custom_controller(table.called, named, like, own, memory)
        if own:
            _refuse(f"a linear system has its numbers already, not {list(own)}")
        return from_control(named, control_period, like, table.called)
    # The nominal plant for a function that wants it: a robot as such, others by equations.
    arguments = (nominal.robot or nominal.equations(plant),) if _needed(named) else ()
    try:
        inspect.signature(named).bind(*arguments, **numbers)
    except TypeError as error:
        _refuse(f"{table.law} cannot be called with {list(numbers) or 'no numbers'}: {error}")
    with blamed(folder):
        controller = named(*arguments, **numbers)
    if not isinstance(controller, Controller):
        _refuse(f"{table.law} returned a {type(controller).__name__}, must return a Controller")
    return controller


def _refuse_memory(table: ControllerTable) -> None:
    """Refuse memory for what is no plain law."""
    if table.memory:
        _refuse("memory is of a law (t, x, memory, p, u) of your own: all others have theirs")


def _refuse(message: str) -> NoReturn:
    raise ArgumentError(message)


def _is_law(function: Any, text: str) -> bool:
    """Whether a function is a law, (t, x, memory, p, u), and not one that makes a controller."""
    if not callable(function):
        _refuse(
            f"{text} is a {type(function).__name__}, must be a law (t, x, memory, p, u), a "
            "function (nominal plant, numbers ...) -> Controller, a Controller, or a StateSpace "
            "or TransferFunction of python-control"
        )
    names = [parameter.name for parameter in _needed(function)]
    if len(names) in (4, 5) and names[:2] != ["t", "x"]:
        _refuse(f"{text} has the arguments {', '.join(names)}: a law has t, x, memory, p and u")
    return names[:2] == ["t", "x"] and not inspect.isclass(function)


def _needed(function: Any) -> list[inspect.Parameter]:
    """What a function must be given."""
    return [
        parameter
        for parameter in inspect.signature(function).parameters.values()
        if parameter.default is parameter.empty
        and parameter.kind is parameter.POSITIONAL_OR_KEYWORD
    ]


def _weight(name: str, table: ControllerTable, file: CaseFile, size: int) -> Array:
    """Q or R of a law, its own or the task's, (size, size)."""
    if name in table.numbers:
        return weight(name, table.numbers[name], size)
    if (value := getattr(file.task, name)) is None:
        raise ArgumentError(f"task: {name} is missing: a plant of your own needs weights Q and R")
    return weight(f"task: {name}", value, size)


def _state_task(
    table: ControllerTable, file: CaseFile, nominal: NominalPlant, _plant: PlantName, _: Path
) -> Task:
    """What a law on the linearization about the operating point is designed for."""
    task, system = file.task, nominal.system
    led = task.reference is not None or not task.outputs.own or task.sign != 1
    if led:
        raise ArgumentError(
            f"task: reference, outputs and sign: under {table.law} all states are held at the "
            "operating point: name that with [plant] at"
        )
    believed = nominal.believed or nominal.plant
    n, m = len(system.states), len(system.inputs)
    Q, R = _weight("Q", table, file, n), _weight("R", table, file, m)
    return state_task(believed, Q, R, nominal.at)


def _task(
    table: ControllerTable, file: CaseFile, nominal: NominalPlant, plant: PlantName, folder: Path
) -> Task:
    """What a law is designed for."""
    task = file.task
    if (robot := nominal.robot) is not None:
        if not task.outputs.own or task.sign != 1:
            raise ArgumentError("task: outputs and sign: a robot's are its joint angles and 1")
        n = robot.joints
        held = None if nominal.at is None else [repr(angle) for angle in nominal.at.x[:n].tolist()]
        moving, parameters = _reference(task.reference or held, (2,) * n, robot, folder)
        Q, R = _weight("Q", table, file, 2 * n), _weight("R", table, file, n)
        return robot.task(moving, parameters, Q, R)
    equations = nominal.equations(plant)
    system, named = equations.system, task.outputs
    outputs = _outputs(named, nominal, folder)
    try:
        degrees = feedback_linearization(system.equations, outputs).relative_degree
    except PremiseError as error:
        raise PremiseError(f"{'task: outputs: ' if outputs else ''}{error}") from None
    held = None if nominal.at is None else _outputs_at(nominal.at, equations, outputs)
    moving, parameters = _reference(task.reference or held, degrees, equations, folder)
    guess = None
    if outputs or nominal.rest is not None:
        guess = state_of(named.guess, system, "task: outputs: guess", nominal.rest)
    error = _coordinates(system, moving, task.sign, outputs, guess, named.unit if outputs else "")
    Q, R = _weight("Q", table, file, error.size), _weight("R", table, file, error.inputs)
    return Task(equations, error, parameters, Q, R)


def _outputs_at(
    point: OperatingPoint, plant: AnalyticPlant, outputs: tuple[sp.Expr, ...] | None
) -> list[str]:
    """The outputs at an operating point, as formulas."""
    equations, numbers = plant.system.equations, vars(plant.parameters)
    values = [(symbol, numbers[str(symbol)]) for symbol in equations.parameters]
    values += zip(equations.x, point.x.tolist(), strict=True)
    return [repr(float(y.subs(values))) for y in outputs or equations.h]


@lru_cache(maxsize=64)
def _coordinates(
    system: System,
    moving: ReferenceFunction,
    sign: Literal[1, -1],
    outputs: tuple[sp.Expr, ...] | None,
    guess: tuple[float, ...] | None,
    unit: str,
) -> ErrorCoordinates:
    """Error coordinates, once for all laws on them: a law is compiled once for it."""
    return ErrorCoordinates(system, moving, sign, outputs=outputs, guess=guess, unit=unit)


def _outputs(
    table: OutputsTable, nominal: NominalPlant, folder: Path
) -> tuple[sp.Expr, ...] | None:
    """What is regulated, in symbols; None for the plant's own outputs."""
    if table.own:
        return None
    system, of = nominal.system, table.of
    if table.formulas is not None:
        if of != "plant":
            raise ArgumentError("task: outputs: of and formulas are the same: give one of them")
        symbols = [sp.Symbol(state.name) for state in system.states]
        places: Any = dict(zip(symbols, system.equations.x, strict=True))
        try:
            read = (formula(text, *symbols) for text in table.formulas)
            return tuple(y.subs(places, simultaneous=True) for y in read)
        except ArgumentError as error:
            raise ArgumentError(f"task: outputs: {error}") from None
    known = OUTPUTS.get(nominal.system.name, {})
    if not is_named(of) and of not in known:
        raise ArgumentError(f"task: outputs: {unknown_name('outputs', of, ['plant', *known])}")
    outputs = load_named(of, folder) if is_named(of) else known[of]
    with blamed(folder):
        outputs = outputs() if callable(outputs) else outputs
    if not isinstance(outputs, tuple) or not all(isinstance(output, sp.Expr) for output in outputs):
        _refuse(f"task: outputs: {of} must be, or return, a tuple of expressions in the states")
    return outputs


def _reference(
    formulas: list[str] | None, degrees: tuple[int, ...], nominal: Any, folder: Path
) -> tuple[ReferenceFunction, Any]:
    """A reference from formulas in t, or from Python; zero by default."""
    formulas = formulas or ["0"] * len(degrees)
    if len(formulas) == 1 and is_named(formulas[0]):
        pair = load_named(formulas[0], folder)
        if inspect.isfunction(pair):
            with blamed(folder):
                pair = pair(nominal)
        if not (isinstance(pair, tuple) and len(pair) >= 2 and callable(pair[0])):
            _refuse(
                f"task: reference: {formulas[0]} must be a pair (reference, its parameters), or a "
                "function of the nominal plant that returns it"
            )
        moving: Any = pair[0]
        return moving, pair[1]
    if len(formulas) != len(degrees):
        raise ArgumentError(
            f"task: reference: {len(formulas)} formulas, there are {len(degrees)} outputs"
        )
    try:
        return _written(tuple(formulas), degrees), NoNumbers()
    except ArgumentError as error:
        raise ArgumentError(f"task: reference: {error}") from None


@lru_cache(maxsize=64)
def _written(formulas: tuple[str, ...], degrees: tuple[int, ...]) -> ReferenceFunction:
    """The reference of these formulas in t."""
    return reference([formula(text, TIME) for text in formulas], degrees)
