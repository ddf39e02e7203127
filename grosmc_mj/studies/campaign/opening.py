"""The campaign that a folder describes: read to see its runs, or opened to add parts to it."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from grosmc_mj.experiments.file.reading import parse_case_file, read_case_file
from grosmc_mj.experiments.file.user_code import named_in
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.manifest import (
    differences,
    manifest_of,
    other_campaign,
    read_manifest,
    refuse_other_code,
)
from grosmc_mj.studies.campaign.specification import Specification

# User modules that this process has imported for campaigns: folder and hash of each.
_imported: dict[str, tuple[str, str]] = {}


def open_campaign(folder: str, specification: Specification, bound_to: str) -> Campaign:
    """Return the campaign of a specification, designed once in a process, to add parts to it.

    Args:
        folder: Folder of the campaign.
        specification: Its specification.
        bound_to: Hash of its manifest, which the folder's must have.

    Raises:
        GrosmcError: If the folder is of another campaign, or its runs would differ here.
    """
    # A worker may outlive a folder and meet another campaign under its name.
    if read_manifest(Path(folder))["hash"] != bound_to:
        raise ArgumentError(f"{folder} has another campaign than the one that was begun in it")
    return _opened(folder, specification, bound_to)


# A worker runs many parts of a campaign, and to design its laws takes seconds.
@lru_cache(maxsize=4)
def _opened(folder: str, specification: Specification, _bound_to: str) -> Campaign:
    manifest = read_manifest(Path(folder))
    campaign, other_versions = _built(Path(folder), manifest, specification)
    if other_versions:
        raise ArgumentError(f"{folder} was begun with other versions: {'; '.join(other_versions)}")
    return campaign


def read_campaign(folder: Path, case_file: Path | None = None) -> tuple[Campaign, list[str]]:
    """Return the campaign that a folder describes, to read its runs.

    The folder is data: no Python is imported but that beside the case file that the user names,
    and that only if it is the recorded one.

    Args:
        folder: Folder of the campaign.
        case_file: Where its case file is now, with the files that it names.

    Returns:
        The campaign, and a line about each package that has another version now.

    Raises:
        GrosmcError: If there is none, or its configuration cannot be had here.
    """
    manifest = read_manifest(folder)
    try:
        specification = Specification.of_document(manifest["question"])
    except ArgumentError as error:
        raise ArgumentError(f"{folder}: {error}; run the campaign again") from None
    if case_file is None:
        _refuse_code_of_folder(folder, specification)
    else:
        # The layout of a text does not decide: versions of this package lay it out otherwise.
        if parse_case_file(specification.text, case_file) != read_case_file(case_file):
            raise ArgumentError(
                f"{case_file} is not the case file of {folder}: its content is another"
            )
        specification = replace(specification, folder=str(case_file.parent.resolve()))
    campaign, other_versions = _built(folder, manifest, specification)
    return campaign, [f"{text}: bits may differ" for text in other_versions]


def _refuse_code_of_folder(folder: Path, specification: Specification) -> None:
    """Refuse a case file that would import Python from beside it."""
    modules = named_in(specification.file)
    if modules:
        raise ArgumentError(
            f"{folder}: its case file names Python, {', '.join(modules)}, and a folder's is not "
            "imported: give a case file of your own with the same text, beside which that lies, "
            "by --case-file"
        )


def _built(
    folder: Path, manifest: Mapping[str, Any], specification: Specification
) -> tuple[Campaign, list[str]]:
    """The campaign of a specification, if it is the manifest's, and packages of other versions."""
    refuse_other_code(folder, manifest, specification)
    _forget_other_modules(manifest["sources"], specification.folder)
    campaign = Campaign.of(specification)

    now = manifest_of(campaign)
    other = other_campaign(manifest, now)
    if other:
        raise ArgumentError(f"{folder} was begun with something else: {other}")
    return campaign, differences(manifest, now, "versions")


def _forget_other_modules(sources: Mapping[str, str], folder: str) -> None:
    """Have user modules imported anew that are not those of a campaign.

    A worker may have kept modules of these names from another campaign of its life.

    Args:
        sources: SHA-256 of the campaign's modules, by file.
        folder: Where they lie.
    """
    for file, content in sources.items():
        name = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        source = (folder, content)
        if _imported.setdefault(name, source) != source:
            sys.modules.pop(name, None)
            _imported[name] = source
