"""Controllers designed from the laws and numbers of a case file."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal

import sympy as sp

from grosmc_mj.experiments.cases.cart_pendulum.cart import holding_ism, holding_lqr, holding_pfl
from grosmc_mj.experiments.file.formula import formula
from grosmc_mj.experiments.file.numbers import in_order, law_number, weight
from grosmc_mj.experiments.file.schema import CaseFile, ControllerTable, OutputsTable
from grosmc_mj.experiments.file.user_code import blamed, is_named, load_named
from grosmc_mj.experiments.file.values import state_of
from grosmc_mj.experiments.plants import NominalPlant, PlantName, design_variant
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import (
    ArgumentError,
    GrosmcError,
    PremiseError,
    name_list,
    one_line,
    placed,
    unknown_name,
    value_text,
)
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.theory.control.controller import Controller, custom_controller
from grosmc_mj.theory.control.coordinates.base import Coordinates
from grosmc_mj.theory.control.coordinates.feedback_linearization import feedback_linearization
from grosmc_mj.theory.control.coordinates.symbolic import ErrorCoordinates, error_names
from grosmc_mj.theory.control.design import (
    computed_torque_pd,
    linear_grosmc,
    linear_lqr,
    linearized_lqr,
    regulating_grosmc,
    state_grosmc,
    tracking_grosmc,
)
from grosmc_mj.theory.control.from_control import from_control, is_linear_system
from grosmc_mj.theory.control.references import TIME, ReferenceFunction, reference
from grosmc_mj.theory.control.rivals.adaptive import adaptive
from grosmc_mj.theory.control.rivals.integral import fl_pid, lqi
from grosmc_mj.theory.control.rivals.observer import adrc
from grosmc_mj.theory.control.rivals.pid import pid
from grosmc_mj.theory.control.task import NoNumbers, Task, state_task
from grosmc_mj.theory.plants import AnalyticPlant, OperatingPoint, System
from grosmc_mj.theory.plants.two_link_arm import tip

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
    "pid": pid,
    "lqi": lqi,
    "fl-pid": fl_pid,
    "adrc": adrc,
    "adaptive": adaptive,
    "linear-lqi": partial(lqi, linearizing=False),
    "linear-pid": partial(fl_pid, linearizing=False),
    "linear-adrc": partial(adrc, linearizing=False),
    "linear-adaptive": partial(adaptive, linearizing=False),
}
COMPUTED_TORQUE: Laws = {
    "lqr": partial(linearized_lqr, name="lqr"),
    "pd": computed_torque_pd,
    "grosmc": tracking_grosmc,
    "pid": pid,
    "lqi": lqi,
    "fl-pid": fl_pid,
    "adrc": adrc,
}
# Laws on the linearization about an operating point.
AT_REST: Laws = {"lqr": linear_lqr, "linear-grosmc": state_grosmc}
# All laws for a model in MuJoCo with fewer actuators than joints.
UNDERACTUATED: Laws = {"lqr": linear_lqr, "grosmc": state_grosmc, "pid": pid}
# Laws of one system, with weights of their own, from its nominal plant and its linear model.
FURTHER: Mapping[str, Mapping[str, Callable[[AnalyticPlant, Any], Controller]]] = {
    "cart_pendulum": {
        "cart-lqr": holding_lqr,
        "cart-ism": holding_ism,
        "cart-pfl": lambda plant, _: holding_pfl(plant),
    }
}
# Further outputs of a system.
OUTPUTS: Mapping[str, Mapping[str, Callable[[], Any]]] = {"two_link_arm": {"tip": tip}}

_WEIGHTS = ("Q", "R")
# Arguments of a law that the package sets itself.
_NO_NUMBERS = ("name", "linearizing")
# Numbers that may be lists: all others are one number.
_MAY_BE_LISTS = {"G", "uncertainty", "kp", "ki", "kd", "controls"}


@dataclass(frozen=True)
class LawRequest:
    """A controller to design.

    Attributes:
        table: Law and numbers of the controller.
        file: The case file, with the task.
        nominal: The nominal plant.
        plant: Name of the plant that the controller will run on.
        folder: Folder of the user's own Python.
        control_period: Control period of the runs [s].
        loop: Loop whose limits of the inputs the law knows.
    """

    table: ControllerTable
    file: CaseFile
    nominal: NominalPlant
    plant: PlantName
    folder: Path
    control_period: float
    loop: Loop

    @property
    def equations(self) -> AnalyticPlant:
        """Equations that the law is designed from."""
        return self.nominal.equations(self.plant)


def design(request: LawRequest) -> Controller:
    """Design a controller for the nominal plant, sampled as printed.

    Raises:
        GrosmcError: If there is no such law, a number does not fit, or the design fails.
    """
    named = is_named(request.table.law)
    controller = _users_controller(request) if named else _packaged_controller(request)
    return replace(controller, name=request.table.called)


def _packaged_controller(request: LawRequest) -> Controller:
    """Design a law of the package."""
    table = request.table
    nominal = request.nominal
    _refuse_memory(table)
    further = FURTHER.get(nominal.system.name, {}) if nominal.shipped else {}
    if table.law in further:
        return _further_controller(request, further[table.law])

    laws = laws_of(nominal)
    if table.law not in laws:
        valid = dict.fromkeys([*request.file.laws, *laws, *further, "module:name"])
        if nominal.robot is not None and table.law in GENERAL:
            raise ArgumentError(
                f"law {table.law!r} does not fit {nominal.system.name}, a model in MuJoCo without "
                f"equations in symbols: take {name_list(valid)}"
            )
        owners = [system for system, names in FURTHER.items() if table.law in names]
        if owners:
            raise ArgumentError(
                f"law {table.law!r} is there for {name_list(owners)} alone: take {name_list(valid)}"
            )
        raise ArgumentError(unknown_name("law", table.law, valid))
    maker = laws[table.law]
    of_states = nominal.at is not None and maker in (linear_lqr, state_grosmc)
    # A PID holds the operating point, where it knows the input, unless it shall follow outputs.
    follows = request.file.task.reference is not None or not request.file.task.outputs.own
    fully_actuated = nominal.robot is not None and not nominal.robot.underactuated
    if maker is pid and nominal.at is not None and not follows and not fully_actuated:
        of_states = True
    task = _state_task(request) if of_states else _task(request, maker)
    # Equations have no limits: those of the model that they stand for count.
    task = replace(task, limits=request.loop.command_limits(nominal.plant))
    return maker(task, **_arguments(table, maker, task.error, of_states=of_states))


def knows_limits(table: ControllerTable, nominal: NominalPlant) -> bool:
    """Whether a law of the package takes the limits of the loop's inputs for its own.

    Args:
        table: Law and numbers of the controller.
        nominal: The nominal plant.
    """
    maker = laws_of(nominal).get(table.law)
    return maker in (pid, state_grosmc) and "limit" not in table.numbers


def _linearizes(maker: Maker) -> bool:
    """Whether a law of outputs goes through feedback linearization, so that R weighs v."""
    if isinstance(maker, partial):
        return maker.keywords.get("linearizing", True)
    return maker not in (linear_lqr, linear_grosmc)


def _further_controller(request: LawRequest, maker: Callable[..., Controller]) -> Controller:
    """Design a law of one system, with weights of its own."""
    table = request.table
    nominal = request.nominal
    if table.numbers:
        raise ArgumentError(
            f"{table.law} has weights and numbers of its own, not {list(table.numbers)}"
        )
    linear_model = None
    if design_variant(request.plant) == "corrected" and nominal.plant.kind == "physics":
        linear_model = nominal.plant.linearization()
    return maker(request.equations, linear_model)


def _arguments(
    table: ControllerTable,
    maker: Maker,
    error: Coordinates,
    *,
    of_states: bool,
) -> dict[str, Any]:
    """Return the numbers of a table as arguments of a law of the package.

    Args:
        table: Law and numbers of the controller.
        maker: The function that designs the law.
        error: The error state of the law, with the inputs.
        of_states: Whether the law is designed on the linearization.
    """
    numbers = {name: value for name, value in table.numbers.items() if name not in _WEIGHTS}
    _, *parameters = inspect.signature(maker).parameters.values()
    parameters = [parameter for parameter in parameters if parameter.name not in _NO_NUMBERS]

    valid = [*ControllerTable.model_fields, *_WEIGHTS]
    valid += [parameter.name for parameter in parameters]
    for name in numbers:
        require_known("key", name, valid)
    required = [parameter.name for parameter in parameters if parameter.default is parameter.empty]
    missing = [name for name in required if name not in numbers]
    if missing:
        raise ArgumentError(f"{table.law} needs {' and '.join(missing)}")

    for name, value in numbers.items():
        if name not in _MAY_BE_LISTS and isinstance(value, list):
            raise ArgumentError(f"{name} = {value_text(value)} must be a number")
    input_units = [signal.unit for signal in error.system.inputs]
    return {
        name: law_number(name, value, error.names, input_units, of_states=of_states)
        for name, value in numbers.items()
    }


def laws_of(nominal: NominalPlant) -> Laws:
    """Return the package's laws for a plant, by name."""
    if nominal.robot is not None:
        return UNDERACTUATED if nominal.robot.underactuated else COMPUTED_TORQUE
    if nominal.at is not None:
        return {**GENERAL, **AT_REST}
    return GENERAL


