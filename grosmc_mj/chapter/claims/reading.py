"""Reading the claims' files, or one line about what is wrong with them."""

from __future__ import annotations

import inspect
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import MISSING, fields
from functools import partial
from pathlib import Path
from typing import Any, get_args

from grosmc_mj.chapter.claims import (
    arm,
    cart,
    cart_pendulum,
    measures,
    servo,
    theory,
    two_link_arm,
)
from grosmc_mj.chapter.claims.claim import Claim, Verdict
from grosmc_mj.errors import ArgumentError, SetupError, shown, unknown_name
from grosmc_mj.experiments.runs import PlantName

# What a claim's functions are called with, before the arguments that its file gives.
_CALLED_WITH = {"measure": ("lab", "plant"), "premise": ("lab",), "drawing": ("lab",)}
# A limit has three of a claim's fields, the file's place two; the others have keys of their names.
_ELSEWHERE = {"id", "system", "sense", "threshold", "unit"}
_FIELDS = [field for field in fields(Claim) if field.name not in _ELSEWHERE]
_KEYS = [*(field.name for field in _FIELDS), "limit"]
_REQUIRED = [*(field.name for field in _FIELDS if field.default is MISSING), "limit"]
# Keys whose values are no text.
_TYPES = {"limit": dict, "verdicts": dict, "exact": bool, "defect": bool} | dict.fromkeys(
    _CALLED_WITH, dict
)
_WORDS = {bool: "true or false", dict: "a table", str: "a text"}


def _functions() -> dict[str, Callable[..., Any]]:
    """What a claim may name: the modules' public functions that take a laboratory."""
    return {
        f"{module.__name__.rpartition('.')[2]}.{name}": function
        for module in (servo, cart_pendulum, cart, arm, two_link_arm, theory, measures)
        for name, function in inspect.getmembers(module, inspect.isfunction)
        if function.__module__ == module.__name__
        and not name.startswith("_")
        and "lab" in inspect.signature(function).parameters
    }


FUNCTIONS = _functions()


def read_claims(paths: Iterable[Path]) -> tuple[Claim, ...]:
    """The claims of the systems' files, in the files' order.

    Args:
        paths: One for each system, with its name.

    Raises:
        SetupError: If a file cannot be read, a claim is not as it must be, or no claim names one
            of the functions.
    """
    claims, named = [], set()
    for path in paths:
        try:
            content = tomllib.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise SetupError(f"{path} is missing: install again") from error
        except ValueError as error:
            raise SetupError(f"{path}: no valid TOML: {error}") from error
        for name, table in content.items():
            try:
                claims.append(_claim(name, path.stem, table))
            except ArgumentError as error:
                raise SetupError(f"{path}: claim {name}: {error}") from None
            named |= {table[key]["function"] for key in _CALLED_WITH if key in table}
    if idle := [name for name in FUNCTIONS if name not in named]:
        raise SetupError(f"no claim names {', '.join(idle)}: take them out, or name them in a file")
    return tuple(claims)


def _claim(name: str, system: str, table: Any) -> Claim:
    """The claim that a table describes.

    Raises:
        ArgumentError: If a key is unknown or missing, or its value is not what it must be.
    """
    if not isinstance(table, dict):
        raise ArgumentError(f"{shown(table)} must be a table")
    values = dict(table)
    for key, value in table.items():
        kind = _TYPES.get(_one_of("key", key, _KEYS), str)
        if not isinstance(value, kind):
            raise ArgumentError(f"{key} = {shown(value)} must be {_WORDS[kind]}")
        if key in _CALLED_WITH:
            values[key] = _bound(key, value, system)
    if missing := [key for key in _REQUIRED if key not in table]:
        raise ArgumentError(f"{', '.join(missing)} must be given too")
    values |= _limit(values.pop("limit"))
    values["verdicts"] = {
        _one_of("plant", plant, get_args(PlantName)): Verdict(
            _one_of("verdict", verdict, [each.value for each in Verdict])
        )
        for plant, verdict in table["verdicts"].items()
    }
    if not values["verdicts"]:
        raise ArgumentError("verdicts name no plant")
    return Claim(id=name, system=system, **values)


def _limit(table: dict[str, Any]) -> dict[str, Any]:
    """Sense, threshold and unit.

    Raises:
        ArgumentError: If the table has anything else.
    """
    match table:
        case {"at_most": float(threshold), "unit": str(unit)} if len(table) == 2:
            return {"sense": "at most", "threshold": threshold, "unit": unit}
        case {"at_least": float(threshold), "unit": str(unit)} if len(table) == 2:
            return {"sense": "at least", "threshold": threshold, "unit": unit}
    raise ArgumentError(
        f"limit = {shown(table)} must have at_most or at_least, a number with a point, and a unit"
    )


def _one_of(kind: str, name: Any, valid: Iterable[str]) -> Any:
    """The name, if it is one.

    Raises:
        ArgumentError: If it is not.
    """
    if not isinstance(name, str) or name not in valid:
        raise ArgumentError(unknown_name(kind, name, valid))
    return name


def _bound(key: str, table: dict[str, Any], system: str) -> Callable[..., Any]:
    """The function that a table names, with the table's arguments.

    Raises:
        ArgumentError: If there is no such function, or the arguments are not its own.
    """
    arguments = dict(table)
    name = _one_of("function", arguments.pop("function", None), FUNCTIONS)
    signature = inspect.signature(FUNCTIONS[name])
    if "system" in signature.parameters:
        arguments["system"] = system
    try:
        signature.bind(*_CALLED_WITH[key], **arguments)
    except TypeError as error:
        raise ArgumentError(f"{key}: {name}: {error}") from None
    return partial(FUNCTIONS[name], **arguments)
