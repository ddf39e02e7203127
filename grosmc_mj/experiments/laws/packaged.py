"""A law of the package: the kind of its key that fits the plant, with the numbers of its table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from grosmc_mj.experiments.file.numbers import law_number
from grosmc_mj.experiments.file.schema import ControllerTable
from grosmc_mj.experiments.laws.request import LawRequest
from grosmc_mj.experiments.laws.task import task_of_outputs, task_of_states
from grosmc_mj.experiments.plants import NominalPlant, design_variant
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError, name_list, unknown_name, value_text
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.kinds import KINDS
from grosmc_mj.theory.control.kinds.kind import WEIGHTS, LawKind, Where
from grosmc_mj.theory.control.law_number import LawNumber
from grosmc_mj.theory.control.switching import SWITCHINGS
from grosmc_mj.theory.control.task import Task, state_task
from grosmc_mj.theory.plants import Signal

Kinds = Mapping[str, type[LawKind]]


def packaged_controller(request: LawRequest) -> Controller:
    """Design a law of the package.

    Raises:
        GrosmcError: If there is no such law, a number does not fit, or the design fails.
    """
    table = request.table
    refuse_memory(table)
    kind = _kind_or_refusal(request)
    if kind.own_weights is not None:
        _numbers_in(kind, table)
        return kind().design(_task_of_own_weights(request, kind))

    needs_weights = request.needs_weights and kind.follows_weights
    request = replace(request, needs_weights=needs_weights)
    task_table = request.file.task
    follows = task_table.reference is not None or not task_table.outputs.own
    of_states = kind.holds_states(where_of(request.nominal), follows=follows)
    if of_states:
        task = task_of_states(request)
    else:
        task = task_of_outputs(request, linearizing=kind.linearizing)
    # Equations have no limits: those of the model that they stand for count.
    task = replace(task, limits=request.loop.command_limits(request.nominal.plant))
    return kind(**_arguments(kind, table, task, of_states=of_states)).design(task)


def refuse_memory(table: ControllerTable) -> None:
    """Refuse memory for a controller that is no plain law."""
    if table.memory:
        raise ArgumentError(
            "memory is of a law (t, x, memory, p, u) of your own: all others have theirs"
        )


# -- which kind ------------------------------------------------------------------------------------


def where_of(nominal: NominalPlant) -> Where:
    """Return the kind of nominal plant that laws are designed from."""
    if nominal.robot is not None:
        return Where.UNDERACTUATED if nominal.robot.underactuated else Where.COMPUTED_TORQUE
    return Where.EQUATIONS if nominal.at is None else Where.AT_REST


def kinds_of(nominal: NominalPlant) -> Kinds:
    """Return the kinds of laws for a plant, by their keys."""
    where = where_of(nominal)
    kinds = {}
    for kind in KINDS:
        is_its_system = nominal.shipped and kind.system == nominal.system.name
        if where in kind.where and (not kind.system or is_its_system):
            kinds[kind.key] = kind
    return kinds


def knows_limits(table: ControllerTable, nominal: NominalPlant) -> bool:
    """Whether a law of the package takes the limits of the loop's inputs for its own.

    Args:
        table: Law and numbers of the controller.
        nominal: The nominal plant.
    """
    kind = kinds_of(nominal).get(table.law)
    return kind is not None and kind.takes_limits and "limit" not in table.numbers


def follows_weights(table: ControllerTable, nominal: NominalPlant) -> bool:
    """Whether a law depends on Q and R; of a user's own one, whether its table gives one of them.

    Args:
        table: Law and numbers of the controller.
        nominal: The nominal plant.
    """
    kind = kinds_of(nominal).get(table.law)
    if kind is None:
        return any(name in table.numbers for name in WEIGHTS)
    return kind.follows_weights


def _kind_or_refusal(request: LawRequest) -> type[LawKind]:
    """Return the kind of a law.

    Raises:
        ArgumentError: If there is none for the plant, with those that there are.
    """
    law = request.table.law
    nominal = request.nominal
    kinds = kinds_of(nominal)
    if law in kinds:
        return kinds[law]

    valid = dict.fromkeys([*request.file.laws, *kinds, "module:name"])
    others = [kind for kind in KINDS if kind.key == law]
    owners = [kind.system for kind in others if kind.system]
    if owners:
        raise ArgumentError(
            f"law {law!r} is there for {name_list(owners)} alone: take {name_list(valid)}"
        )
    if others and nominal.robot is not None:
        raise ArgumentError(
            f"law {law!r} does not fit {nominal.system.name}, a model in MuJoCo without "
            f"equations in symbols: take {name_list(valid)}"
        )
    raise ArgumentError(unknown_name("law", law, valid))


def _task_of_own_weights(request: LawRequest, kind: type[LawKind]) -> Task:
    """Return the task of a law with weights of its own: all states of the plant, at the origin."""
    linear_model = None
    nominal = request.nominal
    if design_variant(request.plant) == "corrected" and nominal.plant.kind == "physics":
        linear_model = nominal.plant.linearization()
    assert kind.own_weights is not None
    return state_task(request.equations, *kind.own_weights, model=linear_model)


# -- its numbers -----------------------------------------------------------------------------------


def numbers_of(kind: type[LawKind], switching: str) -> Mapping[str, LawNumber]:
    """Return the numbers of a law by their keys, those of its switching law among them.

    Args:
        kind: Kind of the law.
        switching: Name of the switching law, which counts if the law switches.
    """
    if not kind.switches:
        return kind.numbers()
    return {**kind.numbers(), **SWITCHINGS[switching].numbers}


def switching_numbers(table: ControllerTable, switching: str) -> dict[str, Any]:
    """Return the numbers in a law's table that a switching law reads."""
    read = SWITCHINGS[switching].numbers
    return {name: value for name, value in table.numbers.items() if name in read}


