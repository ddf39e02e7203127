"""Every command's answer: its verdict first, all of it within a screen; and names of commands."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from rich.cells import cell_len

from grosmc_mj import cli
from grosmc_mj.chapter.claims import faults, ledger
from grosmc_mj.cli.commands import CLAIMS, COMMANDS, STUDIES
from grosmc_mj.cli.targets import recorded_experiments, result_name, shown_experiment
from grosmc_mj.errors import ArgumentError, GrosmcError
from grosmc_mj.experiments.file.reading import resolved_text
from grosmc_mj.experiments.file.shipped import campaign_files, shipped_files

_LINES, _COLUMNS = 40, 100


def run(*arguments: str) -> int:
    """Exit code of the command line."""
    with pytest.raises(SystemExit) as stop:
        cli.main(arguments)
    assert isinstance(stop.value.code, int)
    return stop.value.code


def slow(*values: Any) -> Any:
    return pytest.param(*values, marks=pytest.mark.slow)


@pytest.mark.parametrize(
    ("command", "verdict"),
    [
        ("--help", "usage: grosmc-mj"),
        ("list", f"4 systems, {len(shipped_files())} case files."),
        ("new mine", r"mine\.toml written"),
        slow("claims arm-eq57", "All verdicts are as expected"),
        slow("doctor", "Films can"),
        slow("run servo/case1", "All 3 requirements are kept"),
        slow("run servo/bench --no-figures", "All 20 requirements are kept"),
        slow("run cart_pendulum/case1 --no-figures", "All 5 requirements are kept"),
        slow("claims premises arm/case1", "1 of 8 premises of grosmc fail"),
        slow("claims premises two_link_arm", "All 40 premises of grosmc hold"),
        slow("validate servo/case1 --no-figures", "All 4 runs are as recorded"),
        slow(
            "campaign short.toml --runs 8 --worst --evaluations 128 --no-figures",
            r"lqr keeps everything on \d of 8 plants",
        ),
        slow("study region arm --points 3 --duration 3", "lqr on case2 converges from the fewest"),
    ],
)
def test_the_answer_comes_first_and_fits_on_a_screen(
    command: str,
    verdict: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    # The shipped campaign, cut before its load.
    text = re.sub(
        r'(?m)^duration = ".*"', 'duration = "0.5 s"', campaign_files()["servo"].read_text()
    )
    (tmp_path / "short.toml").write_text(text)
    code = run(*command.split())
    lines = capsys.readouterr().out.rstrip("\n").split("\n")
    # A machine may lack what films need.
    assert code in ((cli.DONE, cli.DIFFERS) if command == "doctor" else (cli.DONE,))
    assert re.match(verdict, lines[0]), lines[0]
    assert len(lines) <= _LINES
    # Help is as wide as the terminal.
    if command != "--help":
        assert [line for line in lines if cell_len(line.rstrip()) > _COLUMNS] == []


def test_a_machine_is_told_with_units_and_what_is_assumed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = run("run", "servo/machine", "--no-figures", "--out", str(tmp_path))
    assert code == cli.DIFFERS
    said = " ".join(capsys.readouterr().out.split())
    assert "transmission of shaft: inertia 0.002031 kg m^2, stiffness 100 N m/rad*," in said
    assert "motor of current: constant 0.00768 N m/A, resistance 2.6 ohm," in said
    assert "assumed of it:" in said
    assert "…" not in said


@pytest.mark.parametrize("system", ["servo", "arm", "cart_pendulum", "two_link_arm"])
def test_list_names_the_same_laws_of_a_system(
    system: str, capsys: pytest.CaptureFixture[str]
) -> None:
    laws = []
    for arguments in (["list"], ["list", system]):
        assert run(*arguments) == cli.DONE
        block = capsys.readouterr().out.split(f"{system}{':' if arguments[1:] else ''}", 1)[1]
        laws.append(next(re.finditer(r"laws +(.*)", block))[1].strip())
    assert laws[0] == laws[1]


@pytest.mark.slow
def test_a_self_test_says_first_what_nobody_notices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only the pendulum's law can believe a printed a."""
    two = [claim for claim in ledger.CLAIMS if claim.id in ("servo-index", "servo-load-grosmc")]
    assert len(two) == 2
    monkeypatch.setattr(ledger, "CLAIMS", two)
    fault = next(fault for fault in faults.FAULTS if fault.name == "printed a in the law")
    monkeypatch.setattr(faults, "FAULTS", (fault,))
    assert run("claims", "self-test", "servo", "--out", str(tmp_path)) == cli.DIFFERS
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "1 of 1 faults are not noticed: printed a in the law."
    assert "notices no fault" in " ".join(lines)
    noticed = json.loads((tmp_path / "self_test.json").read_text())["noticed_by"]
    assert noticed == {"printed a in the law": []}


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize(("target", "name"), [("servo/case2", "servo_case2"), ("FILE", "small")])
def test_a_film_is_of_a_case_or_a_file(
    target: str,
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(resolved_text(shipped_files()["servo/case2"]))
    size = ("--size", "320x240", "--fps", "4", "--to", "0.5", "--controllers", "lqr")
    assert run("film", target.replace("FILE", "small.toml"), *size) == cli.DONE
    assert (tmp_path / "renders" / "films" / f"{name}.mp4").is_file()
    said = capsys.readouterr().out
    assert re.match("2 frames, 0.5 s", said)
    assert len(said.splitlines()) == 2


@pytest.mark.slow
def test_a_film_of_a_file_refuses_what_the_file_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "small.toml"
    file.write_text(resolved_text(shipped_files()["servo/case2"]))
    for arguments, says in (
        (("--controllers", "mpc"), "unknown law 'mpc': valid: lqr"),
        (("--controllers",), "1 to 4 controllers, not 0"),
        (("--from", "100"), "shows nothing"),
    ):
        assert run("film", str(file), *arguments) == cli.WRONG
        assert says in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("campaign servo --film", "--film is for --replay only"),
        ("campaign servo --case-file x.toml", "--case-file is for --replay only"),
        ("campaign out --replay 3 --runs 7", "--runs is not for --replay"),
        ("claims premises", "SYSTEM|SYSTEM/CASE"),
        ("claims arm/case1", "unknown claim 'arm/case1'"),
        ("validate mine.toml", "judged by grosmc-mj run"),
        ("study switching two_link_arm/case1", "has 2 inputs"),
        ("film leg/case1", "unknown case 'leg/case1'"),
        ("view nothing.toml", "there is no such file"),
    ],
)
def test_what_a_command_cannot_be_about_is_one_line(
    arguments: str, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*arguments.split()) == cli.WRONG
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


