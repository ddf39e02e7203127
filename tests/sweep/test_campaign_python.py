"""A folder is data: Python is imported from beside a case file that the user names."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from campaign_cases import DEVIATION, LQR, begun, servo, specification

from grosmc_mj import cli
from grosmc_mj.errors import GrosmcError
from grosmc_mj.experiments.file.user_code import sources
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.store import (
    _HASHED,
    Folder,
    _hash,
    _sources,
    manifest_of,
    open_campaign,
    read_campaign,
    read_manifest,
    run_shard,
)

# Of a module beside the case file, which leaves a trace when it is imported.
CANARY = """
from pathlib import Path
from canary_helper import HEIGHT
import canary_package.deep
Path({trace!r}).touch()
def bump(t):
    return HEIGHT if t > 0.02 else 0.0
"""
BUMP = """
[[disturbance]]
body = "rotor"
torque = ["0 N m", "1 N m", "0 N m"]
profile = "canary_law:bump"
label = "bump"
"""
INERTIA = """
[[uncertain]]
body = "rotor"
mass_scale = [1, 3]
"""
MODULES = ("canary_law", "canary_helper", "canary_package", "canary_package.deep")


@pytest.fixture(autouse=True)
def _forgotten() -> Iterator[None]:
    """No test has another's modules."""
    yield
    for name in MODULES:
        sys.modules.pop(name, None)


@pytest.fixture
def trace(tmp_path: Path) -> Path:
    """A file that is there once the module was imported."""
    return tmp_path / "imported"


@pytest.fixture
def file(tmp_path: Path, trace: Path) -> Path:
    """A case file with Python beside it."""
    folder = tmp_path / "case"
    (folder / "canary_package").mkdir(parents=True)
    (folder / "canary_law.py").write_text(CANARY.format(trace=str(trace)))
    (folder / "canary_helper.py").write_text("HEIGHT = 1.0\n")
    (folder / "canary_package" / "__init__.py").write_text("from . import sibling\n")
    (folder / "canary_package" / "deep.py").write_text("from .sibling import NOTHING\n")
    (folder / "canary_package" / "sibling.py").write_text("NOTHING = 0\n")
    (folder / "not_imported.py").write_text("import canary_law\n")
    path = folder / "small.toml"
    path.write_text(servo(BUMP + INERTIA, laws=LQR, limits=DEVIATION))
    return path


@pytest.fixture
def folder(file: Path, trace: Path, tmp_path: Path) -> Folder:
    """Its campaign, of two runs in two parts; nothing has been imported when it is given out."""
    assert run("campaign", file, *SIZE, "--out", tmp_path / "out", "--no-figures") == cli.DONE
    trace.unlink()
    for name in MODULES:
        sys.modules.pop(name, None)
    open_campaign.__globals__["_opened"].cache_clear()
    return Folder(tmp_path / "out")


SIZE = ("--runs", "2", "--shard", "1")


def run(*arguments: str | Path) -> int:
    """Exit code of the command line."""
    with pytest.raises(SystemExit) as stop:
        cli.main([str(each) for each in arguments])
    assert isinstance(stop.value.code, int)
    return stop.value.code


