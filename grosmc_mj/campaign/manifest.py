"""manifest.json: what a campaign is, all of it, so that anybody can go on with it or repeat it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.campaign.campaign import Campaign
from grosmc_mj.campaign.question import Question
from grosmc_mj.casefile.user_code import is_named
from grosmc_mj.errors import SetupError
from grosmc_mj.simulation.mujoco_plant import MujocoPlant
from grosmc_mj.validation.results_file import git_revision
from grosmc_mj.versions import DECISIVE, installed

MANIFEST = "manifest.json"
SCHEMA_VERSION = 1
# What a folder cannot be opened without.
_NEEDED = ("hash", "question")
# What must be the same for the same campaign.
_DECIDING = ("configuration", "model", "sources")


def manifest_of(campaign: Campaign) -> dict[str, Any]:
    """The manifest of a campaign, as plain values."""
    question = campaign.question
    content = {
        "configuration": _configuration(campaign),
        "model": model_hash(campaign),
        "sources": _sources(question),
        "versions": installed(DECISIVE),
    }
    return {
        "schema_version": SCHEMA_VERSION,
        "hash": _hash(content),
        **content,
        "question": question.document(),
        "git_revision": git_revision(),
    }


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest in a folder.

    Raises:
        SetupError: If there is none, or one that cannot be read.
    """
    path = folder / MANIFEST
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        version = int(content["schema_version"])
        lacking = [key for key in _NEEDED if key not in content]
    except FileNotFoundError:
        raise SetupError(f"{folder} is no campaign: it has no {MANIFEST}") from None
    except OSError as error:
        raise SetupError(f"{path}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError) as error:
        raise SetupError(f"{path}: cannot be read: {error}") from None
    if version > SCHEMA_VERSION:
        raise SetupError(
            f"{path} is of schema {version}; this grosmc_mj reads up to {SCHEMA_VERSION}: update it"
        )
    if lacking:
        raise SetupError(f"{path}: cannot be read: it has no {' and no '.join(lacking)}")
    return content


def differences(there: Mapping[str, Any], asked: Mapping[str, Any]) -> list[str]:
    """What of a campaign decides its results and is not the same, a line each.

    Versions are left out, see ``outdated``; with others, the bytes of a model say nothing.
    """
    keys = ("configuration", "sources") if outdated(there, asked) else _DECIDING
    return _changed(there, asked, keys)


def outdated(there: Mapping[str, Any], asked: Mapping[str, Any]) -> list[str]:
    """The packages that have another version now, a line each: bits may differ."""
    return _changed(there, asked, ("versions",))


def _changed(there: Mapping[str, Any], asked: Mapping[str, Any], keys: Sequence[str]) -> list[str]:
    """The leaves under some keys that are not the same, a line each."""
    old, new = (dict(_flat({key: each.get(key) for key in keys})) for each in (there, asked))
    return [
        f"{key.removeprefix('configuration.')}: {old.get(key, 'nothing')} there, "
        f"{new.get(key, 'nothing')} now"
        for key in dict.fromkeys([*old, *new])
        if old.get(key) != new.get(key)
    ]


def model_hash(campaign: Campaign) -> str:
    """SHA-256 of the plant without uncertainty: of its compiled model, or of its parameters."""
    plant = campaign.plant
    if not isinstance(plant, MujocoPlant):
        return hashlib.sha256(repr(plant.parameters).encode()).hexdigest()
    buffer = np.zeros(mujoco.mj_sizeModel(plant.model), np.uint8)
    mujoco.mj_saveModel(plant.model, None, buffer)
    return hashlib.sha256(buffer.tobytes()).hexdigest()


def _configuration(campaign: Campaign) -> dict[str, Any]:
    """All that decides the results, but for code and model."""
    question = campaign.question
    return {
        "runs": question.runs,
        "seed": question.seed,
        "sampler": question.sampler,
        "shard": question.shard,
        "controllers": list(campaign.laws),
        "control_period": campaign.control_period,
        "duration": campaign.duration,
        "uncertain": {
            each.name: f"{each.distribution.words}; nominal {each.nominal:.17g}; unit {each.unit}"
            for each in campaign.family.quantities
        },
        "file": json.loads(json.dumps(campaign.experiment.document())),
    }


def _sources(question: Question) -> dict[str, str]:
    """SHA-256 of the user's own Python that the file names, by file."""
    folder, found = Path(question.folder), {}
    for _, value in _flat(question.file.model_dump(exclude_none=True)):
        if isinstance(value, str) and is_named(value):
            path = folder.joinpath(*value.split(":")[0].split(".")).with_suffix(".py")
            if path.is_file():
                name = path.relative_to(folder).as_posix()
                found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return dict(sorted(found.items()))


def _flat(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """The leaves of nested plain values, with the way to them."""
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from _flat(item, f"{key}.{name}" if key else str(name))
    elif isinstance(value, (list, tuple)):
        for index, item in enumerate(value):
            yield from _flat(item, f"{key} {index + 1}")
    else:
        yield key, value


def _hash(content: Any) -> str:
    """SHA-256 of plain values, whatever their order."""
    text = json.dumps(content, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()