def test_one_grammar_for_targets(tmp_path: Path) -> None:
    cases = [one.case.name for one in recorded_experiments("arm")]
    assert cases == ["nominal", "case1", "case2", "bench"]
    assert [one.case.name for one in recorded_experiments("arm/case2")] == ["case2"]
    assert shown_experiment("arm").case.name == "case1"
    assert shown_experiment("arm/nominal").case.name == "nominal"
    assert shown_experiment("jaco").path == shipped_files()["jaco/eight"]
    mine = tmp_path / "mine.toml"
    mine.write_text(resolved_text(shipped_files()["arm/case1"]), encoding="utf-8")
    assert shown_experiment(str(mine)).path == mine
    assert (result_name(mine), result_name(shipped_files()["arm/case1"])) == ("mine", "arm_case1")
    for wrong in ("leg", "arm/case9", "leg/case1", "nothing.toml", str(tmp_path)):
        with pytest.raises(GrosmcError):
            shown_experiment(wrong)
    with pytest.raises(ArgumentError, match="judged by grosmc-mj run"):
        recorded_experiments(str(mine))


def test_every_command_has_a_summary_and_takes_verbose() -> None:
    commands = [each for each in COMMANDS.values() if isinstance(each, type)]
    for each in [*commands, *STUDIES.values(), *CLAIMS.values()]:
        assert (each.__doc__ or "").partition("\n")[0].endswith((".", ":"))
        assert "verbose" in each.__dataclass_fields__
    named = ["new", "run", "campaign", "film", "view", "validate", "claims", "study", "identify",
             "compare", "report", "diff", "list", "doctor"]  # fmt: skip
    assert list(COMMANDS) == named


_HEAVY = ("numpy", "mujoco", "numba", "sympy", "scipy", "pydantic", "matplotlib", "typeguard")
_FOR_OTHERS = ("matplotlib", "control", "pint", "scipy.stats", "scipy.optimize", "pyarrow",
               "dask", "loky")  # fmt: skip


@pytest.mark.parametrize(
    ("command", "without"),
    [
        ("--help", (*_HEAVY, "rich.console")),
        ("list", _HEAVY),
        ("run servo/nominal --no-figures --out {}", _FOR_OTHERS),
    ],
)
def test_a_command_imports_what_it_needs(
    command: str, without: tuple[str, ...], tmp_path: Path
) -> None:
    program = (
        "import sys\nfrom grosmc_mj.cli import main\n"
        f"try:\n    main({command.format(tmp_path).split()})\nexcept SystemExit:\n    pass\n"
        f"print([n for n in {without} if n in sys.modules], file=sys.stderr)"
    )
    run = [sys.executable, "-c", program]
    done = subprocess.run(run, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.splitlines()[-1]) == (0, "[]")