def refused(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line on standard error."""
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    return line


def test_what_would_be_imported_is_recorded_with_all_that_it_imports(folder: Folder) -> None:
    assert list(read_manifest(folder.path)["sources"]) == [
        "canary_helper.py",
        "canary_law.py",
        "canary_package/__init__.py",
        "canary_package/deep.py",
        "canary_package/sibling.py",
    ]


def test_a_replay_imports_nothing_of_its_own(
    folder: Folder, file: Path, trace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert run("campaign", folder.path, "--replay", "0", "--no-figures") == cli.WRONG
    line = refused(capsys)
    assert "its case file names Python, canary_law:bump" in line
    assert "--case-file" in line
    assert not trace.exists()
    with_it = ("campaign", folder.path, "--replay", "0", "--no-figures", "--case-file", file)
    assert run(*with_it) == cli.DONE
    assert trace.exists()


@pytest.mark.parametrize("changed", ["canary_law.py", "canary_helper.py", "canary_package/deep.py"])
def test_python_that_is_not_the_recorded_one_is_not_imported(
    folder: Folder, file: Path, trace: Path, changed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = file.parent / changed
    path.write_text(f"{path.read_text()}# changed\n")
    folder.part(1).unlink()
    (folder.path / "results.json").unlink()
    capsys.readouterr()
    again = ("campaign", file, *SIZE, "--out", folder.path, "--resume", "--no-figures")
    for arguments in (("campaign", folder.path, "--replay", "0", "--case-file", file), again):
        assert run(*arguments) == cli.WRONG
        assert f"was begun with other Python: sources.{changed}: " in refused(capsys)
    manifest = read_manifest(folder.path)
    asked = specification(file.read_text(), folder=str(file.parent), runs=2, shard=1)
    with pytest.raises(GrosmcError, match="other Python"):
        run_shard(str(folder.path), asked, manifest["hash"], 1)
    assert not trace.exists()
    assert not folder.part(1).exists()


def test_a_case_file_of_another_text_is_refused(folder: Folder, file: Path, trace: Path) -> None:
    file.write_text(file.read_text().replace('duration = "', 'duration = "1'))
    with pytest.raises(GrosmcError, match=r"is not the case file of .*: its text is another"):
        read_campaign(folder.path, file)
    assert not trace.exists()


def with_question(there: Folder, **content: Any) -> str:
    """Somebody changes what a manifest asks for; returns the manifest's hash."""
    path = there.path / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["question"] = {**manifest["question"], **content}
    path.write_text(json.dumps(manifest))
    return manifest["hash"]


def test_a_worker_builds_what_it_was_given_and_not_what_the_folder_says(
    file: Path, trace: Path, tmp_path: Path
) -> None:
    asked = Campaign.of(specification(servo(INERTIA, laws=LQR, limits=DEVIATION), runs=2))
    folder = begun(asked, tmp_path / "out")
    # All of it is the campaign's own but where it would be built from.
    foreign = {"text": file.read_text(), "folder": str(file.parent)}
    bound_to = with_question(folder, **foreign)
    run_shard(str(folder.path), asked.specification, bound_to, 0)
    assert not trace.exists()
    assert folder.part(0).exists()
    # One that is bound to itself is another campaign.
    manifest = json.loads((folder.path / "manifest.json").read_text())
    manifest["sources"] = _sources(specification(**foreign))
    manifest["hash"] = _hash({key: manifest[key] for key in _HASHED})
    (folder.path / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(GrosmcError, match="another campaign than the one that was begun"):
        run_shard(str(folder.path), asked.specification, bound_to, 1)
    assert not trace.exists()


def test_a_model_is_read_from_where_it_was_or_from_beside_the_case_file(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    case = tmp_path / "there" / "arm.toml"
    case.write_text(MODEL_CASE)
    (case.parent / "arm.xml").write_text(MODEL)
    asked = ("campaign", case, "--runs", "1", "--out", tmp_path / "out", "--no-figures")
    assert run(*asked) == cli.DONE
    replayed = ("campaign", tmp_path / "out", "--replay", "0", "--no-figures")
    assert run(*replayed) == cli.DONE
    moved = shutil.move(tmp_path / "there", tmp_path / "moved")
    assert run(*replayed) == cli.WRONG
    assert run(*replayed, "--case-file", Path(moved) / "arm.toml") == cli.DONE


MODEL = """<mujoco model="link"><worldbody><body name="link"><joint name="pivot" axis="0 1 0"/>
<geom name="rod" type="capsule" fromto="0 0 0 0 0 -0.5" size="0.02" mass="1"/></body></worldbody>
<actuator><motor name="motor" joint="pivot"/></actuator></mujoco>"""
MODEL_CASE = """
[plant]
model = "arm.xml"
[run]
duration = "0.02 s"
start = { pivot = "0.1 rad" }
[task]
Q = [1, 1]
R = 1
[[controller]]
law = "lqr"
[[requirement]]
input_below = "100 N m"
[[uncertain]]
body = "link"
mass_scale = [1, 2]
"""


def test_modules_of_two_folders_do_not_mix_in_one_worker(tmp_path: Path) -> None:
    """A worker of a cluster outlives campaigns; another has helpers of the same names."""
    found = []
    for height in ("1.0", "3.0"):
        place = tmp_path / height
        place.mkdir()
        (place / "canary_law.py").write_text(
            "from canary_helper import HEIGHT\ndef bump(t):\n    return HEIGHT\n"
        )
        (place / "canary_helper.py").write_text(f"HEIGHT = {height}\n")
        text = servo(BUMP + INERTIA, laws=LQR, limits=DEVIATION)
        asked = specification(text, folder=str(place), runs=1, shard=1)
        manifest = manifest_of(Campaign.of(asked))
        out = Folder(tmp_path / f"out {height}")
        out.path.mkdir()
        (out.path / "manifest.json").write_text(json.dumps(manifest))
        opened = open_campaign(str(out.path), asked, manifest["hash"])
        (bump,) = (each for each in opened.experiment.case.disturbances if each.label == "bump")
        found.append(bump.profile(0.0))
    assert found == [1.0, 3.0]


def test_sources_follow_imports_as_python_would(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("import b, os\ndef f():\n    from c import d\n")
    (tmp_path / "b.py").write_text("import a\n")
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "d.py").write_text("import numpy\nfrom .. import a\n")
    (tmp_path / "broken.py").write_text("def\n")
    assert list(sources(["a:f", "not a name", "missing:f"], tmp_path)) == ["a.py", "b.py", "c/d.py"]
    assert list(sources(["broken:f"], tmp_path)) == ["broken.py"]
    assert sources(["json:loads"], tmp_path) == {}
