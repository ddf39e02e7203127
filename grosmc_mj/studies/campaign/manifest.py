"""Manifest of a campaign: all that decides its results, and differences of two of them."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from grosmc_mj.experiments.file.user_code import named_in, sources
from grosmc_mj.ground.errors import ArgumentError, SetupError
from grosmc_mj.ground.versions import DECISIVE, versions
from grosmc_mj.output.results.document import git_revision, machine_words
from grosmc_mj.output.results.result import Result, result
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.specification import Specification

MANIFEST = "manifest.json"
# Version of manifests and parts.
SCHEMA_VERSION = 3
# Keys of a manifest that its hash is of: the place of a case file does not decide.
_HASHED = ("configuration", "model", "sources", "versions")


def manifest_of(campaign: Campaign) -> dict[str, Any]:
    """Return the manifest of a campaign, as plain values."""
    content = {
        "configuration": configuration_of(campaign),
        # SHA-256 of the plant without uncertainty: of its compiled model, or of its parameters.
        "model": campaign.plant.digest,
        "sources": _sources(campaign.specification),
        "versions": versions(DECISIVE),
    }
    return {
        "schema_version": SCHEMA_VERSION,
        "hash": _hash(content),
        **content,
        "question": campaign.specification.document(),
        "git_revision": git_revision(),
        "machine": machine_words(),
        "random": campaign.random,
    }


def configuration_of(campaign: Campaign) -> dict[str, Any]:
    """Return all that decides the results, but for code and model."""
    specification = campaign.specification
    uncertain = {
        number.name: f"{number.distribution.words}; nominal {number.nominal:.17g}; "
        f"unit {number.unit}"
        for number in campaign.family.quantities
    }
    configuration = {
        "runs": specification.runs,
        "seed": specification.seed,
        "sampler": specification.sampler,
        "shard": specification.shard,
    }
    if specification.screen != "none":
        configuration["screen"] = specification.screen
    return {
        **configuration,
        "controllers": list(campaign.laws),
        "control_period": campaign.experiment.settings.control_period,
        "duration": campaign.duration,
        "uncertain": uncertain,
        # As it is read back: tuples are lists.
        "file": json.loads(json.dumps(campaign.experiment.document())),
    }


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the manifest in a folder, whose hash must be that of its content.

    Raises:
        SetupError: If there is none, or its hash is another one.
    """
    path = folder / MANIFEST
    if not path.is_file():
        raise SetupError(f"{folder} is no campaign: it has no {MANIFEST}")

    with contextlib.suppress(OSError, ValueError, LookupError, TypeError, RecursionError):
        content = json.loads(path.read_text(encoding="utf-8"))
        same = content["hash"] == _hash({key: content[key] for key in _HASHED})
        if same and isinstance(content["question"], dict):
            return content
    raise SetupError(
        f"{path} is damaged, or of another version of grosmc_mj: its hash is not that of its "
        "content; run the campaign again in another folder"
    )


def _hash(content: Mapping[str, Any]) -> str:
    """SHA-256 of plain values, independent of their order."""
    versioned = {"schema_version": SCHEMA_VERSION, **content}
    text = json.dumps(versioned, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _sources(specification: Specification) -> dict[str, str]:
    """SHA-256 of the user's own Python that the case file would import, by file."""
    return sources(named_in(specification.file), Path(specification.folder))


def differences(recorded: Mapping[str, Any], now: Mapping[str, Any], *keys: str) -> list[str]:
    """Return a text for each leaf under some keys that two manifests do not share."""
    old = dict(leaves({key: recorded.get(key) for key in keys}))
    new = dict(leaves({key: now.get(key) for key in keys}))

    texts: list[str] = []
    for key in {**old, **new}:
        if old.get(key) != new.get(key):
            before = old.get(key, "nothing")
            after = new.get(key, "nothing")
            name = key.removeprefix("configuration.")
            texts.append(f"{name}: {before} there, {after} now")
    return texts


def leaves(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the leaves of nested plain values, each with its path."""
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from leaves(item, f"{key}.{name}" if key else str(name))
    elif isinstance(value, (list, tuple)):
        for index, item in enumerate(value):
            yield from leaves(item, f"{key} {index + 1}")
    else:
        yield key, value


def refuse_other_code(
    folder: Path, manifest: Mapping[str, Any], specification: Specification
) -> None:
    """Refuse Python that is not the recorded one, before any of it is imported.

    Args:
        folder: Folder of the campaign.
        manifest: Its manifest.
        specification: Specification whose case file would have it imported.

    Raises:
        ArgumentError: If a file is not the recorded one, or there are more or fewer.
    """
    other = differences(manifest, {"sources": _sources(specification)}, "sources")
    if other:
        raise ArgumentError(f"{folder} was begun with other Python: {'; '.join(other)}")


def other_campaign(recorded: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Return differences of two manifests, but for versions; empty if of one campaign."""
    keys = ["configuration", "model", "sources"]
    if differences(recorded, now, "versions"):
        # Other versions may compile the same model into other bytes.
        keys.remove("model")
    return "; ".join(differences(recorded, now, *keys))


def result_of(campaign: Campaign, kind: str, **fields: Any) -> Result:
    """Return a result of a campaign, with its configuration and seed."""
    return result(kind, configuration_of(campaign), seed=campaign.specification.seed, **fields)
