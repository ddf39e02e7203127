"""A folder is data: Python is imported from beside a case file that the user names."""

import json
import shutil
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from campaign_cases import DEVIATION, INERTIA, LQR, PUSH, begun, refusal, run, servo, specification
from case_texts import LEG_MODEL
from commands import Screen

from grosmc_mj import cli
from grosmc_mj.experiments.file.reading import read_case_file
from grosmc_mj.experiments.file.user_code import named_in, sources
from grosmc_mj.sweep.campaign import Campaign, Specification
from grosmc_mj.sweep.store import Folder, open_campaign, read_campaign, read_manifest, run_shard

BUMP = PUSH.replace("load", "bump") + 'profile = "canary_law:bump"\n'
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
TEXT = servo(BUMP + INERTIA, laws=LQR, limits=DEVIATION)


def forget() -> None:
    """Unload the modules, as in a new process."""
    for name in FILES:
        sys.modules.pop(name.removesuffix(".py"), None)


@pytest.fixture(autouse=True)
def _forgotten() -> Iterator[None]:
    yield
    forget()


def question(file: Path) -> Specification:
    return specification(file.read_text(), folder=str(file.parent), runs=2, shard=1)


def case_beside_python(folder: Path, height: float = 1.0) -> Path:
    folder.mkdir()
    (folder / "small.toml").write_text(TEXT)
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


def test_a_plant_imports_and_names_only_what_lies_beside_a_named_file(
    folder: Folder, file: Path, capsys: Screen
) -> None:
    assert list(read_manifest(folder.path)["sources"]) == list(FILES)
    line = refusal(read_campaign, folder.path)
    assert "its case file names Python, canary_law:bump" in line
    assert "--case-file" in line
    assert not file.with_name("trace").exists()
    plant = ("campaign", folder.path, "--plant", "0")
    assert run(*plant) == cli.WRONG
    assert "--case-file" in capsys.readouterr().err
    assert not file.with_name("trace").exists()
    assert run(*plant, "--case-file", file) == cli.DONE
    assert file.with_name("trace").exists()
    # The new file lies beside that one, where alone Python is imported from, and nowhere else.
    written = file.with_name("small_0_lqr.toml")
    assert named_in(read_case_file(written)) == named_in(read_case_file(file))
    assert not list(folder.path.rglob("*.toml"))
    line = f"--out {folder.path}: with --case-file the new file lies beside that one"
    assert run(*plant, "--case-file", file, "--out", folder.path) == cli.WRONG
    assert line in capsys.readouterr().err


def test_python_in_a_campaign_s_folder_is_never_imported(folder: Folder, file: Path) -> None:
    """Neither for the campaign, nor for a plant's file, nor by a run of that."""
    trap = folder.path / "trap"
    for name in FILES:
        (folder.path / name).write_text(f"open({str(trap)!r}, 'w')\n")
    assert run("campaign", folder.path, "--plant", "1", "--case-file", file) == cli.DONE
    written = file.with_name("small_1_lqr.toml")
    assert run("run", written, "--no-figures", "--out", folder.path / "runs") in RAN
    # A folder whose case file names no Python gets a file that names none, beside whatever lies
    # there.
    declared = Campaign.of(specification(servo(INERTIA, laws=LQR, limits=DEVIATION), runs=2))
    other = begun(declared, folder.path / "other")
    for name in FILES:
        (other.path / name).write_text(f"open({str(trap)!r}, 'w')\n")
    assert run("campaign", other.path, "--plant", "1") == cli.DONE
    written = other.path / "small_1_lqr.toml"
    assert named_in(read_case_file(written)) == []
    assert run("run", written, "--no-figures", "--out", folder.path / "runs") in RAN
    assert not trap.exists()


def test_laws_that_only_a_campaign_chose_are_python_too(file: Path, tmp_path: Path) -> None:
    """A manifest may choose a law of [laws], which no [[controller]] of its file runs."""
    text = servo(INERTIA, laws=LQR, limits=DEVIATION) + '[laws.mine]\nlaw = "canary_law:bump"\n'
    file.write_text(text)
    chosen = replace(question(file), controllers=("lqr", "mine"))
    declared = Campaign.of(
        replace(chosen, text=servo(INERTIA, laws=LQR, limits=DEVIATION), controllers=())
    )
    out = begun(declared, tmp_path / "chosen")
    manifest = read_manifest(out.path)
    manifest["question"] = chosen.document()
    (out.path / "manifest.json").write_text(json.dumps(manifest))
    assert "its case file names Python, canary_law:bump" in refusal(read_campaign, out.path)
    assert not file.with_name("trace").exists()


