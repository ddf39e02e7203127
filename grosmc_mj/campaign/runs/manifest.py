"""manifest.json: what a campaign is, all of it, so that anybody can go on with it or repeat it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.family.specification import Specification
from grosmc_mj.errors import ArgumentError, GrosmcError, SetupError
from grosmc_mj.experiments.file.user_code import named_in, sources
from grosmc_mj.results.document import git_revision
from grosmc_mj.versions import DECISIVE, versions

MANIFEST = "manifest.json"
# Of manifests and parts.
SCHEMA_VERSION = 3
# What a folder cannot be opened without, and of which type.
_FIELDS: dict[str, type] = {
    "hash": str,
    "configuration": dict,
    "model": str,
    "sources": dict,
    "versions": dict,
    "question": dict,
}
_WORDS = {str: "text", dict: "table"}
# What the hash is of: where a case file lies does not decide.
_HASHED = ("configuration", "model", "sources", "versions")
# Levels of tables and lists, of which our own files have six, and characters of a file.
_DEEPEST, _LONGEST = 32, 10**8
# What must be the same for the same campaign.
_DECIDING = ("configuration", "model", "sources")


def manifest_of(campaign: Campaign) -> dict[str, Any]:
    """The manifest of a campaign, as plain values."""
    specification = campaign.specification
    content = {
        "configuration": _configuration(campaign),
        "model": model_hash(campaign),
        "sources": sources_of(specification),
        "versions": versions(DECISIVE),
    }
    return {
        "schema_version": SCHEMA_VERSION,
        "hash": _hash(content),
        **content,
        "question": specification.document(),
        "git_revision": git_revision(),
    }


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest in a folder: all its fields of their types, and its hash that of its content.

    Raises:
        SetupError: If there is none, or one that cannot be read or does not have its own hash.
    """
    path = folder / MANIFEST
    try:
        content = read_json(path)
    except FileNotFoundError:
        raise SetupError(f"{folder} is no campaign: it has no {MANIFEST}") from None
    version = content.get("schema_version")
    if type(version) is not int or not 0 < version < 10**6:
        raise SetupError(f"{path}: cannot be read: it has no schema_version that is a number")
    if version != SCHEMA_VERSION:
        raise SetupError(
            f"{path} is of schema {version}; this grosmc_mj reads schema {SCHEMA_VERSION} alone: "
            "run the campaign again with this version"
        )
    if lacking := [key for key in _FIELDS if key not in content]:
        raise SetupError(f"{path}: cannot be read: it has no {' and no '.join(lacking)}")
    for key, kind in _FIELDS.items():
        if not isinstance(content[key], kind):
            raise SetupError(f"{path}: cannot be read: {key} is no {_WORDS[kind]}")
    for key in ("sources", "versions"):
        if not all(isinstance(value, str) for value in content[key].values()):
            raise SetupError(f"{path}: cannot be read: {key} has what is no text")
    if content["hash"] != _hash({key: content[key] for key in _HASHED}):
        raise SetupError(f"{path}: its hash is not that of its content: it was changed")
    try:
        Specification.of_document(content["question"])
    except GrosmcError as error:
        raise SetupError(f"{path}: {error}") from None
    return content


def read_json(path: Path) -> dict[str, Any]:
    """A JSON table that anybody may have written: finite numbers and texts that can be printed.

    Raises:
        FileNotFoundError: If there is none.
        SetupError: If it cannot be read, or is something else.
    """
    if path.exists() and not path.is_file():
        raise SetupError(f"{path}: is no file")
    try:
        with path.open(encoding="utf-8") as file:
            text = file.read(_LONGEST + 1)
        if len(text) > _LONGEST:
            raise SetupError(f"{path}: cannot be read: it has more than {_LONGEST:g} characters")
        content = json.loads(text)
        _refuse_nesting(content)
        # Numbers that are not finite, and halves of characters.
        json.dumps(content, ensure_ascii=False, allow_nan=False).encode()
    except FileNotFoundError:
        raise
    except OSError as error:
        raise SetupError(f"{path}: {error.strerror}") from None
    except UnicodeError:
        raise SetupError(f"{path}: cannot be read: it is no text in UTF-8") from None
    except RecursionError:
        raise SetupError(f"{path}: cannot be read: it is nested too deep") from None
    except ValueError as error:
        raise SetupError(f"{path}: cannot be read: {error}") from None
    if not isinstance(content, dict):
        raise SetupError(f"{path}: cannot be read: it is no table")
    return content


