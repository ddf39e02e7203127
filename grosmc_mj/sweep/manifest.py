"""manifest.json: all that decides a campaign's results, so that anybody can go on with it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.experiments.file.user_code import named_in, sources
from grosmc_mj.results.document import git_revision
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.specification import Specification
from grosmc_mj.versions import DECISIVE, versions

MANIFEST = "manifest.json"
# Of manifests and parts.
SCHEMA_VERSION = 3
# What the hash is of: where a case file lies does not decide.
_HASHED = ("configuration", "model", "sources", "versions")


def manifest_of(campaign: Campaign) -> dict[str, Any]:
    """The manifest of a campaign, as plain values."""
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
    }


def configuration_of(campaign: Campaign) -> dict[str, Any]:
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
            number.name: f"{number.distribution.words}; nominal {number.nominal:.17g}; "
            f"unit {number.unit}"
            for number in campaign.family.quantities
        },
        "file": json.loads(json.dumps(campaign.experiment.document())),
    }


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest in a folder, whose hash is that of its content.

    Raises:
        SetupError: If there is none, or another one.
    """
    path = folder / MANIFEST
    if not path.is_file():
        raise SetupError(f"{folder} is no campaign: it has no {MANIFEST}")
    content: dict[str, Any] = {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        kept = content["hash"] == _hash({key: content[key] for key in _HASHED})
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        kept = False
    if not kept or not isinstance(content.get("question"), dict):
        raise SetupError(
            f"{path} is damaged, or of another version of grosmc_mj: its hash is not that of its "
            "content; run the campaign again in another folder"
        )
    return content


def differences(there: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """What of two manifests decides their results and is not the same, a line each.

    Versions are left out, see ``outdated``; with others, the bytes of a model say nothing.
    """
    model = () if outdated(there, now) else ("model",)
    return _changed(there, now, ("configuration", *model, "sources"))


def refuse_other_code(folder: Path, there: Mapping[str, Any], specification: Specification) -> None:
    """Refuse Python that is not the recorded one, before any of it is imported.

    Args:
        folder: Of the campaign.
        there: Its manifest.
        specification: Whose case file would have it imported.

    Raises:
        ArgumentError: If a file is not the recorded one, or there are more or fewer.
    """
    if changed := _changed(there, {"sources": _sources(specification)}, ("sources",)):
        raise ArgumentError(f"{folder} was begun with other Python: {'; '.join(changed)}")


def outdated(there: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """The packages that have another version now, a line each: bits may differ."""
    return _changed(there, now, ("versions",))


def _changed(there: Mapping[str, Any], now: Mapping[str, Any], keys: Sequence[str]) -> list[str]:
    """The leaves under some keys that are not the same, a line each."""
    old, new = (dict(flat({key: side.get(key) for key in keys})) for side in (there, now))
    return [
        f"{key.removeprefix('configuration.')}: {old.get(key, 'nothing')} there, "
        f"{new.get(key, 'nothing')} now"
        for key in dict.fromkeys([*old, *new])
        if old.get(key) != new.get(key)
    ]


def _sources(specification: Specification) -> dict[str, str]:
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
