"""Pydantic's refusals as lines of this package: the place, the value, and what it must be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from pydantic_core import PydanticCustomError

from grosmc_mj.ground.errors import unknown_name, value_text
from grosmc_mj.ground.units import number_hint
from grosmc_mj.ground.wording import counted

# Types by pydantic's names of errors.
_TYPES = {
    "float_type": "a number",
    "int_type": "a whole number, such as 1",
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "list_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
}
# Beginning of pydantic's sentences about bounds.
_SHOULD = "Input should be "


def refusal(wanted: str) -> PydanticCustomError:
    """Return the error of a refused value; ``wanted`` are the words that follow "must be"."""
    return PydanticCustomError("refused", "{wanted}", {"wanted": wanted})


class RefusedPlace(NamedTuple):
    """Place of a refused value.

    Attributes:
        name: Name of the key or the argument.
        kind: ``key`` or ``argument``.
        valid: Valid names there.
        where: Beginning of the line, such as the table.
    """

    name: str
    kind: str
    valid: Sequence[str]
    where: str = ""


def line_of(mistake: Any, place: RefusedPlace) -> str:
    """Write one refusal of pydantic, an entry of ``ValidationError.errors()``."""
    return place.where + _words(mistake, place)


def _words(mistake: Any, place: RefusedPlace) -> str:
    """Write a refusal without the beginning of its line."""
    kind = mistake["type"]
    message = mistake["msg"]
    given = mistake["input"]
    match kind:
        case "unknown":
            return message
        case "extra_forbidden":
            return unknown_name(place.kind, place.name, place.valid)
        case "unexpected_keyword_argument" | "unexpected_positional_argument":
            return f"there is no {place.kind} {place.name}; valid: {', '.join(place.valid)}"
        case "missing" | "missing_argument":
            return f"{place.name} is missing"
        case "literal_error":
            choices = mistake["ctx"]["expected"].replace(" or ", ", ").split(",")
            return unknown_name(place.name, given, [choice.strip("' ") for choice in choices])
        case "too_short":
            least = counted(mistake["ctx"]["min_length"], "entry", "entries")
            return f"{place.name} = {value_text(given)} must have {least} at least"
        case "too_long":
            most = counted(mistake["ctx"]["max_length"], "entry", "entries")
            return f"{place.name} = {value_text(given)} must have {most} at most"
        case "value_error":
            return f"{place.name}: {message.removeprefix('Value error, ')}"
    hint = number_hint(given) if kind == "float_type" else ""
    return f"{place.name} = {_written(kind, given)} {_must_be(mistake)}{hint}"


def _written(kind: str, given: Any) -> str:
    """Write a refused value."""
    if kind == "int_type" and isinstance(given, float):
        # 2.0 would be shown as 2.
        return repr(given)
    return value_text(given)


def _must_be(mistake: Any) -> str:
    """Say what a value must be."""
    kind = mistake["type"]
    message = mistake["msg"]
    if kind == "refused":
        return f"must be {message}"
    if kind in _TYPES:
        return f"must be {_TYPES[kind]}"
    if kind == "is_instance_of":
        return f"must be a {mistake['ctx']['class']}"
    if message.startswith(_SHOULD):
        return f"must be {message.removeprefix(_SHOULD)}"
    # Pydantic's own words for a check that is none of this package's.
    return f": {message}"
