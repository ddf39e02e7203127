"""Requirements in the tables of a case file, with their units checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from grosmc_mj.experiments.file.schema import RequirementTable
from grosmc_mj.experiments.requirements import KINDS
from grosmc_mj.experiments.requirements.always import Always
from grosmc_mj.experiments.requirements.measurement import signal_units
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.experiments.requirements.signals import named_units
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError, Mistakes, name_list, value_text
from grosmc_mj.ground.units import number_in
from grosmc_mj.theory.control.controller import Controller


def kinds_in(table: RequirementTable) -> list[type[Requirement]]:
    """Return the kinds of requirement that a table asks for."""
    return [kind for kind in KINDS if getattr(table, kind.key) not in (None, False)]


def requirements_in(
    table: RequirementTable,
    laws: Sequence[Controller],
    plants: Sequence[str],
    duration: float,
) -> list[Requirement]:
    """Return the requirements in a table of a case file.

    Args:
        table: Table of the file.
        laws: All controllers of the file.
        plants: Plants that they run on.
        duration: Duration of a run [s].

    Raises:
        ArgumentError: If it requires nothing, names a missing thing, or a unit does not fit.
    """
    kinds = kinds_in(table)
    if not kinds:
        keys = ", ".join(kind.key for kind in KINDS)
        raise ArgumentError(f"nothing is required: give one of {keys}")

    required = []
    mistakes = Mistakes()
    for kind in kinds:
        with mistakes.gathered(f"{kind.key}: "):
            required.append(requirement_of(kind, table, laws, plants, duration))
    mistakes.refuse()
    return required


def requirement_of(
    kind: type[Requirement],
    table: RequirementTable,
    laws: Sequence[Controller],
    plants: Sequence[str],
    duration: float,
) -> Requirement:
    """Return one requirement of a table; arguments and errors as for ``requirements_in``."""
    error = laws[0].designed.error
    signal = table.state or ""
    if signal:
        _refuse_signal(kind, signal, error)
    value = getattr(table, kind.key)
    named = [law for law in laws if not table.of or law.name in table.of]
    asked = [law for law in named if kind.can_be_asked_of(law, value)]
    of = tuple(law.name for law in asked)
    kind.refuse_undefined(error, of, signal)

    options: dict[str, Any] = {}
    output_unit = _unit_of("output", error, named, signal)
    if "band" in kind.options and table.band is not None:
        options["band"] = _positive("band", table.band, output_unit)
        options["band_written"] = str(table.band)
    elif kind.needs_band:
        raise ArgumentError(f'give the half width of its band, such as band = "0.1 {output_unit}"')
    if "periodic" in kind.options and table.periodic:
        _refuse_turn(output_unit, signal, error)
        options["periodic"] = True
    unit = _unit_of(kind.quantity, error, named, signal)
    if issubclass(kind, Always):
        sliding_unit = _unit_of("sliding", error, named, "")
        units = named_units(asked[0], sliding_unit)
        options = kind.options_in(dict(table), units, duration)
    else:
        options["unit"] = unit
        options["after"] = kind.holds_from(table.after, duration)
        if value is not True:
            owner = _owner_of(kind.quantity, error, signal)
            options["number"] = _positive(kind.key, value, unit, owner)
    return kind(
        written=_written(value, unit),
        laws=of,
        plants=_plants_of(table, plants),
        signal=signal,
        **options,
    )


def _refuse_signal(kind: type[Requirement], signal: str, error: Any) -> None:
    """Refuse a state or output that there is not, or that this kind is not asked of."""
    if "state" not in kind.options:
        keys = [other.key for other in KINDS if "state" in other.options]
        raise ArgumentError(f"it is not asked of a state: {', '.join(keys)} are")
    require_known("state", signal, signal_units(error))


def _refuse_turn(unit: str, signal: str, error: Any) -> None:
    """Refuse a turn of what is no angle, and of several angles together."""
    if unit != "rad":
        raise ArgumentError(f"periodic is for angles, not for {unit or 1}")
    if len(error.output_rows) > 1 and not signal:
        raise ArgumentError("periodic is for one angle: name one of the outputs as state")


def _unit_of(quantity: str, error: Any, laws: Sequence[Controller], signal: str) -> str:
    """Return the unit of a quantity; of s under these laws, of ``output`` the signal's."""
    if quantity == "output" and signal:
        return signal_units(error)[signal]
    if quantity == "output":
        return error.units[error.output_rows[0]]
    if quantity == "input":
        return error.system.inputs[0].unit
    if quantity == "sliding":
        units = [law.designed.sliding_unit for law in laws]
        return next(filter(None, units), "")
    return quantity


def _owner_of(quantity: str, error: Any, signal: str) -> str:
    """Return the names of that whose unit a limit has; empty for a unit of its own."""
    if quantity == "input":
        return name_list(dict.fromkeys(signal.name for signal in error.system.inputs))
    return signal if quantity == "output" else ""


def _positive(key: str, value: Any, unit: str, owner: str = "") -> float:
    """Return the number of a limit in a unit, that of its owner; times are numbers already."""
    try:
        number = float(value) if unit == "s" else number_in(value, unit)
    except ArgumentError as error:
        if not owner:
            raise
        raise ArgumentError(f"{error} (the unit of {owner} is {unit or 1})") from None
    if not number > 0:
        raise ArgumentError(f"{value_text(value)} must be positive")
    return number


def _written(value: Any, unit: str) -> str:
    """Return a value as it is written in the file; times are numbers already."""
    if unit == "s":
        return f"{value:g} s"
    return str(value)


def _plants_of(table: RequirementTable, plants: Sequence[str]) -> tuple[str, ...]:
    """Return the plants that a table names: physics by default, or all where there is none."""
    if table.on:
        return tuple(table.on)
    if "physics" in plants:
        return ("physics",)
    return tuple(plants)