def _users_controller(request: LawRequest) -> Controller:
    """Make a controller of a user's controller, linear system, law, or function that makes one."""
    table = request.table
    value = load_named(table.law, request.folder)
    # A function that numba has compiled stands for its source.
    value = getattr(value, "py_func", value)
    numbers = _users_numbers(table)

    linear = is_linear_system(value)
    if not isinstance(value, Controller) and not linear and _is_law(value, table.law):
        return _custom_law(request, value, numbers)
    _refuse_memory(table)
    if linear:
        return _linear_system(request, value, numbers)
    if not isinstance(value, Controller):
        return _made_by_function(request, value, numbers)
    if numbers:
        raise ArgumentError("a controller has its numbers already")
    return value


def _users_numbers(table: ControllerTable) -> dict[str, Any]:
    """Return the numbers of a user's own law; weights by name are for the optimum beside it."""
    numbers = {}
    for name, value in table.numbers.items():
        if name in _WEIGHTS and isinstance(value, dict):
            numbers[name] = value
        else:
            numbers[name] = law_number(name, value)
    return numbers


def _linear_system(request: LawRequest, system: Any, numbers: dict[str, Any]) -> Controller:
    """Make a controller of a linear system of python-control."""
    optimum = _optimum_for_users_law(request)
    further = [name for name in numbers if name not in _WEIGHTS]
    if further:
        raise ArgumentError(f"a linear system has its numbers already, not {further}")
    return from_control(system, request.control_period, optimum, request.table.called)


