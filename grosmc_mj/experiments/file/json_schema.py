"""JSON schema of case files, for editors: every key with its meaning, unit, bounds and choices.

It is made of the classes that a file is read with, and of their docstrings. A file may take keys of
tables from another one, so only the entries of arrays of tables lack a key here.
"""

from __future__ import annotations

import inspect
import math
import re
from functools import partial
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from grosmc_mj.experiments.file.content import EXTENDS
from grosmc_mj.experiments.file.disturbance_tables import COURSES
from grosmc_mj.experiments.file.keys import Key, keys_of
from grosmc_mj.experiments.file.part_tables import ASSUMED, PartKind
from grosmc_mj.experiments.file.schema import CaseFile, LawTable
from grosmc_mj.experiments.requirements import KINDS
from grosmc_mj.ground.fields import Known, OwnerUnit, Range, Reals, notes_on
from grosmc_mj.ground.units import number_in
from grosmc_mj.theory.control.kinds import KINDS as LAWS
from grosmc_mj.theory.control.law_number import LawNumber
from grosmc_mj.theory.control.switching import SWITCHINGS, SwitchingNumbers

Schema = dict[str, Any]
# A draft that editors of TOML read.
DRAFT = "http://json-schema.org/draft-07/schema#"
# A number and its unit; the reader of case files tells more about a mistake in it.
NUMBER_WITH_UNIT = r"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*\S"
# Tables of which a file has an array, and whose entries are complete therefore.
_IN_ARRAYS = ("ControllerTable", "ClaimTable", "CorrelationTable", "MeasuredTable")
# In Python the profile of a disturbance is a function; in a file it has a name.
_PROFILE: Schema = {"anyOf": [{"enum": list(COURSES)}, {"type": "string", "pattern": ":"}]}
_COURSES = f"{', '.join(COURSES)}, or module:name of a function of t in seconds"
# Units of pure numbers.
_PURE = ("", "1", "%")
# An attribute in a docstring with its text, which may go on in deeper lines.
_ATTRIBUTE = re.compile(r"^ {4}(\w+): (.*(?:\n {8,}.*)*)", re.MULTILINE)
_SECTION = re.compile(r"^ *Attributes:\n((?: {4}.*\n?|\s*\n)*)", re.MULTILINE)


def schema_of_case_files() -> Schema:
    """Return the JSON schema of case files as plain values."""
    schema = CaseFile.model_json_schema(
        ref_template="#/definitions/{model}", schema_generator=_Generator
    )
    definitions = schema.pop("$defs")
    schema["properties"][EXTENDS] = {
        "type": "string",
        "description": "File beside this one, or case of the package, such as servo/machine, from "
        "which comes what this file lacks.",
    }
    # Another file, or the base file of the system, may have them.
    schema.pop("required", None)
    for name, definition in definitions.items():
        if name not in _IN_ARRAYS:
            definition.pop("required", None)
    title = "Case file of grosmc-mj"
    description = 'Every number with a dimension is a text with its unit, such as "10 deg".'
    schema.update(title=title, description=description)
    return {"$schema": DRAFT, **schema, "definitions": definitions}


class _Generator(GenerateJsonSchema):
    """Schemas of tables with the meaning of each key from the docstring of its class."""

    def function_plain_schema(self, schema: Any) -> Schema:
        """Return the schema of a table with a part, which its kind checks."""
        kind = getattr(schema["function"]["function"], "__self__", None)
        if isinstance(kind, PartKind):
            return part_schema(kind)
        return super().function_plain_schema(schema)

    def function_before_schema(self, schema: Any) -> Schema:
        """Return the schema of a number with a unit, which is a text in a file."""
        function = schema["function"]["function"]
        if isinstance(function, partial) and function.func is number_in:
            return _with_unit(function.keywords["unit"])
        return super().function_before_schema(schema)

    def model_schema(self, schema: Any) -> Schema:
        """Return the schema of a table."""
        model: type[BaseModel] = schema["cls"]
        result: Schema = super().model_schema(schema)
        result["description"] = _summary(model)
        words = {kind.key: _summary(kind) for kind in KINDS}
        words.update(_meanings(model))
        properties = result["properties"]
        for name, value in properties.items():
            properties[name] = _without_null(value)
            if name in words:
                properties[name]["description"] = words[name]
        if issubclass(model, LawTable):
            properties.update(_numbers_of_laws())
            properties["law"]["examples"] = list(dict.fromkeys(kind.key for kind in LAWS))
            properties["switching"]["examples"] = list(SWITCHINGS)
        return result


def _numbers_of_laws() -> Schema:
    """Return the numbers of the package's laws; their values are checked when they are designed."""
    laws: dict[str, list[str]] = {}
    numbers: dict[str, LawNumber] = {}
    for kind in (*LAWS, SwitchingNumbers):
        for name, key in keys_of(kind).items():
            if isinstance(key.bounds, LawNumber):
                numbers.setdefault(name, key.bounds)
                laws.setdefault(name, []).append(getattr(kind, "key", "switching laws"))

    schema: Schema = {}
    for name, number in numbers.items():
        of = ", ".join(dict.fromkeys(laws[name]))
        meaning = f"{number.meaning[0].upper()}{number.meaning[1:]}"
        schema[name] = {"description": f"{meaning} ({of}). {_bounds_in_words(number)}"}
    return schema


