"""The package as a whole: its imports, its README, its records."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import grosmc_mj
from grosmc_mj.chapter.validation import results_markdown, results_table
from grosmc_mj.cli.pages import write_text
from grosmc_mj.errors import SetupError
from grosmc_mj.experiments.catalogue import select_experiments
from grosmc_mj.films.film import Format

README = Path(__file__).parents[1] / "README.md"


def example(language: str) -> str:
    """The README's first block of a language."""
    text = README.read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)[0]


@pytest.mark.slow
@pytest.mark.render
def test_the_readme_s_example_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    # The film is a small one: how one looks by default does not depend on who asks for it.
    small = Format(width=320, height=240, fps=2, stop=1.0)
    monkeypatch.setattr("grosmc_mj.experiments.films.Format", lambda: small)
    exec(example("python"), {})
    first, *requirements, last = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"\S+ rad from the nominal optimum", first)
    assert requirements
    assert all(line.endswith(" kept") for line in requirements)
    assert last == "arm/case1 keeps all: True"
    assert (tmp_path / "fall.mp4").is_file()


def test_the_readme_s_example_file_is_kept(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(example("toml"), encoding="utf-8")
    assert all(judgement.kept for judgement in grosmc_mj.judge(tmp_path / "mine.toml"))


def test_the_readme_s_table_comes_from_a_validation_file(tmp_path: Path) -> None:
    (experiment,) = select_experiments(["servo"], "case1")
    table = results_table([experiment.run(plant, "lqr") for plant in ("physics", "corrected")])
    document = {"sheets": [{"table": table.model_dump(), "charts": []}]}
    rows = results_markdown(document).splitlines()
    assert len(rows) == 3
    assert rows[2].startswith("| servo | case1 | lqr | 1.42 rad | 3.99 s |  | 13.4 | ")
    readme, results = tmp_path / "README.md", tmp_path / "validation.json"
    readme.write_text("before\n<!-- results -->\nold\n<!-- /results -->\nafter\n")
    results.write_text(json.dumps(document))
    for _ in range(2):
        write_text("results", readme, results)
    text = "\n".join(["before", "<!-- results -->", *rows, "<!-- /results -->", "after", ""])
    assert readme.read_text() == text
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
def test_what_an_import_leaves_out(module: str, heavy: tuple[str, ...]) -> None:
    program = f"import sys, {module}; print([n for n in {heavy} if n in sys.modules])"
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
