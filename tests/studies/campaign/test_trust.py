"""A folder is data: Python is imported from beside a case file that the user names."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cases
import mjcf
import pytest
from campaigns import (
    MASS,
    begun,
    deviation_below,
    part,
    refusal,
    specification,
    uncertain,
)
from commands import Screen, run

from grosmc_mj import cli
from grosmc_mj.experiments.file.reading import read_case_file
from grosmc_mj.experiments.file.user_code import named_in, sources
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.folder import Folder
from grosmc_mj.studies.campaign.manifest import read_manifest
from grosmc_mj.studies.campaign.opening import open_campaign, read_campaign
from grosmc_mj.studies.campaign.specification import Specification
from grosmc_mj.studies.campaign.work import run_part

# Modules beside the case file, of which the last leaves a trace when it is imported.
FILES = {
    "canary_helper.py": "HEIGHT = {height}\n",
    "canary_law.py": """
from pathlib import Path
from canary_helper import HEIGHT
Path({trace!r}).touch()
def bump(t):
    return HEIGHT if t > 0.02 else 0.0
""",
}
# A run that is judged, whatever the verdict.
RAN = (cli.DONE, cli.DIFFERS)


def bumped(**tables: Any) -> str:
    """A servo under LQR, and a load by a profile in Python."""
    load = {"body": "rotor", "torque": ["0 N m", "1 N m", "0 N m"], "label": "bump"}
    bump = {**load, "profile": "canary_law:bump"}
    return part(MASS, disturbance=bump, requirement=deviation_below("3 mrad"), **tables)


# A case file that names no Python.
PLAIN = part(MASS, requirement=deviation_below("3 mrad"))


def forget() -> None:
    """Unload the modules, as in a new process."""
    for name in FILES:
        sys.modules.pop(name.removesuffix(".py"), None)


@pytest.fixture(autouse=True)
def _forgotten() -> Iterator[None]:
    yield
    forget()


def question(file: Path) -> Specification:
    """The specification of two runs of a case file, in two parts."""
    return specification(file.read_text(), folder=str(file.parent), runs=2, shard=1)


def case_beside_python(folder: Path, height: float = 1.0) -> Path:
    """Write a case file and the Python that it names into a new folder."""
    folder.mkdir()
    (folder / "small.toml").write_text(bumped())
    for name, content in FILES.items():
        text = content.format(trace=str(folder / "trace"), height=height)
        (folder / name).write_text(text)
    return folder / "small.toml"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A case file with Python beside it."""
    return case_beside_python(tmp_path / "case")


@pytest.fixture
def folder(file: Path, tmp_path: Path) -> Folder:
    """The manifest of its campaign, of two runs in two parts; nothing is imported yet."""
    out = begun(Campaign.of(question(file)), tmp_path / "out")
    file.with_name("trace").unlink()
    forget()
    return out


def was_imported(file: Path) -> bool:
    """Whether Python beside a case file was imported."""
    return file.with_name("trace").exists()


def set_traps(folder: Path, trap: Path) -> None:
    """Write modules of the same names that leave a trace when they are imported."""
    for name in FILES:
        (folder / name).write_text(f"open({str(trap)!r}, 'w')\n")


def change_question(folder: Path, changed: dict[str, Any]) -> None:
    """Write other values into the specification of a manifest, whose hash has none of it."""
    manifest = read_manifest(folder)
    manifest["question"] |= changed
    (folder / "manifest.json").write_text(json.dumps(manifest))


# Reading a campaign, and files of its plants.


def test_reading_a_campaign_imports_nothing(folder: Folder, file: Path) -> None:
    assert list(read_manifest(folder.path)["sources"]) == list(FILES)
    line = refusal(read_campaign, folder.path)
    assert "its case file names Python, canary_law:bump" in line
    assert "--case-file" in line
    assert not was_imported(file)


def test_a_plant_s_file_needs_the_case_file_beside_the_python(
    folder: Folder, file: Path, capsys: Screen
) -> None:
    assert run("campaign", folder.path, "--plant", "0") == cli.WRONG
    assert "--case-file" in capsys.readouterr().err
    assert not was_imported(file)