def _without_null(schema: Schema) -> Schema:
    """Return the schema of a key without None, which stands for a key that is left out."""
    result = {name: value for name, value in schema.items() if name != "title"}
    if result.get("default", 0) is None:
        del result["default"]
    if "anyOf" in result:
        choices = [choice for choice in result.pop("anyOf") if choice != {"type": "null"}]
        result.update(choices[0] if len(choices) == 1 else {"anyOf": choices})
    return result


def part_schema(kind: PartKind) -> Schema:
    """Return the schema of a table with a part."""
    properties: Schema = {}
    for form in kind.forms:
        classes = [form.part, *form.choices]
        if form.further is not None:
            classes.append(form.further)
        words: dict[str, str] = {}
        for part in classes:
            words.update(_meanings(part))
        for name, key in form.keys.items():
            properties.setdefault(name, key_schema(key, words.get(key.field, "")))
    if kind.assumes:
        properties[ASSUMED] = {
            "type": "array",
            "items": {"enum": kind.forms[0].numbers},
            "description": "Names of its numbers that nobody has published: results mark them.",
        }

    schema: Schema = {"type": "object", "properties": properties, "additionalProperties": False}
    first, *others = kind.forms
    if others:
        schema["oneOf"] = [{"required": [owner]} for owner in kind.owners]
        schema["description"] = f"It names one of {', '.join(kind.owners)}."
        return schema

    schema["description"] = _summary(first.part)
    # The computer is a table, whose keys another file may have.
    if first.owner:
        schema["required"] = first.required
    return schema


def key_schema(key: Key, words: str) -> Schema:
    """Return the schema of a key.

    Args:
        key: The key.
        words: Its meaning.
    """
    if key.name == "profile":
        return {**_PROFILE, "description": f"Course in time: {_COURSES}."}
    schema = _values(key)
    described = [words] if words else []
    if key.bounds is not None:
        described.append(_bounds_in_words(key.bounds))
    default = _default(key)
    if default is not None:
        described.append(f"Default: {default}.")
    schema["description"] = " ".join(described)
    return schema


def _values(key: Key) -> Schema:
    """Return the type of a key's values with its choices and bounds."""
    if key.vector is not None:
        entry = {"type": "number"} if key.vector.unit in _PURE else _with_unit(key.vector.unit)
        count = key.vector.count
        return {"type": "array", "items": entry, "minItems": count, "maxItems": count}
    if key.bounds is not None:
        return _number(key.bounds)
    for note in notes_on(key.hint):
        if isinstance(note, Known):
            return {"enum": list(note.names)}
        if isinstance(note, Reals):
            return {"type": "array", "items": {"type": "number"}}
    return _plain(key.hint)


def _plain(hint: Any) -> Schema:
    """Return the type of a text, a truth value or names."""
    base = next((part for part in get_args(hint) if part in (str, bool)), hint)
    if base is bool:
        return {"type": "boolean"}
    if base is str:
        return {"type": "string"}
    # Names of several states.
    return {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}


def _number(bounds: Range) -> Schema:
    """Return the type of a number with its bounds; of a text they cannot be checked here."""
    unit = bounds.unit
    if isinstance(unit, OwnerUnit) or unit not in _PURE:
        text = _with_unit("" if isinstance(unit, OwnerUnit) else unit)
        return {"anyOf": [text, {"type": "number"}]} if bounds.bare else text

    schema: Schema = {"type": "integer" if bounds.whole else "number"}
    if math.isfinite(bounds.low):
        schema["exclusiveMinimum" if bounds.above else "minimum"] = bounds.low
    if math.isfinite(bounds.high):
        schema["exclusiveMaximum" if bounds.below else "maximum"] = bounds.high
    return schema


def _with_unit(unit: str) -> Schema:
    """Return the type of a number with its unit."""
    schema: Schema = {"type": "string", "pattern": NUMBER_WITH_UNIT}
    if unit:
        schema["examples"] = [f"1 {unit}"]
    return schema


def _bounds_in_words(bounds: Range) -> str:
    """Return bounds and unit of a number as a sentence."""
    words = bounds.wanted
    unit = str(bounds.unit)
    if unit and not words.endswith(f" {unit}"):
        words = f"{words}, in {unit}"
    return f"{words[0].upper()}{words[1:]}."


def _default(key: Key) -> str | None:
    """Return the default of a key as a text; None without one, or for no limit."""
    value = key.default
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)) and math.isfinite(value):
        return f"{value:g}"
    if isinstance(value, str) and value:
        return value
    return None


def _summary(kind: type) -> str:
    """Return the first paragraph of a docstring."""
    paragraph = inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0]
    return _plain_text(paragraph)


def _meanings(kind: type) -> dict[str, str]:
    """Return the texts of the attributes in the docstrings of a class and those it is made from."""
    meanings: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        section = _SECTION.search(inspect.cleandoc(base.__doc__ or ""))
        if section is not None:
            for name, text in _ATTRIBUTE.findall(section[1]):
                meanings[name] = _plain_text(text)
    return meanings


def _plain_text(text: str) -> str:
    """Return a text of a docstring on one line, without its marks of code."""
    return " ".join(text.replace("``", "").split())