def _numbers_in(kind: type[LawKind], table: ControllerTable) -> dict[str, Any]:
    """Return the numbers in a table that are the law's, without those of its switching law.

    Raises:
        ArgumentError: If a key is neither's.
    """
    of_switching: Mapping[str, LawNumber] = {}
    if kind.switches:
        require_known("switching law", table.switching, SWITCHINGS)
        of_switching = SWITCHINGS[table.switching].numbers
        _refuse_numbers_of_others(table)
    others = {**kind.weights, **of_switching}
    numbers = {name: value for name, value in table.numbers.items() if name not in others}

    if numbers and kind.own_weights is not None:
        raise ArgumentError(f"{table.law} has weights and numbers of its own, not {list(numbers)}")
    valid = [*ControllerTable.model_fields, *kind.weights, *kind.field_names(), *of_switching]
    for name in numbers:
        owners = [other.key for other in KINDS if name in other.field_names()]
        if name not in valid and owners:
            own = name_list(kind.field_names()) or "no numbers"
            raise ArgumentError(
                f"{name} is a number of {name_list(dict.fromkeys(owners))}: the law here is "
                f"{kind.key!r}, which takes {own}"
            )
        require_known("key", name, valid)
    return numbers


def _refuse_numbers_of_others(table: ControllerTable) -> None:
    """Refuse numbers of switching laws that the one in a table does not read."""
    for name in table.numbers:
        readers = [key for key, law in SWITCHINGS.items() if name in law.numbers]
        if readers and table.switching not in readers:
            raise ArgumentError(
                f"{name} is a number of {name_list(readers)}: the switching law is "
                f"{table.switching!r}"
            )


def _arguments(
    kind: type[LawKind], table: ControllerTable, task: Task, *, of_states: bool
) -> dict[str, Any]:
    """Return the numbers of a table as fields of a kind of law.

    Args:
        kind: Kind of the law.
        table: Law and numbers of the controller.
        task: Task of the law.
        of_states: Whether the law is designed on the linearization.

    Raises:
        ArgumentError: If a key is unknown or missing, or a value does not fit.
    """
    numbers = _numbers_in(kind, table)
    missing = [name for name in kind.required() if name not in numbers]
    if missing:
        raise ArgumentError(f"{table.law} needs {' and '.join(missing)}")

    declared = kind.numbers()
    for name, value in numbers.items():
        is_one = name in declared and not declared[name].each
        if is_one and isinstance(value, list):
            raise ArgumentError(f"{name} = {value_text(value)} must be a number")

    inputs = task.error.system.inputs
    arguments = {}
    for name, value in numbers.items():
        unit = _unit(name, value, declared[name], inputs) if name in declared else ""
        arguments[name] = law_number(
            name,
            value,
            task.error.names,
            unit=unit,
            of_states=of_states,
            base_units=_base_units(task),
        )
    return arguments


def _base_units(task: Task) -> list[str]:
    """Return the units of inputs and outputs and the second, of which those of gains are made."""
    error = task.error
    of_inputs = [signal.unit for signal in error.system.inputs]
    of_outputs = [error.units[row] for row in error.output_rows]
    return list(dict.fromkeys([*of_inputs, *of_outputs, "s"]))


def _unit(name: str, value: Any, number: LawNumber, inputs: Sequence[Signal]) -> str:
    """Return the unit of a number, which may be that of the inputs.

    Raises:
        ArgumentError: If it is written with a unit, and the inputs have different ones.
    """
    if isinstance(number.unit, str):
        return number.unit
    units = [signal.unit for signal in inputs]
    if isinstance(value, str) and len(set(units)) > 1:
        raise ArgumentError(
            f"{name} = {value_text(value)} must be a number: the inputs have different units, "
            f"{name_list(units)}"
        )
    return units[0]
