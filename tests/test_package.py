"""The package as a whole: its imports, its README, its records."""

from __future__ import annotations

import ast
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from commands import Patch, Screen, run
from shown_output import CLOSE

import grosmc_mj
from grosmc_mj import cli
from grosmc_mj.chapter.validation import cases_table, results_markdown
from grosmc_mj.cli.pages import write_text
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.ground.errors import SetupError
from grosmc_mj.output.films.film import Format

README = Path(__file__).parents[1] / "README.md"


def example(language: str, index: int = 0) -> str:
    """Return one of the README's blocks of a language, the first one by default."""
    text = README.read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)[index]


# Rows of the README's table, as the command calls them.
PREDICTED = {
    "upright after": "reaches [s]",
    "swings": "swings",
    "last peak": "last peak [rad]",
    "variation of the torque": "total variation [N m/s]",
}
COUNTED = re.compile(r"\d+(?:\.\d+)?")


@pytest.mark.slow
def test_the_readme_s_prediction_of_a_real_pendulum_runs_as_printed(
    tmp_path: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    """Its table is what the command prints; the log's numbers do not depend on the machine."""
    text = README.read_text(encoding="utf-8")
    (line,) = re.findall(r"^\.venv/bin/grosmc-mj (predict .*)$", text, re.MULTILINE)
    (tmp_path / "measured").symlink_to(README.parent / "measured")
    monkeypatch.chdir(tmp_path)
    # The last peak lies outside the spread.
    assert run(*shlex.split(line, comments=True)) == cli.DIFFERS
    printed = capsys.readouterr().out

    (rows,) = re.findall(r"^\| \| measured \| predicted, 16 seeds \|\n(.*?)\n\n", text, re.M | re.S)
    for row in rows.splitlines()[1:]:
        _, words, measured, predicted, _ = (cell.strip() for cell in row.split("|"))
        label = PREDICTED[words]
        (found,) = re.findall(rf"^{re.escape(label)} +(.*)$", printed, re.MULTILINE)
        of_log, _, least, most = COUNTED.findall(found)[:4]
        assert of_log == COUNTED.findall(measured)[0]
        spread = COUNTED.findall(predicted)
        shown = [float(spread[0]), float(spread[-1])]
        assert [float(least), float(most)] == pytest.approx(shown, rel=CLOSE)


@pytest.mark.slow
@pytest.mark.render
def test_the_readme_s_example_runs(tmp_path: Path, monkeypatch: Patch, capsys: Screen) -> None:
    monkeypatch.chdir(tmp_path)
    # A small film is quick to render.
    small = Format(width=320, height=240, fps=2, stop=1.0)
    monkeypatch.setattr("grosmc_mj.experiments.films.Format", lambda: small)
    exec(example("python"), {})

    first, *requirements, last = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"\S+ rad from the nominal optimum", first)
    assert requirements
    assert all(line.endswith(" kept") for line in requirements)
    assert last == "arm/case1 keeps all: True"
    assert (tmp_path / "fall.mp4").is_file()


def test_the_readme_s_lines_for_a_notebook_run(capsys: Screen) -> None:
    exec(example("python", 1), {"gm": grosmc_mj})
    rows = ast.literal_eval(capsys.readouterr().out)
    assert [set(row) for row in rows] == [{"deviation", "max_input", "kept"}] * 2
    assert rows[0]["deviation"] != rows[1]["deviation"]


@pytest.mark.slow
def test_the_readme_s_first_answer_is_real(
    monkeypatch: Patch, tmp_path: Path, capsys: Screen
) -> None:
    """Numbers of the README's first block, without the frame of the table."""
    monkeypatch.chdir(tmp_path)
    assert run("run", "cart_pendulum/case1") == 0
    printed = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    shown = [line for line in example("console").splitlines() if not line.startswith("$")]
    assert all(line in printed for line in shown)


def test_the_readme_s_example_file_is_kept(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(example("toml"), encoding="utf-8")
    assert all(judgement.kept for judgement in grosmc_mj.judge(tmp_path / "mine.toml"))


PAGE = """\
before
<!-- results -->
old
<!-- /results -->
after
"""


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    """Return the parts of a validation document that the README's table comes from."""
    experiment = find_experiment("servo", "case1")
    runs = [experiment.run(plant, "lqr") for plant in ("physics", "corrected")]
    return {"sheets": [{"table": cases_table(runs).model_dump(), "charts": []}]}


@pytest.fixture
def results(document: dict[str, Any], tmp_path: Path) -> Path:
    path = tmp_path / "validation.json"
    path.write_text(json.dumps(document))
    return path


def test_the_readme_s_table_has_a_row_for_each_run_in_physics(document: dict[str, Any]) -> None:
    rows = results_markdown(document).splitlines()
    assert len(rows) == 3
    assert rows[2].startswith("| servo | case1 | lqr | 1.42 rad | 3.99 s |  | 13.4 | ")


def test_the_readme_s_table_is_written_between_its_marks(
    document: dict[str, Any], results: Path, tmp_path: Path
) -> None:
    readme = tmp_path / "README.md"
    readme.write_text(PAGE)
    # The second time the table of the first is replaced.
    write_text("results", readme, results)
    write_text("results", readme, results)
    rows = results_markdown(document).splitlines()
    lines = ["before", "<!-- results -->", *rows, "<!-- /results -->", "after"]
    assert readme.read_text().splitlines() == lines


def test_a_page_without_marks_is_refused(results: Path, tmp_path: Path) -> None:
    readme = tmp_path / "README.md"
    readme.write_text("nothing here")
    with pytest.raises(SetupError, match="has no <!-- results -->"):
        write_text("results", readme, results)


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("grosmc_mj", ("mujoco", "numba", "scipy", "matplotlib")),
        ("grosmc_mj.cli", ("mujoco", "numba")),
    ],
)
def test_an_import_leaves_out_heavy_libraries(module: str, heavy: tuple[str, ...]) -> None:
    program = f"import sys, {module}; print([n for n in {heavy} if n in sys.modules])"
    command = [sys.executable, "-c", program]
    finished = subprocess.run(command, capture_output=True, text=True, check=True)
    assert finished.stdout.strip() == "[]"
