"""Reading the claims' files, or one line about what is wrong with them."""

from __future__ import annotations

import inspect
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import MISSING, fields
from functools import partial
from pathlib import Path
from typing import Any, get_args

from grosmc_mj.chapter.claims.claim import Choice, Claim, Kind, Verdict
from grosmc_mj.chapter.claims.measurements import (
    arm,
    bench,
    cart,
    cart_pendulum,
    measures,
    servo,
    theory,
    two_link_arm,
)
from grosmc_mj.chapter.claims.words import WORDS
from grosmc_mj.errors import ArgumentError, SetupError, shown, unknown_name
from grosmc_mj.experiments.runs import PlantName

# What a claim's functions are called with, before the arguments that its file gives.
_CALLED_WITH = {"measure": ("lab", "plant"), "premise": ("lab",), "drawing": ("lab",)}
# A limit has four of a claim's fields, the file's place two; the others have keys of their names.
_ELSEWHERE = {"id", "system", "sense", "threshold", "unit", "word"}
_FIELDS = [field for field in fields(Claim) if field.name not in _ELSEWHERE]
_KEYS = [*(field.name for field in _FIELDS), "limit"]
_REQUIRED = [*(field.name for field in _FIELDS if field.default is MISSING), "limit"]
# Keys whose values are no text.
_TYPES = {
    "limit": dict, "verdicts": dict, "exact": bool, "choices": list, "every": list, "some": list,
} | dict.fromkeys(_CALLED_WITH, dict)  # fmt: skip
_WORDS = {bool: "true or false", dict: "a table", str: "a text", list: "a list"}
# Tables of a file that are no claims.
_SHARED = ("choices", "causes")


def _functions() -> dict[str, Callable[..., Any]]:
    """What a claim may name: the modules' public functions that take a laboratory."""
    return {
        f"{module.__name__.rpartition('.')[2]}.{name}": function
        for module in (servo, cart_pendulum, cart, arm, two_link_arm, bench, theory, measures)
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
        shared = {name: content.pop(name, {}) for name in _SHARED}
        for name, table in content.items():
            try:
                claims.append(_claim(name, path.stem, table, **shared))
            except ArgumentError as error:
                raise SetupError(f"{path}: claim {name}: {error}") from None
            named |= {table[key]["function"] for key in _CALLED_WITH if key in table}
    if idle := [name for name in FUNCTIONS if name not in named]:
        raise SetupError(f"no claim names {', '.join(idle)}: take them out, or name them in a file")
    return tuple(claims)


def _claim(
    name: str, system: str, table: Any, choices: dict[str, Any], causes: dict[str, str]
) -> Claim:
    """The claim that a table describes, with the choices and causes of its file.

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
    if "limit" in table:
        read = _meaning if "word" in table["limit"] else _limit
        values |= read(values.pop("limit"))
    if missing := [key for key in _REQUIRED if key not in table and key not in values]:
        raise ArgumentError(f"{', '.join(missing)} must be given too")
    for key in ("choices", "every", "some"):
        chosen = [_one_of("choice", each, choices) for each in table.get(key, ())]
        if lacking := [each for each in chosen if each not in table.get("choices", ())]:
            raise ArgumentError(f"{key}: {', '.join(lacking)} must be among its choices")
        made = tuple(_choice(choices[each]) for each in chosen)
        values[key] = made if key == "choices" else tuple(each.name for each in made)
    if "kind" in table:
        values["kind"] = Kind(_one_of("kind", table["kind"], [each.value for each in Kind]))
    if "cause" in table:
        values["cause"] = causes[_one_of("cause", table["cause"], causes)]
    values["verdicts"] = {
        _one_of("plant", plant, get_args(PlantName)): Verdict(
            _one_of("verdict", verdict, [each.value for each in Verdict])
        )
        for plant, verdict in table["verdicts"].items()
    }
    if not values["verdicts"]:
        raise ArgumentError("verdicts name no plant")
    return Claim(id=name, system=system, **values)


def _choice(table: dict[str, Any]) -> Choice:
    """What a table of choices describes.

    Raises:
        ArgumentError: If it is neither a number of the files nor an argument, or has no values.
    """
    valid = [field.name for field in fields(Choice)]
    for key in table:
        _one_of("key of a choice", key, valid)
    if ("key" in table) == ("argument" in table) or not table.get("values"):
        raise ArgumentError("a choice must have a name, values and either a key or an argument")
    values = tuple(table["values"])
    return Choice(**{"printed": False, **table, "values": values})


def _meaning(table: dict[str, Any]) -> dict[str, Any]:
    """Sense, threshold and unit of a word, and why.

    Raises:
        ArgumentError: If there is no such word, or anything else is given.
    """
    word = _one_of("word", table["word"], WORDS)
    if len(table) > 1:
        raise ArgumentError(f"limit = {shown(table)}: a word has its own number")
    limit = dict(WORDS[word])
    return {"word": word, "why": limit.pop("why"), **_limit(limit)}


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
