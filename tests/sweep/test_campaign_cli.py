"""grosmc-mj campaign and its replays: what they write, their exit codes, wrong use in one line."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from campaign_cases import AMPLITUDE, DEVIATION, LQR, forged, replaced, servo

from grosmc_mj import cli
from grosmc_mj.cli.commands.campaign.command import CampaignCommand


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
    assert results["sampled"]["words"] == "16 runs, random, seed 0"
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


def test_a_campaign_that_requires_nothing_says_who_completed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "free.toml"
    path.write_text(servo(laws=LQR, limits=""))
    assert run("campaign", path, "--runs", "16", "--out", tmp_path / "out", "--verbose") == cli.DONE
    said = capsys.readouterr().out
    assert "lqr: nothing is required of it." in said
    assert "16 of 16" in said
    assert not list((tmp_path / "out").glob("map.*"))


@pytest.mark.parametrize(("runs", "code"), [(298, cli.DIFFERS), (299, cli.DONE)])
def test_299_runs_without_failure_show_99_percent(
    file: Path, tmp_path: Path, runs: int, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    easy = tmp_path / "easy.toml"
    easy.write_text(file.read_text().replace("3 mrad", "100 mrad"))
    asked = ("--at-least", "0.99", "--no-figures", "--out", tmp_path / "out")
    assert run("campaign", easy, "--runs", str(runs), *asked) == code
    said = " ".join(capsys.readouterr().out.split())
    assert "of the declared design keep everything" in said
    assert "99 % are asked for" in said


def test_it_says_who_judged_and_why_equations_did_not(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ("campaign", file, "--no-figures")
    out = tmp_path / "auto"
    assert run(*asked, "--runs", "512", "--out", out) == cli.DONE
    said = " ".join(capsys.readouterr().out.split())
    judged = json.loads((out / "results.json").read_text())["judged"]["lqr"]
    assert judged["runs"] == 512
    assert 0 < judged["by_equations"] < 512
    assert f"{judged['by_equations']} of 512 runs judged by the equations, " in said
    drawn, share = judged["drawn"], judged["wrong_at_most"]
    assert share == pytest.approx(1 - 0.05 ** (1 / drawn), rel=1e-9)
    assert f"lqr: of {drawn} confirmed at random, 0 overturned: at most {100 * share:.2g} %" in said
    table = pq.read_table(out / "parts" / "part-0000000.parquet")
    assert table["judged_by"].to_pylist().count("equations") == judged["by_equations"]
    number = str(table["judged_by"].to_pylist().index("equations"))
    assert run("campaign", out, "--replay", number, "--no-figures") == cli.DONE
    assert "campaign stored by the equations, bit for bit" in capsys.readouterr().out
    some = ("--runs", "512", "--integrator", "implicitfast", "--out", tmp_path / "physics")
    assert run(*asked, *some) == cli.DONE
    answer = capsys.readouterr()
    why = "equations are stepped by RK4, the model by implicitfast"
    assert f"No run is screened by equations: {why}." in answer.err
    assert "by the equations" not in answer.out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--runs", "0"), "runs = 0 must be a whole number from 1"),
        (("--seed", "-1"), "seed = -1 must be"),
        (("--sampler", "sobel"), "unknown sampler 'sobel': did you mean 'sobol'?"),
        (("--sampler", "corners", "--runs", "5"), "5 runs, but there are 4 corners"),
        (("--executor", "slurm"), "unknown executor 'slurm'"),
        (("--screen", "equation"), "unknown screen 'equation': did you mean 'equations'?"),
        (("--executor", "batch", "--workers", "2"), "workers"),
        (("--axes", "load amplitude", "mass"), "unknown uncertain number 'mass'"),
        (("--axes", "load amplitude", "load amplitude"), "name two uncertain numbers"),
        (("--axes", "load amplitude"), "--axes load amplitude: name two uncertain numbers"),
        (("--confidence", "95"), "--confidence 95 must lie between 0 and 1"),
        (
            ("--at-least", "0.5", "--sampler", "sobol"),
            "--sampler sobol does not draw: take --sampler random",
        ),
        (("--at-least", "1"), "--at-least 1 must lie between 0 and 1"),
        (("--worst", "--evaluations", "10"), "--evaluations 10 must be 128 or more"),
        (("--runs", str(10**30)), "must be a whole number from 1 to 1e+12"),
        (("--runs", str(10**9), "--shard", "1"), "take a larger shard"),
        (("--duration", "1e300"), "duration = 1e+300 must be above 0 to 1e+06 s"),
        (("--control-period", "inf"), "control_period = inf must be above 0 to 1e+06 s"),
        (
            ("--executor", "processes", "--workers", str(10**9)),
            "must be a whole number from 1 to 1024",
        ),
        (("--laws", "mpc"), "unknown law 'mpc'"),
        (("--control-period", "0.0015"), "no multiple of the timestep"),
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


def test_a_folder_without_replay_says_what_it_needs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "manifest.json").write_text("{}")
    assert run("campaign", tmp_path) == cli.WRONG
    assert "is a campaign's folder: --replay RUN repeats one of its runs" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (servo(""), "nothing is uncertain"),
        ("[plant", "no valid TOML"),
        ('name = "../up"\n' + servo(laws=LQR, limits=DEVIATION), "must be a name for files"),
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


@pytest.mark.parametrize("command", ["run", "campaign", "study tolerance"])
def test_a_band_that_is_a_share_of_no_error_is_refused(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The servo's reference is 1 rad."""
    file = tmp_path / "at_rest.toml"
    text = servo(laws=LQR, limits='[[requirement]]\nsettles_within = "10 ms"\n')
    file.write_text(text.replace("start = {}", 'start = { "rotor angle" = "1 rad" }'))
    figures = () if "study" in command else ("--no-figures",)
    assert run(*command.split(), file, "--out", tmp_path / "out", *figures) == cli.WRONG
    said = capsys.readouterr().err
    assert "requirement 1: settles_within: its band is 2 % of the error at the start" in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("which", ["3", "worst", "shrunk", "outside"])
