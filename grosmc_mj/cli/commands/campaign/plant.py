"""grosmc-mj campaign --plant."""

from __future__ import annotations

import shlex
from pathlib import Path

from grosmc_mj.cli import screen
from grosmc_mj.cli.exit_codes import DONE
from grosmc_mj.cli.streams import PROGRAM
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.files import atomic_write
from grosmc_mj.studies.campaign.folder import Folder
from grosmc_mj.studies.campaign.manifest import MANIFEST
from grosmc_mj.studies.campaign.opening import read_campaign
from grosmc_mj.studies.campaign.plant_file import case_text, find_plant


def write_plant(
    folder: Path,
    which: str,
    law: str | None,
    case_file: Path | None,
    out: Path | None,
) -> int:
    """Write the case file of one plant of a campaign, and say where it is and what takes it.

    Args:
        folder: The campaign's folder.
        which: Number of a run, or ``worst``, ``shrunk`` or ``outside``.
        law: The law that ran on the plant; the campaign's last one by default.
        case_file: The campaign's case file: the new one is written beside it and extends it.
        out: Where it is written otherwise; the campaign's folder by default.

    Returns:
        The exit code.

    Raises:
        GrosmcError: If there is no such plant, or the file cannot be written.
    """
    if case_file is not None and out is not None:
        raise ArgumentError(
            f"--out {out}: with --case-file the new file lies beside that one: leave --out out"
        )
    if not (folder / MANIFEST).is_file():
        place = out or "renders/campaigns/NAME"
        raise ArgumentError(
            f"--plant {which}: TARGET must be the folder of a campaign, which {folder} is not: "
            f"write {PROGRAM} campaign {shlex.quote(str(place))} --plant {which}"
        )
    campaign, notices = read_campaign(folder, case_file)
    for line in notices:
        screen.notice(line)

    plant = find_plant(campaign, Folder(folder), which, law)
    text = case_text(campaign, plant, case_file)
    place = out or folder
    if case_file is not None:
        place = case_file.parent
    path = place / plant.file_name(campaign.specification.name)
    _write(path, text)

    console = screen.console()
    console.print(f"{plant.words}: {campaign.words(plant.values)}", markup=False)
    screen.say_files(console, path)
    console.print(f"{PROGRAM} run {shlex.quote(str(path))}", markup=False, soft_wrap=True)
    return DONE


def _write(path: Path, text: str) -> None:
    """Write a file that is not there with another content.

    Raises:
        GrosmcError: If it is, or the file cannot be written.
    """
    content = text.encode()
    if path.is_file() and path.read_bytes() != content:
        raise ArgumentError(f"{path} is there already with other content: rename or remove it")
    with atomic_write(path) as part:
        part.write_bytes(content)
