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
    ("text", "words"),
    [
        ("[rum]\n", "'rum' was unexpected"),
        ('[run]\ndurration = "1 s"\n', "'durration' was unexpected"),
        ('[plant]\nsytem = "servo"\n', "'sytem' was unexpected"),
        ('[[sensor]]\nof = "rotor angle"\nnoize = "1 rad"\n', "'noize' was unexpected"),
        ('[[edit]]\nbody = "rotor"\nmas_scale = 2\n', "'mas_scale' was unexpected"),
        ('[[disturbance]]\nbody = "rotor"\ntorqe = [1]\n', "'torqe' was unexpected"),
        ('[[lugre]]\njoint = "shaft"\ncoulomb = "1 N m"\nstatc = 1\n', "'statc' was unexpected"),
        ('[[requirement]]\nsettle_within = "1 s"\n', "'settle_within' was unexpected"),
        ('[known_loop]\n[[known_loop.sensor]]\nof = "q"\nnoize = 1\n', "'noize' was unexpected"),
    ],
)
def test_a_misspelt_key_is_refused(text: str, words: str) -> None:
    assert any(words in line for line in mistakes(tomllib.loads(text)))


@pytest.mark.parametrize(
    "text",
    [
        # A number without its unit, one beyond its bounds, and a choice that there is not.
        "[run]\nduration = 1\n",
        '[[sensor]]\nof = "rotor angle"\ndelay = 0.001\n',
        "[computing]\nmissed = 1.0\n",
        '[[edit]]\nbody = "rotor"\nmass_scale = 0\n',
        '[[estimator]]\nof = "rotor speed"\nlaw = "differense"\n',
        '[[disturbance]]\ninput = "current"\namplitude = "1 A"\nprofile = "sinus"\n',
        '[[wall]]\nbody = "rotor"\nradius = "1 cm"\nat = ["0 m", "0 m"]\n',
        # A key that is missing, and two owners.
        '[[motor]]\ninput = "current"\n',
        '[[edit]]\nbody = "rotor"\njoint = "shaft"\nmass_scale = 2\n',
    ],
)
def test_a_wrong_value_is_refused(text: str) -> None:
    assert mistakes(tomllib.loads(text))


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