def test_plant_is_told_which_folder_it_needs(tmp_path: Path, capsys: Screen) -> None:
    code = run("campaign", "servo/case1", "--out", tmp_path, "--plant", "worst")
    assert code == cli.WRONG
    error = capsys.readouterr().err
    assert "TARGET must be the folder of a campaign, which servo/case1 is not" in error
    assert f"campaign {tmp_path} --plant worst" in error


def test_a_plant_s_file_lies_beside_the_named_one_and_nowhere_else(
    folder: Folder, file: Path, capsys: Screen
) -> None:
    plant = ("campaign", folder.path, "--plant", "0", "--case-file", file)
    assert run(*plant, "--out", folder.path) == cli.WRONG
    line = f"--out {folder.path}: with --case-file the new file lies beside that one: leave"
    assert line in capsys.readouterr().err

    assert run(*plant) == cli.DONE
    assert was_imported(file)
    written = file.with_name("small_0_lqr.toml")
    assert named_in(read_case_file(written)) == named_in(read_case_file(file))
    assert not list(folder.path.rglob("*.toml"))


def test_python_in_a_campaign_s_folder_is_never_imported(folder: Folder, file: Path) -> None:
    """Neither for the campaign, nor for a plant's file, nor by a run of that."""
    trap = folder.path / "trap"
    set_traps(folder.path, trap)
    assert run("campaign", folder.path, "--plant", "1", "--case-file", file) == cli.DONE
    written = file.with_name("small_1_lqr.toml")
    assert run("run", written, "--no-figures", "--out", folder.path / "runs") in RAN
    assert not trap.exists()


def test_a_file_in_a_campaign_s_folder_names_no_python(tmp_path: Path) -> None:
    """Whatever lies beside it."""
    trap = tmp_path / "trap"
    folder = begun(Campaign.of(specification(PLAIN, runs=2)), tmp_path / "plain")
    set_traps(folder.path, trap)
    assert run("campaign", folder.path, "--plant", "1") == cli.DONE
    written = folder.path / "small_1_lqr.toml"
    assert named_in(read_case_file(written)) == []
    assert run("run", written, "--no-figures", "--out", tmp_path / "runs") in RAN
    assert not trap.exists()


def test_laws_that_only_a_campaign_chose_are_python_too(file: Path, tmp_path: Path) -> None:
    """A manifest may choose a law of [laws], which no [[controller]] of its file runs."""
    mine = {"mine": {"law": "canary_law:bump"}}
    text = cases.text(controller={"law": "lqr"}, uncertain=MASS, laws=mine)
    file.write_text(text)
    chosen = replace(question(file), controllers=("lqr", "mine"))
    declared = Campaign.of(replace(chosen, text=PLAIN, controllers=()))
    out = begun(declared, tmp_path / "chosen")
    change_question(out.path, chosen.document())
    assert "its case file names Python, canary_law:bump" in refusal(read_campaign, out.path)
    assert not was_imported(file)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"text": f'extends = "/etc/passwd"\n{bumped()}'}, "unknown key 'extends'"),
        ({"text": f'extends = "small.toml"\n{bumped()}'}, "unknown key 'extends'"),
        ({"name": "../../up"}, "must be a name for files"),
    ],
)
def test_a_folder_names_no_file_to_read_or_place_to_write(
    changed: dict[str, Any], words: str, folder: Folder
) -> None:
    """A manifest may say anything: its text may extend nothing, and its name be no path."""
    change_question(folder.path, changed)
    assert words in refusal(read_campaign, folder.path)


# Other Python, another case file, another model.


@pytest.fixture
def changed_python(folder: Folder, file: Path) -> Folder:
    """The folder of a campaign, beside whose case file a module has changed."""
    file.with_name("canary_helper.py").write_text("HEIGHT = 1.0  # changed\n")
    return folder


OTHER_PYTHON = "was begun with other Python: sources.canary_helper.py: "


def test_a_campaign_does_not_go_on_with_other_python(
    changed_python: Folder, file: Path, capsys: Screen
) -> None:
    resumed = ("campaign", file, "--runs", "2", "--shard", "1", "--resume", "--no-figures")
    assert run(*resumed, "--out", changed_python.path) == cli.WRONG
    assert OTHER_PYTHON in capsys.readouterr().err
    assert not was_imported(file)