def _custom_law(request: LawRequest, law: Any, numbers: dict[str, Any]) -> Controller:
    """Make a controller of a law (t, x, memory, p, u)."""
    table = request.table
    optimum = _optimum_for_users_law(request)
    parameters = {name: value for name, value in numbers.items() if name not in _WEIGHTS}
    memory = {name: law_number(f"memory: {name}", value) for name, value in table.memory.items()}
    return custom_controller(table.called, law, optimum, parameters, memory)


def _optimum_for_users_law(request: LawRequest) -> Controller:
    """Design the linear optimum that a user's own law is compared with."""
    nominal = request.nominal
    at_rest = nominal.robot is not None or nominal.at is not None
    law = request.file.law("lqr" if at_rest else "fl-lqr").law
    numbers = request.table.numbers
    weights = {name: value for name, value in numbers.items() if name in _WEIGHTS}
    table = ControllerTable.model_validate({"law": law, **weights})
    return _packaged_controller(replace(request, table=table))


def _made_by_function(request: LawRequest, function: Any, numbers: dict[str, Any]) -> Controller:
    """Call a function that makes a controller."""
    nominal = request.nominal
    name = request.table.law
    by_name = [key for key in numbers if isinstance(numbers[key], dict)]
    if by_name:
        raise ArgumentError(
            f"{name} is a function of your own: give it {' and '.join(by_name)} as a list or rows"
        )
    arguments = []
    if _required_parameters(function):
        # A robot itself, the equations of any other plant.
        arguments.append(nominal.robot or request.equations)
    try:
        inspect.signature(function).bind(*arguments, **numbers)
    except TypeError as error:
        raise ArgumentError(
            f"{name} cannot be called with {list(numbers) or 'no numbers'}: {error}"
        ) from None
    try:
        with blamed(request.folder):
            controller = function(*arguments, **numbers)
    except GrosmcError:
        raise
    # A function of another library takes no plant, and says so in its own way.
    except Exception as error:
        raise ArgumentError(
            f"{name} makes no controller: {type(error).__name__}: {one_line(str(error))[:200]}"
        ) from error
    if not isinstance(controller, Controller):
        raise ArgumentError(
            f"{name} returned a {type(controller).__name__}, must return a Controller"
        )
    return controller


