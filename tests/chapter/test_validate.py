"""The main job, from the command line."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import hear_interrupts

from grosmc_mj import cli
from grosmc_mj.chapter import expected_results as expected
from grosmc_mj.experiments.catalogue import select_experiments

pytestmark = pytest.mark.slow

METRICS = {
    "deviation",
    "settling_time",
    "overshoot",
    "rms_error",
    "max_sliding",
    "rms_sliding",
    "cost_continuous",
    "cost_whole",
    "cost_optimal",
    "total_variation",
    "max_input",
}


def run(*arguments: str) -> int:
    """Exit code of the command line."""
    with pytest.raises(SystemExit) as stop:
        cli.main(arguments)
    assert isinstance(stop.value.code, int)
    return stop.value.code


@pytest.fixture(scope="module")
def everything(tmp_path_factory: pytest.TempPathFactory) -> tuple[int, Path]:
    """One ``validate`` of everything but the claims, whose ledger test_claims.py judges."""
    out = tmp_path_factory.mktemp("renders")
    return run("validate", "--no-claims", "--out", str(out)), out


@pytest.fixture(scope="module")
def document(everything: tuple[int, Path]) -> dict[str, Any]:
    return json.loads((everything[1] / "validation.json").read_text(encoding="utf-8"))


def test_all_is_as_recorded(everything: tuple[int, Path], document: dict[str, Any]) -> None:
    assert document["differences"] == []
    assert document["as_recorded"] is True
    assert everything[0] == cli.DONE


def test_every_case_runs_on_every_plant_under_every_law(document: dict[str, Any]) -> None:
    runs = {(r["system"], r["case"], r["plant"], r["controller"]) for r in document["runs"]}
    for system, plants in (
        ("servo", ["corrected", "physics"]),
        ("cart_pendulum", ["printed", "corrected", "physics"]),
        ("arm", ["printed", "corrected", "physics"]),
    ):
        for case in ("nominal", "case1", "case2"):
            for plant in plants:
                assert {(system, case, plant, law) for law in ("lqr", "grosmc")} <= runs
    assert ("cart_pendulum", "case1", "physics", "fl-lqr") in runs


def test_the_document_says_what_is_needed_to_repeat_it(document: dict[str, Any]) -> None:
    assert document["schema_version"] == 1
    assert document["complete"] is True
    assert document["seed"] == 0
    assert {"python", "mujoco", "numpy", "numba"} <= set(document["versions"])
    assert "git_revision" in document
    configuration = document["configuration"]
    assert configuration["control_period"] == 1e-3
    assert len(configuration["cases"]) == 14


def test_every_run_has_every_metric_with_its_unit(document: dict[str, Any]) -> None:
    for each in document["runs"]:
        assert set(each["metrics"]) >= METRICS
        assert ("cart_travel" in each["metrics"]) == (each["system"] == "cart_pendulum")
        for name, metric in each["metrics"].items():
            assert set(metric) == {"value", "unit", "note"}, name
            assert metric["value"] is not None or metric["note"]
        assert each["status"] == "completed"
        assert each["gains"]


def test_figures_are_there_as_png_and_svg(everything: tuple[int, Path]) -> None:
    names = sorted(path.name for path in everything[1].glob("fig*"))
    assert [name[:4] for name in names] == [f"fig{i}" for i in range(1, 9) for _ in range(2)]
    for path in everything[1].glob("fig*.png"):
        assert path.read_bytes().startswith(b"\x89PNG")
        assert path.stat().st_size > 20_000
    for path in everything[1].glob("fig*.svg"):
        assert "</svg>" in path.read_text(encoding="utf-8")
    assert not list(everything[1].glob(".*"))
    assert not list(everything[1].glob("*.part"))


def test_physics_agrees_with_the_corrected_equations_in_the_report(
    document: dict[str, Any],
) -> None:
    for row in document["agreement"]:
        if row["variant"] == "corrected":
            # The bound of the acceleration test; a tenth of a micrometre of trajectory.
            assert row["acceleration"] < 1e-10
            assert row["trajectory"] < 1e-7
        else:
            assert row["acceleration"] > 1e-2


def test_the_python_engine_gives_the_same_results() -> None:
    (experiment,) = select_experiments(("arm",), "nominal")
    native, python = (
        experiment.with_settings(engine=engine).run("physics", "grosmc")
        for engine in ("native", "python")
    )
    assert native.metrics == python.metrics


def test_a_result_that_is_not_as_recorded_is_named_and_exits_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded = expected.load_expected()
    recorded["runs"]["servo/nominal/physics/lqr"]["metrics"]["deviation"] *= 1.1
    recorded["runs"]["servo/nominal/physics/grosmc"]["status"] = "diverged"
    del recorded["runs"]["servo/nominal/corrected/lqr"]
    moved = tmp_path / "expected.json"
    moved.write_text(json.dumps(recorded), encoding="utf-8")
    monkeypatch.setattr(expected, "EXPECTED_FILE", moved)
    arguments = ("servo/nominal", "--no-figures", "--out", str(tmp_path))
    assert run("validate", *arguments) == cli.DIFFERS
    said = capsys.readouterr().out
    assert "servo/nominal/physics/lqr: deviation is" in said
    assert "servo/nominal/physics/grosmc: completed, recorded diverged" in said
    assert "servo/nominal/corrected/lqr: not recorded" in said
    assert run("validate", *arguments, "--record") == cli.DONE
    assert run("validate", *arguments) == cli.DONE


def test_other_settings_are_not_compared_with_the_record(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--control-period", "0.004", "--no-figures", "--out", str(tmp_path))
    assert run("validate", "servo/nominal", *options) == cli.DONE
    assert "Not compared" in capsys.readouterr().out
    document = json.loads((tmp_path / "validation.json").read_text(encoding="utf-8"))
    assert document["as_recorded"] is None
    assert document["configuration"]["control_period"] == 0.004


def test_ctrl_c_keeps_what_was_computed(tmp_path: Path) -> None:
    """Interrupted after the first runs: one line, exit code 2, a document that says so."""
    program = (
        "import os, signal, grosmc_mj.experiments.runs as runs, grosmc_mj.cli as cli\n"
        "original = runs.simulate\n"
        "count = 0\n"
        "def counted(*args, **numbers):\n"
        "    global count\n"
        "    count += 1\n"
        "    if count == 4:\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "    return original(*args, **numbers)\n"
        "runs.simulate = counted\n"
        f"cli.main(['validate', 'servo', '--no-figures', '--out', {str(tmp_path)!r}])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        preexec_fn=hear_interrupts,
    )
    assert done.returncode == cli.INTERRUPTED
    assert "Traceback" not in done.stderr
    assert done.stderr.strip().splitlines()[-1].startswith("grosmc-mj: interrupted")
    document = json.loads((tmp_path / "validation.json").read_text(encoding="utf-8"))
    assert document["complete"] is False
    assert len(document["runs"]) == 3
    assert done.stdout.startswith("Not complete: 3 runs are done.")


def test_plan_names_each_run_once() -> None:
    runs = [
        (*experiment.key, *what)
        for experiment in select_experiments((), None)
        for what in experiment.laws
    ]
    assert len(runs) == len(set(runs)) == 87
