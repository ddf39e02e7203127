"""CONTRIBUTING's recipe for a new plant is complete: the files that it names are enough."""

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
IMPORT = "from grosmc_mj.theory.plants.spring_mass import SPRING_MASS"


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy the project with one more plant: the files of the recipe, and its name in SYSTEMS."""
    copy = tmp_path_factory.mktemp("project")
    for folder in ("grosmc_mj", "models"):
        shutil.copytree(ROOT / folder, copy / folder)
    shutil.copytree(PLANT, copy, dirs_exist_ok=True)

    # A user edits this file by hand; the test puts the two changes into whatever stands there.
    path = copy / "grosmc_mj" / "theory" / "plants" / "__init__.py"
    text = path.read_text(encoding="utf-8")
    text = text.replace("\nSYSTEMS:", f"{IMPORT}\n\nSYSTEMS:")
    text = text.replace("TWO_LINK_ARM)", "TWO_LINK_ARM, SPRING_MASS)")
    path.write_text(text, encoding="utf-8")
    return copy


def test_the_recipe_names_what_is_added() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    recipe = text.partition("### A plant")[2].partition("\n## ")[0]
    names = re.findall(r"`([\w./]+)`", recipe.replace("NAME", "spring_mass"))
    assert {"SYSTEMS", "grosmc_mj/theory/plants/__init__.py", "base.toml"} <= set(names)

    added = [path.relative_to(PLANT) for path in PLANT.rglob("*") if path.is_file()]
    for path in added:
        assert str(path) in names or f"{path.parent}/" in names, path


# Commands with words that they print; the second `validate` needs the record of the first.
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
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        try:
            cli.main(command.split())
        except SystemExit as stop:
            ends[command] = [stop.code, output.getvalue()]
print(json.dumps(ends))
"""


@pytest.fixture(scope="module")
def ends(project: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, str]]:
    """Run all commands in one process with that project; return their exit codes and output."""
    finished = subprocess.run(
        [sys.executable, "-c", PROGRAM, *COMMANDS],
        cwd=tmp_path_factory.mktemp("results"),
        env={**os.environ, "PYTHONPATH": str(project)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 0, finished.stderr
    return json.loads(finished.stdout)


# All that the copy of the package needs is compiled anew.
@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_knows_the_new_plant(command: str, ends: dict[str, tuple[int, str]]) -> None:
    code, output = ends[command]
    assert code == 0, output
    assert re.search(COMMANDS[command], output)