def test_replays(folder: Path, which: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        run("campaign", folder, "--replay", which, "--engine", "python", "--no-figures") == cli.DONE
    )
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
    assert run("campaign", tmp_path, "--replay", "0", "--no-figures") == cli.DONE
    assert run("campaign", tmp_path, "--replay", "1", "--no-figures") == cli.DIFFERS
    assert "differs: ended: 0.049 was stored, 0.05 is found" in capsys.readouterr().out
    pq.write_table(replaced(table, "ended", 1, 0.048), part)
    assert run("campaign", tmp_path, "--replay", "0", "--no-figures") == cli.WRONG
    said = capsys.readouterr().err
    assert said.endswith(
        "part-0000000.parquet is damaged, or is not part 0 of this campaign: remove it, and "
        "--resume runs it again\n"
    )


# ---- what is written, and when


def interrupted(*_: Any, **__: Any) -> Any:
    """Ctrl-C."""
    raise KeyboardInterrupt


def asked(file: Path, out: Path, **more: Any) -> CampaignCommand:
    """A campaign of eight runs."""
    return CampaignCommand(str(file), runs=8, out=out, **more)


def test_an_interrupt_says_how_to_go_on(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grosmc_mj.sweep.store.run_missing", interrupted)
    with pytest.raises(KeyboardInterrupt) as stop:
        asked(file, tmp_path).execute()
    assert str(stop.value) == (
        "interrupted: 0 of 1 parts are done; the same command with --resume runs the others"
    )


ALL_RESULTS = {"results.json", "worst.json", "radius.json"}


@pytest.mark.parametrize(
    ("shown", "written"),
    [
        ("rich.console.Console.print", {"results.json"}),
        ("grosmc_mj.cli.commands.campaign.answer.say_worst", {"results.json", "worst.json"}),
        ("grosmc_mj.cli.commands.campaign.answer.say_radius", ALL_RESULTS),
        ("grosmc_mj.sweep.map.write_figures", ALL_RESULTS),
    ],
)
def test_results_are_written_before_they_are_shown(
    shown: str,
    written: set[str],
    file: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(shown, interrupted)
    with pytest.raises(KeyboardInterrupt):
        asked(
            file,
            tmp_path,
            worst=True,
            evaluations=128,
            radius=True,
            at_least=0.99,
            sampler="random",
            verbose=True,
        ).execute()
    assert {path.name for path in tmp_path.glob("*.json")} - {"manifest.json"} == written
    assert not list(tmp_path.glob("*.png"))
    # The verdict comes before searches and figures.
    assert ("99 % are asked for" in capsys.readouterr().out) == (
        shown != "rich.console.Console.print"
    )


# ---- a folder that is read only


def plain_file(copy: Path, _: pytest.MonkeyPatch) -> None:
    """What root cannot write either."""
    (copy / "replays").touch()


def elsewhere(copy: Path, _: pytest.MonkeyPatch) -> None:
    """A folder of somebody else's may lead anywhere."""
    (copy.parent / "elsewhere").mkdir()
    (copy / "replays").symlink_to(copy.parent / "elsewhere")


@pytest.mark.parametrize(
    ("how", "stored", "code"),
    [
        (plain_file, True, cli.DONE),
        (plain_file, False, cli.DIFFERS),
        (elsewhere, True, cli.DONE),
    ],
)
def test_a_replay_of_what_cannot_be_written_is_judged(
    folder: Path,
    tmp_path: Path,
    how: Any,
    stored: bool,
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    copy = Path(shutil.copytree(folder, tmp_path / "copy", ignore=lambda *_: ["replays"]))
    part = copy / "parts" / "part-0000000.parquet"
    if not stored:
        forged(part, replaced(pq.read_table(part), "ended", 3, 0.049))
    how(copy, monkeypatch)
    assert run("campaign", copy, "--replay", "3", "--film") == code
    said = capsys.readouterr().out
    assert ("bit for bit" in said) == stored
    assert ("differs: ended" in said) == (not stored)
    assert "Nothing is written: " in said
    assert "--out DIR keeps it." in said
    assert not list(tmp_path.rglob("3_lqr*"))
    assert (
        run("campaign", copy, "--replay", "3", "--no-figures", "--out", tmp_path / "kept") == code
    )
    assert [path.name for path in (tmp_path / "kept").iterdir()] == ["3_lqr.json"]


def test_a_name_in_a_folder_leads_nowhere_else(tmp_path: Path) -> None:
    file = tmp_path / "case.toml"
    laws = LQR + 'name = "/../../../up/../a.b"\n'
    file.write_text(servo(AMPLITUDE, laws=laws, limits=DEVIATION))
    out = tmp_path / "deep" / "er" / "out"
    assert run("campaign", file, "--runs", "1", "--out", out, "--no-figures") == cli.DONE
    assert run("campaign", out, "--replay", "0", "--no-figures") == cli.DONE
    assert [path.name for path in out.rglob("0_*")] == ["0__.._.._.._up_.._a.b.json"]


# ---- two processes

HOLDS = """
import sys
from pathlib import Path
from grosmc_mj.sweep.store import Folder
with Folder(Path(sys.argv[1])).held():
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.mark.slow
def test_a_second_process_is_told_of_the_first(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    arguments = ("campaign", file, "--runs", "8", "--out", out, "--no-figures")
    with subprocess.Popen(
        [sys.executable, "-c", HOLDS, str(out)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    ) as first:
        assert first.stdout is not None
        assert first.stdout.readline() == b"held\n"
        for more in ((), ("--resume",)):
            assert run(*arguments, *more) == cli.WRONG
            assert capsys.readouterr().err == (
                f"grosmc-mj: {out}: another grosmc-mj campaign adds parts to it: wait for "
                "its end, or take another --out\n"
            )
        assert [path.name for path in out.iterdir()] == [".lock"]
        first.kill()
    assert run(*arguments) == cli.DONE


# ---- a single run of a file with uncertain numbers


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[[uncertain]]\nbody = "rotor"\nmass_scale = [-1, 1]\n', "must be finite and positive"),
        (AMPLITUDE * 2, "two are uncertain 'load amplitude'"),
    ],
)
def test_run_refuses_uncertainty_that_a_campaign_would(
    text: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(servo(text, laws=LQR, limits=DEVIATION))
    assert run("run", path, "--out", tmp_path / "out") == cli.WRONG
    error = capsys.readouterr().err
    assert error.startswith(f"grosmc-mj: {path}: ")
    assert says in error
    assert error.count("\n") == 1
