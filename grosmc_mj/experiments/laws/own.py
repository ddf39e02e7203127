"""A law of the user's own: a law, a controller, a linear system, or a function that makes one."""

from __future__ import annotations

import inspect
from dataclasses import replace
from typing import Any

from grosmc_mj.experiments.file.numbers import UNITS, law_number
from grosmc_mj.experiments.file.schema import ControllerTable
from grosmc_mj.experiments.file.user_code import blamed, load_named
from grosmc_mj.experiments.laws.law_source import refuse_other_arguments, refuse_unwritten_inputs
from grosmc_mj.experiments.laws.packaged import packaged_controller, refuse_memory
from grosmc_mj.experiments.laws.request import LawRequest
from grosmc_mj.ground.errors import ArgumentError, GrosmcError, one_line
from grosmc_mj.theory.control.controller import Controller, custom_controller
from grosmc_mj.theory.control.from_control import from_control, is_linear_system
from grosmc_mj.theory.control.kinds.kind import WEIGHTS


def own_controller(request: LawRequest) -> Controller:
    """Make a controller of a user's controller, linear system, law, or function that makes one."""
    table = request.table
    value = load_named(table.law, request.folder)
    # A function that numba has compiled stands for its source.
    value = getattr(value, "py_func", value)
    numbers = _users_numbers(table)

    linear = is_linear_system(value)
    if not isinstance(value, Controller) and not linear and _is_law(value, table.law):
        return _custom_law(request, value, numbers)
    refuse_memory(table)
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
        if name in WEIGHTS and isinstance(value, dict):
            numbers[name] = value
        else:
            numbers[name] = law_number(name, value, unit=UNITS.get(name, ""))
    return numbers


def _linear_system(request: LawRequest, system: Any, numbers: dict[str, Any]) -> Controller:
    """Make a controller of a linear system of python-control."""
    optimum = _optimum_for_users_law(request)
    further = [name for name in numbers if name not in WEIGHTS]
    if further:
        raise ArgumentError(f"a linear system has its numbers already, not {further}")
    return from_control(system, request.control_period, optimum, request.table.called)


def _custom_law(request: LawRequest, law: Any, numbers: dict[str, Any]) -> Controller:
    """Make a controller of a law (t, x, memory, p, u)."""
    table = request.table
    refuse_other_arguments(law)
    refuse_unwritten_inputs(law, [signal.name for signal in request.nominal.system.inputs])
    optimum = _optimum_for_users_law(request)
    parameters = {name: value for name, value in numbers.items() if name not in WEIGHTS}
    memory = {name: law_number(f"memory: {name}", value) for name, value in table.memory.items()}
    return custom_controller(table.called, law, optimum, parameters, memory)


def _optimum_for_users_law(request: LawRequest) -> Controller:
    """Design the linear optimum that a user's own law is compared with."""
    nominal = request.nominal
    at_rest = nominal.robot is not None or nominal.at is not None
    law = request.file.law("lqr" if at_rest else "fl-lqr").law
    numbers = request.table.numbers
    weights = {name: value for name, value in numbers.items() if name in WEIGHTS}
    table = ControllerTable.model_validate({"law": law, **weights})
    return packaged_controller(replace(request, table=table, needs_weights=False))


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
        given = ["the nominal plant" for _ in arguments] + list(numbers)
        raise ArgumentError(
            f"{name}{inspect.signature(function)} cannot be called with "
            f"{' and '.join(given) or 'no numbers'}: {error}; a function that makes a controller "
            "takes the nominal plant, then numbers by the names of its arguments"
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