def test_a_folder_names_no_file_to_read_or_place_to_write(folder: Folder, tmp_path: Path) -> None:
    """A manifest may say anything: its text may extend nothing, and its name be no path."""
    for changed, words in (
        ({"text": f'extends = "/etc/passwd"\n{TEXT}'}, "unknown key 'extends'"),
        ({"text": f'extends = "small.toml"\n{TEXT}'}, "unknown key 'extends'"),
        ({"name": "../../up"}, "must be a name for files"),
    ):
        other = Folder(Path(shutil.copytree(folder.path, tmp_path / "other")))
        manifest = read_manifest(other.path)
        manifest["question"] |= changed
        (other.path / "manifest.json").write_text(json.dumps(manifest))
        assert words in refusal(read_campaign, other.path)
        shutil.rmtree(other.path)


def test_python_that_is_not_the_recorded_one_is_refused(
    folder: Folder, file: Path, capsys: Screen
) -> None:
    bound_to, path = read_manifest(folder.path)["hash"], file.with_name("canary_helper.py")
    path.write_text("HEIGHT = 1.0  # changed\n")
    words = "was begun with other Python: sources.canary_helper.py: "
    again = ("campaign", file, "--runs", "2", "--shard", "1", "--out", folder.path, "--resume")
    assert run(*again, "--no-figures") == cli.WRONG
    assert words in capsys.readouterr().err
    assert words in refusal(read_campaign, folder.path, file)
    assert "other Python" in refusal(run_shard, str(folder.path), question(file), bound_to, 1)
    path.write_text("HEIGHT = 1.0\n")
    file.write_text(TEXT.replace('duration = "', 'duration = "1'))
    line = refusal(read_campaign, folder.path, file)
    assert f"{file} is not the case file of" in line
    assert "its content is another" in line
    # A worker builds its own campaign: all of a folder may be another's, but where it is built.
    declared = Campaign.of(specification(servo(INERTIA, laws=LQR, limits=DEVIATION), runs=2))
    other = begun(declared, folder.path / "other")
    manifest = read_manifest(other.path)
    manifest["question"] |= {"text": TEXT, "folder": str(file.parent)}
    (other.path / "manifest.json").write_text(json.dumps(manifest))
    run_shard(str(other.path), declared.specification, manifest["hash"], 0)
    assert (folder.part(1).exists(), other.part(0).exists()) == (False, True)
    assert not file.with_name("trace").exists()


MODEL_CASE = """
plant = { model = "leg.xml" }
run = { duration = "0.02 s", start = { hip = "0.1 rad" } }
task = { Q = [1, 1, 1, 1], R = 1 }
[[controller]]
law = "lqr"
[[requirement]]
input_below = "100 N m"
[[uncertain]]
body = "thigh"
mass_scale = [1, 2]
"""


def test_a_model_is_read_from_where_it_was_or_from_beside_the_case_file(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    file = tmp_path / "there" / "leg.toml"
    file.write_text(MODEL_CASE)
    file.with_suffix(".xml").write_text(LEG_MODEL)
    out = begun(Campaign.load(str(file), runs=1), tmp_path / "out").path
    read_campaign(out)
    moved = Path(shutil.move(tmp_path / "there", tmp_path / "moved"))
    assert "leg.xml" in refusal(read_campaign, out)
    read_campaign(out, moved / "leg.toml")
    (moved / "leg.xml").write_text(LEG_MODEL.replace('mass="1"', 'mass="2"'))
    assert "with something else: model: " in refusal(read_campaign, out, moved / "leg.toml")


def test_modules_of_two_folders_do_not_mix_in_one_worker(tmp_path: Path) -> None:
    """A worker of a cluster outlives campaigns; another has helpers of the same names."""
    for height in (1.0, 3.0):
        file = case_beside_python(tmp_path / str(height), height)
        out = begun(Campaign.of(question(file)), tmp_path / f"out {height}").path
        opened = open_campaign(str(out), question(file), read_manifest(out)["hash"])
        (bump,) = (of for of in opened.experiment.case.disturbances if of.label == "bump")
        assert bump.profile(0.1) == height


def test_sources_follow_imports_as_python_would(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("import b, os\ndef f():\n    from c import d\n")
    (tmp_path / "b.py").write_text("import a\n")
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "d.py").write_text("import numpy\nfrom .. import a\n")
    (tmp_path / "broken.py").write_text("def\n")
    assert list(sources(["a:f", "not a name", "missing:f"], tmp_path)) == ["a.py", "b.py", "c/d.py"]
    assert list(sources(["broken:f"], tmp_path)) == ["broken.py"]
    assert sources(["json:loads"], tmp_path) == {}
