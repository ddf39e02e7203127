"""CONTRIBUTING's recipe for a new plant is complete: what it names is all that a plant needs."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PLANT = ROOT / "tests" / "data" / "new_plant"


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project with one more plant: the files of the recipe, and its name in SYSTEMS."""
    copy = tmp_path_factory.mktemp("project")
    for folder in ("grosmc_mj", "models"):
        shutil.copytree(ROOT / folder, copy / folder)
    shutil.copytree(PLANT, copy, dirs_exist_ok=True)
    listed = copy / "grosmc_mj" / "plants" / "__init__.py"
    text = listed.read_text(encoding="utf-8")
    text = text.replace(
        "\nSYSTEMS:", "from grosmc_mj.plants.spring_mass import SPRING_MASS\n\nSYSTEMS:"
    )
    listed.write_text(text.replace("TWO_LINK_ARM)", "TWO_LINK_ARM, SPRING_MASS)"), encoding="utf-8")
    return copy


def test_the_recipe_names_what_is_added() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    recipe = text.partition("## A new plant")[2].partition("\n## ")[0]
    named = {name.replace("NAME", "spring_mass") for name in re.findall(r"`([\w./]+)`", recipe)}
    added = [path.relative_to(PLANT) for path in PLANT.rglob("*") if path.is_file()]
    for path in added:
        assert {str(path), f"{path.parent}/"} & named, path
    assert {"SYSTEMS", "grosmc_mj/plants/__init__.py", "base.toml"} <= named


# What its commands begin with; the last but one needs what the one before has recorded.
COMMANDS = {
    "list": "5 systems",
    "run spring_mass/case1 --no-figures": "The requirement is kept",
    "validate spring_mass --no-figures --record": "recorded",
    "validate spring_mass --no-figures": "All 4 runs are as recorded",
    "claims premises spring_mass/case1": "premises of grosmc",
}
PROGRAM = """
import contextlib, io, json, sys
from grosmc_mj import cli

ends = {}
for command in sys.argv[1:]:
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            cli.main(command.split())
        except SystemExit as stop:
            ends[command] = [stop.code, said.getvalue()]
print(json.dumps(ends))
"""


def test_a_new_plant_is_run_compared_and_audited(project: Path, tmp_path: Path) -> None:
    """All commands, one after another in a process with that project."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *COMMANDS], cwd=tmp_path, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": str(project)}, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    ends = json.loads(done.stdout)
    assert list(ends) == list(COMMANDS)
    for command, (code, words) in ends.items():
        assert code == 0, words
        assert re.search(COMMANDS[command], words)