def _refuse_memory(table: ControllerTable) -> None:
    """Refuse memory for a controller that is no plain law."""
    if table.memory:
        raise ArgumentError(
            "memory is of a law (t, x, memory, p, u) of your own: all others have theirs"
        )


def _is_law(function: Any, text: str) -> bool:
    """Whether a function is a law, (t, x, memory, p, u), and not one that makes a controller."""
    if not callable(function):
        raise ArgumentError(
            f"{text} is a {type(function).__name__}, must be a law (t, x, memory, p, u), a "
            "function (nominal plant, numbers ...) -> Controller, a Controller, or a StateSpace "
            "or TransferFunction of python-control"
        )
    names = [parameter.name for parameter in _required_parameters(function)]
    begins_like_a_law = names[:2] == ["t", "x"]
    if len(names) in (4, 5) and not begins_like_a_law:
        raise ArgumentError(
            f"{text} has the arguments {', '.join(names)}: a law has t, x, memory, p and u"
        )
    return begins_like_a_law and not inspect.isclass(function)


def _required_parameters(function: Any) -> list[inspect.Parameter]:
    """Return the positional parameters of a function that have no default."""
    return [
        parameter
        for parameter in inspect.signature(function).parameters.values()
        if parameter.default is parameter.empty
        and parameter.kind is parameter.POSITIONAL_OR_KEYWORD
    ]


def _weight(name: str, request: LawRequest, names: Sequence[str]) -> Array:
    """Return Q or R of a law, its own or the task's, (n, n) of n names."""
    if name in request.table.numbers:
        return weight(name, request.table.numbers[name], names)
    value = getattr(request.file.task, name)
    if value is None:
        raise ArgumentError(f"task: {name} is missing: a plant of your own needs weights Q and R")
    return weight(f"task: {name}", value, names)


def _state_task(request: LawRequest) -> Task:
    """Return the task of a law on the linearization about the operating point."""
    task = request.file.task
    nominal = request.nominal
    if task.reference is not None or not task.outputs.own or task.sign != 1:
        raise ArgumentError(
            f"task: reference, outputs and sign: under {request.table.law} all states are held at "
            "the operating point: name that with [plant] at"
        )
    Q = _weight("Q", request, [state.name for state in nominal.system.states])
    R = _weight("R", request, [signal.name for signal in nominal.system.inputs])
    return state_task(nominal.believed or nominal.plant, Q, R, nominal.at)


def _task(request: LawRequest, maker: Maker) -> Task:
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
    R = _weight("R", request, error.input_names(linearizing=_linearizes(maker)))
    return Task(equations, error, parameters, Q, R)


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
    return robot.task(moving, parameters, Q, R)


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