def test_a_campaign_is_not_read_and_a_worker_does_not_run_with_other_python(
    changed_python: Folder, file: Path
) -> None:
    path = changed_python.path
    assert OTHER_PYTHON in refusal(read_campaign, path, file)
    bound_to = read_manifest(path)["hash"]
    assert "other Python" in refusal(run_part, str(path), question(file), bound_to, 1)
    assert not was_imported(file)


def test_another_case_file_is_refused(folder: Folder, file: Path) -> None:
    file.write_text(bumped(run={"duration": "10 s"}))
    line = refusal(read_campaign, folder.path, file)
    assert f"{file} is not the case file of" in line
    assert "its content is another" in line
    assert not was_imported(file)


def test_a_worker_builds_its_own_campaign(folder: Folder, file: Path) -> None:
    """All of a folder may be another's, but where it is built."""
    declared = Campaign.of(specification(PLAIN, runs=2))
    other = begun(declared, folder.path / "other")
    change_question(other.path, {"text": bumped(), "folder": str(file.parent)})
    bound_to = read_manifest(other.path)["hash"]
    run_part(str(other.path), declared.specification, bound_to, 0)
    assert other.part(0).exists()
    assert not folder.part(1).exists()
    assert not was_imported(file)


def robot(mass: int) -> str:
    """A model of one link."""
    return mjcf.ONE.format(f' armature="{mass}"', '<motor name="drive" joint="hinge"/>')


@pytest.fixture
def moved(tmp_path: Path) -> tuple[Path, Path]:
    """The folder of a campaign on a robot, and its case file, which was moved with its model."""
    there = tmp_path / "there"
    there.mkdir()
    (there / "one.xml").write_text(robot(1))
    file = cases.write(
        there,
        "one.xml",
        run={"start": {"hinge": "0.1 rad"}},
        task={"Q": [1, 1], "R": 1},
        requirement={"input_below": "100 N m"},
        uncertain=uncertain("edit.link.mass_scale", 1, 2),
    )
    folder = begun(Campaign.load(str(file), runs=1), tmp_path / "out").path
    read_campaign(folder)
    return folder, Path(shutil.move(there, tmp_path / "moved")) / file.name


def test_a_model_is_read_from_beside_the_case_file(moved: tuple[Path, Path]) -> None:
    folder, file = moved
    assert "one.xml" in refusal(read_campaign, folder)
    read_campaign(folder, file)


def test_another_model_is_refused(moved: tuple[Path, Path]) -> None:
    folder, file = moved
    file.with_name("one.xml").write_text(robot(2))
    assert "with something else: model: " in refusal(read_campaign, folder, file)


def height_of_bump(folder: Path, height: float) -> float:
    """The height of a bump that a worker reads from a module beside the case file."""
    file = case_beside_python(folder / str(height), height)
    out = begun(Campaign.of(question(file)), folder / f"out {height}").path
    opened = open_campaign(str(out), question(file), read_manifest(out)["hash"])
    profiles = {load.label: load.profile for load in opened.experiment.disturbances}
    return profiles["bump"](0.1)


def test_modules_of_two_folders_do_not_mix_in_one_worker(tmp_path: Path) -> None:
    """A worker of a cluster outlives campaigns; another has helpers of the same names."""
    assert height_of_bump(tmp_path, 1.0) == 1.0
    assert height_of_bump(tmp_path, 3.0) == 3.0


@pytest.mark.parametrize(
    ("names", "files"),
    [
        (["a:f", "not a name", "missing:f"], ["a.py", "b.py", "c/d.py"]),
        (["broken:f"], ["broken.py"]),
        (["json:loads"], []),
    ],
)
def test_sources_follow_imports_as_python_would(
    names: list[str], files: list[str], tmp_path: Path
) -> None:
    (tmp_path / "a.py").write_text("import b, os\ndef f():\n    from c import d\n")
    (tmp_path / "b.py").write_text("import a\n")
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "d.py").write_text("import numpy\nfrom .. import a\n")
    (tmp_path / "broken.py").write_text("def\n")
    assert list(sources(names, tmp_path)) == files
