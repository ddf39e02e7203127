"""grosmc-mj campaign and replay: what they write, their exit codes, wrong use in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from campaign_cases import AMPLITUDE, DEVIATION, LQR, forged, replaced, servo

from grosmc_mj import cli


def run(*arguments: str | Path) -> int:
    """Exit code of the command line."""
    with pytest.raises(SystemExit) as stop:
        cli.main([str(each) for each in arguments])
    assert isinstance(stop.value.code, int)
    return stop.value.code


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A servo's campaign under LQR, which compiles soonest."""
    path = tmp_path_factory.mktemp("files") / "small.toml"
    path.write_text(servo(laws=LQR, limits=DEVIATION))
    return path


@pytest.fixture(scope="module")
def folder(file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same, run with all searches."""
    path = tmp_path_factory.mktemp("campaign") / "out"
    asked = ("campaign", file, "--runs", "16", "--out", path, "--no-figures")
    assert run(*asked, "--worst", "--evaluations", "128", "--radius") == cli.DONE
    return path


def test_a_campaign_writes_what_it_says(folder: Path) -> None:
    names = {path.name for path in folder.iterdir()}
    documents = {"manifest.json", "results.json", "worst.json", "radius.json"}
    assert names == {".lock", "parts", *documents}
    results = json.loads((folder / "results.json").read_text())
    assert results["sampled"]["words"] == "16 runs, sobol, seed 0"
    relative = pq.read_table(folder / "parts" / "part-0000000.parquet")["relative"].to_numpy()
    rates = {each["requirement"]: each for each in results["pass_rates"]}
    assert rates["all requirements"]["kept"] == (relative >= 0).sum()
    worst = json.loads((folder / "worst.json").read_text())["controllers"]["lqr"]
    assert worst["fails"]
    assert worst["relative"] <= relative.min()
    radius = json.loads((folder / "radius.json").read_text())["controllers"]["lqr"]
    assert radius["found"] < radius["outside_scale"] <= 1


def test_a_campaign_says_its_numbers_and_what_they_do_not_prove(
    file: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("campaign", file, "--runs", "16", "--out", folder, "--resume", "--no-figures") == 0
    said = capsys.readouterr().out
    assert "1 of 1 parts are there already." in said
    assert "deviation below 3 mrad" in said
    assert "no proof" in " ".join(said.split())


@pytest.mark.parametrize(("share", "code"), [("0.05", cli.DONE), ("0.99", cli.DIFFERS)])
def test_at_least_decides_the_exit_code(file: Path, folder: Path, share: str, code: int) -> None:
    asked = ("campaign", file, "--runs", "16", "--out", folder, "--resume", "--no-figures")
    assert run(*asked, "--at-least", share) == code


def test_figures_are_drawn(file: Path, tmp_path: Path) -> None:
    assert run("campaign", file, "--runs", "8", "--out", tmp_path) == cli.DONE
    for name in ("margins.png", "margins.svg", "map.png", "map.svg"):
        assert (tmp_path / name).stat().st_size > 1000


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--runs", "0"), "--runs 0 must be from 1"),
        (("--seed", "-1"), "--seed -1 must be 0 or more"),
        (("--sampler", "sobel"), "unknown sampler 'sobel': did you mean 'sobol'?"),
        (("--sampler", "corners", "--runs", "5"), "--runs 5: there are 4 corners"),
        (("--executor", "slurm"), "unknown executor 'slurm'"),
        (("--executor", "batch", "--workers", "2"), "workers"),
        (("--axes", "load amplitude", "mass"), "unknown uncertain number 'mass'"),
        (("--axes", "load amplitude", "load amplitude"), "twice: name two different numbers"),
        (("--axes", "load amplitude"), "--axes names 1: name two uncertain numbers"),
        (("--confidence", "95"), "--confidence 95 must lie between 0 and 1"),
        (("--at-least", "1"), "--at-least 1 must lie between 0 and 1"),
        (("--worst", "--evaluations", "10"), "--evaluations 10 must be 128 or more"),
        (("--controllers", "pid"), "unknown controller 'pid'"),
        (("--control-period", "0.0015"), "no multiple of the timestep"),
        (("--duration", "0"), "--duration 0 s must be positive"),
    ],
)
def test_wrong_use_gets_one_line_and_leaves_nothing_behind(
    arguments: tuple[str, ...],
    says: str,
    file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run("campaign", file, "--out", tmp_path / "out", *arguments) == cli.WRONG
    error = capsys.readouterr().err
    assert says in error
    assert error.startswith("grosmc-mj: ")
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            servo(AMPLITUDE.replace("load", "lod"), laws=LQR, limits=DEVIATION),
            "did you mean 'load'?",
        ),
        (servo('[[uncertain]]\nbody = "rotor"\nmass_scale = [-1, 1]\n'), "must be positive"),
        (servo(""), "nothing is uncertain"),
        ("[plant", "no valid TOML"),
        ('name = "../up"\n' + servo(laws=LQR, limits=DEVIATION), "names a folder"),
    ],
)
def test_a_wrong_file_gets_one_line(
    text: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    assert run("campaign", path, "--out", tmp_path / "out") == cli.WRONG
    error = capsys.readouterr().err
    assert error.startswith(f"grosmc-mj: {path}: ")
    assert says in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("target", "says"),
    [
        ("servoo", "unknown system 'servoo': did you mean 'servo'?"),
        ("nowhere.toml", "nowhere.toml: there is no such file"),
        ("servo/nominal", "nothing is uncertain"),
    ],
)
def test_an_unknown_target(
    target: str, says: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert run("campaign", target, "--out", tmp_path / "out") == cli.WRONG
    assert says in capsys.readouterr().err


def test_the_folder_of_another_campaign_is_refused(
    file: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("campaign", file, "--runs", "17", "--out", folder, "--resume") == cli.WRONG
    assert "runs: 16 there, 17 now" in capsys.readouterr().err
    assert run("campaign", file, "--runs", "16", "--out", folder) == cli.WRONG
    assert "--resume runs what is missing" in capsys.readouterr().err


@pytest.mark.parametrize("which", ["3", "worst", "shrunk", "outside"])
def test_replays(folder: Path, which: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("replay", folder, which, "--engine", "python", "--no-figures") == cli.DONE
    said = capsys.readouterr().out
    assert ("bit for bit" in said) == (which == "3")
    assert (folder / "replays" / f"{which}_lqr.json").exists()


def test_a_tampered_run_is_no_replay(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("campaign", file, "--runs", "2", "--out", tmp_path, "--no-figures") == cli.DONE
    part = tmp_path / "parts" / "part-0000000.parquet"
    table = replaced(pq.read_table(part), "ended", 1, 0.049)
    forged(part, table)
    assert run("replay", tmp_path, "0", "--no-figures") == cli.DONE
    assert run("replay", tmp_path, "1", "--no-figures") == cli.DIFFERS
    assert "differs: ended: 0.049 was stored, 0.05 is found" in capsys.readouterr().out
    pq.write_table(replaced(table, "ended", 1, 0.048), part)
    assert run("replay", tmp_path, "0", "--no-figures") == cli.WRONG
    said = capsys.readouterr().err
    assert said.endswith(
        f"{part}: has rows that its checksum is not of: remove it, and --resume runs it again\n"
    )


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("16",), "run '16': there are 0 to 15, worst, shrunk, outside"),
        (("0", "--controller", "lqg"), "unknown controller 'lqg': did you mean 'lqr'?"),
        (("0", "--engine", "fortran"), "valid: native, python"),
    ],
)
def test_what_cannot_be_replayed(
    folder: Path, arguments: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("replay", folder, *arguments) == cli.WRONG
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


def test_a_folder_that_is_no_campaign(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("replay", tmp_path, "0") == cli.WRONG
    assert "is no campaign: it has no manifest.json" in capsys.readouterr().err
