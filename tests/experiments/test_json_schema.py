"""JSON schema of case files: what it accepts, what it refuses, what it tells of a key."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from commands import run
from jsonschema import Draft7Validator

from grosmc_mj.experiments.file.json_schema import part_schema, schema_of_case_files
from grosmc_mj.experiments.file.parts import PART_KINDS
from grosmc_mj.experiments.file.shipped import CASES, starter
from grosmc_mj.theory.control.kinds import KINDS

SCHEMA = schema_of_case_files()
CASE_FILES = sorted(CASES.rglob("*.toml"))
CAMPAIGNS = sorted((CASES.parents[1] / "studies" / "campaign" / "shipped").glob("*.toml"))


def mistakes(content: dict[str, Any]) -> list[str]:
    return [error.message for error in Draft7Validator(SCHEMA).iter_errors(content)]


def test_the_schema_is_one() -> None:
    Draft7Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("file", [*CASE_FILES, *CAMPAIGNS], ids=lambda file: file.stem)
def test_every_shipped_case_file_fits(file: Path) -> None:
    assert mistakes(tomllib.loads(file.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(
    ("content", "key"),
    [
        ({"rum": {}}, "rum"),
        ({"run": {"durration": "1 s"}}, "durration"),
        ({"sensor": [{"of": "rotor angle", "noize": "1 rad"}]}, "noize"),
        ({"edit": [{"body": "rotor", "mas_scale": 2}]}, "mas_scale"),
        ({"requirement": [{"settle_within": "1 s"}]}, "settle_within"),
        ({"known_loop": {"sensor": [{"of": "q", "noize": 1}]}}, "noize"),
    ],
)
def test_a_misspelt_key_is_refused(content: dict[str, Any], key: str) -> None:
    assert any(f"'{key}' was unexpected" in line for line in mistakes(content))


@pytest.mark.parametrize(
    "content",
    [
        # A number without its unit, one beyond its bounds, and a choice that there is not.
        {"run": {"duration": 1}},
        {"sensor": [{"of": "rotor angle", "delay": 0.001}]},
        {"computing": {"missed": 1.0}},
        {"edit": [{"body": "rotor", "mass_scale": 0}]},
        {"estimator": [{"of": "rotor speed", "law": "differense"}]},
        {"wall": [{"body": "rotor", "radius": "1 cm", "at": ["0 m", "0 m"]}]},
        # A key that is missing, and two owners.
        {"motor": [{"input": "current"}]},
        {"edit": [{"body": "rotor", "joint": "shaft", "mass_scale": 2}]},
    ],
)
def test_a_wrong_value_is_refused(content: dict[str, Any]) -> None:
    assert mistakes(content)


@pytest.mark.parametrize("kind", PART_KINDS.values(), ids=lambda kind: kind.name)
def test_every_key_of_a_part_has_its_meaning(kind: Any) -> None:
    properties = part_schema(kind)["properties"]
    assert set(properties) == set(kind.keys)
    assert all(len(key["description"]) > 10 for key in properties.values())


def meanings(schema: Any) -> Iterator[tuple[str, str]]:
    """Every key below a schema, with its description."""
    if isinstance(schema, list):
        for entry in schema:
            yield from meanings(entry)
    elif isinstance(schema, dict):
        for name, key in schema.get("properties", {}).items():
            yield name, key.get("description", "")
        for value in schema.values():
            yield from meanings(value)


def test_every_key_of_a_case_file_has_its_meaning() -> None:
    words = list(meanings(SCHEMA))
    assert len(words) > 200
    assert [name for name, meaning in words if len(meaning) < 10 or meaning[0] == "["] == []


@pytest.mark.parametrize("law", KINDS, ids=lambda law: law.__name__)
def test_numbers_of_laws_are_shown(law: Any) -> None:
    properties = SCHEMA["definitions"]["LawTable"]["properties"]
    for name in law.numbers():
        assert name in properties
    assert law.key in properties["law"]["examples"]


def test_units_and_bounds_stand_in_the_meaning_of_a_number() -> None:
    sensor = part_schema(PART_KINDS["sensor"])["properties"]
    assert sensor["noise"]["description"].endswith(
        "Finite and not negative, in the unit of the state. Default: 0."
    )
    assert sensor["delay"]["examples"] == ["1 s"]
    computing = part_schema(PART_KINDS["computing"])["properties"]
    assert (computing["missed"]["minimum"], computing["missed"]["exclusiveMaximum"]) == (0, 1)


def test_the_command_prints_the_schema(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("new", "--schema") == 0
    assert json.loads(capsys.readouterr().out) == SCHEMA


def test_the_command_writes_the_schema(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("new", "case.schema.json", "--schema") == 0
    assert json.loads(Path("case.schema.json").read_text(encoding="utf-8")) == SCHEMA
    assert mistakes(tomllib.loads(starter())) == []


@pytest.mark.parametrize("arguments", [[], ["--schema", "--python"]])
def test_a_file_without_a_name_or_of_two_kinds_is_refused(arguments: list[str]) -> None:
    assert run("new", *arguments) == 2
