"""Every command's answer: its verdict first, all of it within a screen; lists, help and names."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from case_texts import SERVO
from commands import run
from rich.cells import cell_len

from grosmc_mj import cli
from grosmc_mj.cli import screen
from grosmc_mj.cli.commands import CLAIMS, COMMANDS, STUDIES
from grosmc_mj.cli.targets import recorded_experiments, result_name, shown_experiment
from grosmc_mj.experiments.file.reading import resolved_text
from grosmc_mj.experiments.file.shipped import campaign_files, shipped_files

slow = pytest.mark.slow
MORE = """
[[edit]]
joint = "shaft"
damping = 0.1
[[sensor]]
of = "rotor angle"
noise = "1 mrad"
[[estimator]]
of = "rotor speed"
[[actuator]]
of = "current"
limit = "4 A"
"""


@pytest.mark.parametrize(
    ("command", "code", "verdict", "words"),
    [
        ("list", 0, f"4 systems, {len(shipped_files())} case files.", ["cart_pendulum", "grosmc"]),
        ("claims premises arm/case1", 0, "1 of 8 premises of grosmc fail", []),
        ("run servo/nominal --laws lqr --no-figures", 0, "Nothing is required", ["J(u_c)/J*"]),
        pytest.param(
            "run servo/machine --no-figures", 1, r"6 of 20 requirements are not kept",
            ["transmission of shaft: inertia 0.002031 kg m^2, stiffness 100 N m/rad*,",
             "motor of current: constant 0.00768 N m/A, resistance 2.6 ohm,", "assumed of it:"],
            marks=slow,
        ),
        pytest.param(
            "campaign short.toml --runs 8 --worst --evaluations 128 --no-figures", 0,
            r"lqr keeps everything on \d of 8 plants", [], marks=slow,
        ),
    ],
)  # fmt: skip
def test_the_answer_comes_first_and_fits_on_a_screen(
    command: str, code: int, verdict: str, words: list[str], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    # The shipped campaign, cut before its load.
    text = campaign_files()["servo"].read_text(encoding="utf-8")
    short = re.sub(r'(?m)^duration = ".*"', 'duration = "0.5 s"', text)
    (tmp_path / "short.toml").write_text(short, encoding="utf-8")
    assert run(*command.split()) == code
    output = capsys.readouterr().out
    lines = output.rstrip("\n").split("\n")
    assert re.match(verdict, lines[0]), lines[0]
    assert [word for word in words if word not in " ".join(output.split())] == []
    assert "…" not in output
    # A machine is told part by part.
    assert len(lines) <= 40 or "servo/machine" in command
    assert max(cell_len(line.rstrip()) for line in lines) <= 100 or "servo/machine" in command


@pytest.mark.parametrize(
    ("target", "lines"),
    [
        ("servo", {
            "states": "rotor angle [rad], rotor speed [rad/s]",
            "inputs": "current [A]",
            "bodies": "rotor",
            "joints": "shaft [rad]",
            "laws": "lqr, fl-lqr, grosmc, lqi, pid, adrc, adaptive",
            "rotor": "mass 2.885 kg; principal inertia 0.029066, 0.0577, 0.029066 kg m^2",
            "equations": "J 0.0577 kg m^2; B 0.0088 N m s/rad; Kt 0.667 N m/A",
        }),
        ("maglev", {"states": "gap [m], rate [m/s], current [A]", "parameters": "m, g, C, R, L"}),
        ("mine.toml", {"states": "rotor angle [rad], rotor speed [rad/s]"}),
    ],
)  # fmt: skip
def test_list_names_what_tables_of_a_case_file_take(
    target: str, lines: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """Those names are taken, too: a file of one's own has them."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(f'title = "[/] of mine"\n{SERVO}{MORE}')
    assert run("list", target) == cli.DONE
    output = capsys.readouterr().out
    words = [line.partition("  (")[0].strip().split(None, 1) for line in output.splitlines()]
    assert lines.items() <= {pair[0]: pair[1] for pair in words if len(pair) == 2}.items()
    assert ("[/] of mine" in output) == (target == "mine.toml")


def test_one_grammar_for_targets(tmp_path: Path) -> None:
    recorded = {name: [one.case.name for one in recorded_experiments(name)] for name in
                ("arm", "arm/case2")}  # fmt: skip
    assert recorded == {"arm": ["nominal", "case1", "case2", "bench"], "arm/case2": ["case2"]}
    mine, packaged = tmp_path / "mine.toml", shipped_files()["arm/case1"]
    mine.write_text(resolved_text(packaged), encoding="utf-8")
    for target, path in (("arm", packaged), ("arm/nominal", shipped_files()["arm/nominal"]),
                         ("jaco", shipped_files()["jaco/eight"]), (str(mine), mine)):  # fmt: skip
        assert shown_experiment(target).path == path
    assert (result_name(mine), result_name(packaged)) == ("mine", "arm_case1")


def test_every_command_has_a_summary_takes_verbose_and_its_help_names_its_options(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert list(COMMANDS) == ["new", "run", "campaign", "film", "view", "validate", "claims",
        "study", "identify", "compare", "report", "diff", "list"]  # fmt: skip
    kinds = [command for command in COMMANDS.values() if isinstance(command, type)]
    for command in [*kinds, *STUDIES.values(), *CLAIMS.values()]:
        assert (command.__doc__ or "").partition("\n")[0].endswith((".", ":"))
        assert "verbose" in command.__dataclass_fields__
    for arguments, words in (
        ("", f"usage: grosmc-mj {' '.join(COMMANDS)}"),
        ("validate", "SYSTEM/CASE --verbose --out"),
        ("film", "FILE.toml --laws --camera --size --from -o"),
        ("study", "region tolerance ladder"),
    ):
        assert run(*arguments.split(), "--help") == cli.DONE
        output = capsys.readouterr().out
        assert [word for word in words.split() if word not in output] == []


def test_without_a_terminal_progress_is_a_line_now_and_then(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert screen.LINE_EVERY == 10.0
    for seconds, lines in (
        (10.0, []),
        (0.0, ["1 of 3 runs in 0 s: one of them", "3 of 3 runs in 0 s"]),
    ):
        monkeypatch.setattr(screen, "LINE_EVERY", seconds)
        with screen.progress(3, "runs") as advance:
            advance("one  of them ")
            advance(by=2)
        assert capsys.readouterr().err.splitlines() == lines