def _refuse_nesting(content: Any) -> None:
    """Refuse what would be too deep for whoever walks through it."""
    level = [content]
    for _ in range(_DEEPEST):
        level = [item for each in level for item in _items(each)]
    if level:
        raise ValueError(f"it is nested more than {_DEEPEST} deep")


def _items(value: Any) -> Iterable[Any]:
    """What is one level below."""
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()


def differences(there: Mapping[str, Any], asked: Mapping[str, Any]) -> list[str]:
    """What of a campaign decides its results and is not the same, a line each.

    Versions are left out, see ``outdated``; with others, the bytes of a model say nothing.

    Args:
        there: Manifest of a folder.
        asked: That of what is asked for.
    """
    return _changed(
        there, asked, ("configuration", "sources") if outdated(there, asked) else _DECIDING
    )


def refuse_other_code(folder: Path, there: Mapping[str, Any], specification: Specification) -> None:
    """Refuse Python that is not the recorded one, before any of it is imported.

    Args:
        folder: Of the campaign.
        there: Its manifest.
        specification: Whose case file would have it imported.

    Raises:
        ArgumentError: If a file is not the recorded one, or there are more or fewer.
    """
    if changed := _changed(there, {"sources": sources_of(specification)}, ("sources",)):
        raise ArgumentError(f"{folder} was begun with other Python: {'; '.join(changed)}")


def outdated(there: Mapping[str, Any], asked: Mapping[str, Any]) -> list[str]:
    """The packages that have another version now, a line each: bits may differ."""
    return _changed(there, asked, ("versions",))


def _changed(there: Mapping[str, Any], asked: Mapping[str, Any], keys: Sequence[str]) -> list[str]:
    """The leaves under some keys that are not the same, a line each."""
    old, new = (dict(flat({key: each.get(key) for key in keys})) for each in (there, asked))
    return [
        f"{key.removeprefix('configuration.')}: {old.get(key, 'nothing')} there, "
        f"{new.get(key, 'nothing')} now"
        for key in dict.fromkeys([*old, *new])
        if old.get(key) != new.get(key)
    ]


def model_hash(campaign: Campaign) -> str:
    """SHA-256 of the plant without uncertainty: of its compiled model, or of its parameters."""
    return campaign.plant.digest


def _configuration(campaign: Campaign) -> dict[str, Any]:
    """All that decides the results, but for code and model."""
    specification = campaign.specification
    return {
        "runs": specification.runs,
        "seed": specification.seed,
        "sampler": specification.sampler,
        "shard": specification.shard,
        **({"screen": specification.screen} if specification.screen != "none" else {}),
        "controllers": list(campaign.laws),
        "control_period": campaign.control_period,
        "duration": campaign.duration,
        "uncertain": {
            each.name: f"{each.distribution.words}; nominal {each.nominal:.17g}; unit {each.unit}"
            for each in campaign.family.quantities
        },
        "file": json.loads(json.dumps(campaign.experiment.document())),
    }


def sources_of(specification: Specification) -> dict[str, str]:
    """SHA-256 of the user's own Python that the case file would import, by file."""
    return sources(named_in(specification.file), Path(specification.folder))


def flat(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """The leaves of nested plain values, with the way to them."""
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from flat(item, f"{key}.{name}" if key else str(name))
    elif isinstance(value, (list, tuple)):
        for index, item in enumerate(value):
            yield from flat(item, f"{key} {index + 1}")
    else:
        yield key, value


def _hash(content: Mapping[str, Any]) -> str:
    """SHA-256 of plain values, whatever their order."""
    versioned = {"schema_version": SCHEMA_VERSION, **content}
    text = json.dumps(versioned, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()
