"""grosmc-mj campaign: the files, the exit codes, wrong use in one line."""

from __future__ import annotations

import io
import json
import re
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.parquet as pq
import pytest
from campaigns import AMPLITUDE, BOTH, LQR, deviation_below, pair, plain, servo
from commands import Patch, Screen, run
from rich.console import Console

from grosmc_mj import cli
from grosmc_mj.cli import screen
from grosmc_mj.cli.commands.campaign import running
from grosmc_mj.cli.commands.campaign.command import CampaignCommand
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.studies.pieces import held
from grosmc_mj.studies.sweep.runs import Row, run_rows

PART = Path("parts") / "part-0000000.parquet"
SEARCHES = ("--worst", "--evaluations", "128", "--radius")


def written(folder: Path, text: str) -> Path:
    """The case file small.toml."""
    path = folder / "small.toml"
    path.write_text(text)
    return path


def under_lqr(limit: str = "3 mrad", *, numbers: Any = BOTH, laws: Any = LQR) -> str:
    """A servo's campaign under LQR, which compiles soonest."""
    return servo(*numbers, laws=laws, limits=deviation_below(limit))


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The case file of a servo under LQR."""
    return written(tmp_path_factory.mktemp("files"), under_lqr())


@pytest.fixture(scope="module")
def folder(file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of sixteen runs with all searches, of which one finds a failure."""
    path = tmp_path_factory.mktemp("campaign") / "out"
    sixteen = ("campaign", file, "--runs", "16", "--out", path, "--no-figures")
    assert run(*sixteen, *SEARCHES) == cli.DIFFERS
    return path


def document(folder: Path, name: str) -> dict[str, Any]:
    """A document of a campaign."""
    return json.loads((folder / f"{name}.json").read_text())


# Answers.


def test_the_speed_counts_timesteps_of_the_physics(
    file: Path, tmp_path: Path, capsys: Screen
) -> None:
    """Of 20 ms in timesteps of 1 ms, whatever the control period."""
    few = ("campaign", file, "--runs", "4", "--no-figures", "--duration", "0.02")
    assert run(*few, "--control-period", "0.004", "--out", tmp_path) in (cli.DONE, cli.DIFFERS)
    words = " ".join(capsys.readouterr().out.split())
    (speeds,) = re.findall(r"4 runs of 0.02 s in .* s: (\S+) runs and (\S+) timesteps", words)
    runs, timesteps = map(float, speeds)
    assert timesteps / runs == pytest.approx(20, rel=0.02)


def answered_again(printed: Any, *arguments: object) -> None:
    """Require the answer of a campaign that is complete, in which no time is told."""
    run("campaign", *arguments)
    printed("campaign", *arguments, "--resume")


def test_a_complete_campaign_is_answered_again(printed: Any, tmp_path: Path) -> None:
    file = written(tmp_path, pair()).name
    answered_again(printed, file, "--runs", "8", "--no-figures", "--verbose")


def test_a_law_of_which_nothing_is_required_completes(printed: Any, tmp_path: Path) -> None:
    """Nothing is drawn."""
    answered_again(printed, written(tmp_path, plain()).name, "--runs", "16")
    assert not list(tmp_path.rglob("map.*"))


@pytest.mark.parametrize("runs", [4, 5])
def test_five_runs_without_failure_show_50_percent_and_four_do_not(
    runs: int, printed: Any, tmp_path: Path
) -> None:
    """0.5^5 is below a doubt of 5 %, 0.5^4 above it."""
    file = written(tmp_path, under_lqr("100 mrad")).name
    answered_again(printed, file, "--runs", runs, "--at-least", "0.5", "--no-figures")


@pytest.mark.parametrize(
    ("asked", "code"), [((), cli.DIFFERS), (("--at-least", "0.005"), cli.DONE)]
)
def test_a_plant_that_a_search_finds_to_fail_decides_unless_a_share_is_asked_for(
    file: Path, tmp_path: Path, asked: tuple[str, ...], code: int
) -> None:
    """Of eight plants one keeps everything, and so at least 0.6 % of all, with 95 % confidence."""
    options = ("--runs", "8", "--out", tmp_path, "--no-figures", "--radius")
    assert run("campaign", file, *options, *asked) == code
    verdict = document(tmp_path, "results")["answers"][0]["verdict"]
    assert verdict == ("not kept" if code else "kept")


def test_a_campaign_writes_a_document_of_each_search(folder: Path) -> None:
    documents = {"manifest.json", "results.json", "worst.json", "radius.json"}
    assert {path.name for path in folder.iterdir()} == {".lock", "parts", *documents}


def test_documents_have_the_numbers_of_the_runs(folder: Path) -> None:
    results = document(folder, "results")
    assert results["sampled"]["words"] == "16 runs, random, seed 0"
    relative = pq.read_table(folder / PART)["relative"].to_numpy()
    rates = {rate["requirement"]: rate for rate in results["pass_rates"]}
    assert rates["all requirements"]["kept"] == (relative >= 0).sum()
    assert document(folder, "worst")["controllers"]["lqr"]["relative"] <= relative.min()


# Who judged.

SCREENED = ("--no-figures", "--runs", "64", "--screen", "equations")
OTHER_INTEGRATOR = "instead of the model's own"


class Answer(NamedTuple):
    """A command's folder and what it printed."""

    folder: Path
    output: str
    errors: str

    @property
    def judges(self) -> list[str]:
        """The judge of each run."""
        return pq.read_table(self.folder / PART)["judged_by"].to_pylist()


@pytest.fixture(scope="module")
def screened(file: Path, tmp_path_factory: pytest.TempPathFactory) -> Answer:
    """The answer of runs that are screened by equations."""
    out = tmp_path_factory.mktemp("screened")
    with redirect_stdout(io.StringIO()) as output, redirect_stderr(io.StringIO()) as errors:
        assert run("campaign", file, *SCREENED, "--out", out) == cli.DONE
    return Answer(out, output.getvalue(), errors.getvalue())


def test_the_answer_says_who_judged(screened: Answer) -> None:
    count = screened.judges.count("equations")
    assert f"{count} of 64 runs judged by the equations, " in screened.output
    assert OTHER_INTEGRATOR not in screened.errors


def test_a_plant_s_file_says_who_judged(screened: Answer) -> None:
    number = screened.judges.index("equations")
    assert run("campaign", screened.folder, "--plant", number) == cli.DONE
    text = (screened.folder / f"small_{number}_lqr.toml").read_text()
    assert f"run {number} under lqr, judged by the equations." in text


def test_a_notice_says_why_nothing_is_screened(file: Path, tmp_path: Path, capsys: Screen) -> None:
    implicit = ("--integrator", "implicitfast", "--out", tmp_path)
    assert run("campaign", file, *SCREENED, *implicit) == cli.DONE
    errors = capsys.readouterr().err
    reason = "equations are stepped by RK4, the model by implicitfast"
    assert f"No run is screened by equations: {reason}." in errors
    assert OTHER_INTEGRATOR in errors


# Wrong use.


def wrong(capsys: Screen, *arguments: object) -> str:
    """The one line about wrong use."""
    capsys.readouterr()
    assert run(*arguments) == cli.WRONG
    line = capsys.readouterr().err
    assert line.startswith("grosmc-mj: ")
    assert line.count("\n") == 1
    return line


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("--axes", "load amplitude", "mass"), "unknown uncertain number 'mass'"),
        (("--axes", "load amplitude", "load amplitude"), "name two uncertain numbers"),
        (("--axes", "load amplitude"), "--axes load amplitude: name two uncertain numbers"),
        (("--confidence", "95"), "--confidence 95 must lie between 0 and 1"),
        (("--at-least", "1"), "--at-least 1 must lie between 0 and 1"),
        (("--at-least", "0.5", "--sampler", "corners"), "corners does not draw: take --sampler"),
        (("--sampler", "lhs"), "unknown sampler 'lhs': valid: random, corners"),
        (("--worst", "--evaluations", "10"), "--evaluations 10 must be 128 or more"),
    ],
)
def test_wrong_use_gets_one_line(
    arguments: Any, line: str, file: Path, tmp_path: Path, capsys: Screen
) -> None:
    assert line in wrong(capsys, "campaign", file, "--out", tmp_path / "out", *arguments)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["run", "campaign"])
def test_a_wrong_file_is_one_line(command: str, tmp_path: Path, capsys: Screen) -> None:
    path = written(tmp_path, under_lqr(numbers=[AMPLITUDE, AMPLITUDE]))
    line = wrong(capsys, command, path, "--out", tmp_path / "out")
    assert "two are uncertain 'disturbance.load.scale'" in line
    assert not (tmp_path / "out").exists()


def test_a_campaign_s_folder_is_no_case_file(folder: Path, capsys: Screen) -> None:
    line = wrong(capsys, "campaign", folder)
    assert "is a campaign's folder: --plant WHICH writes the case file of one of its plants" in line


@pytest.mark.parametrize("more", [(), ("--resume",)])
def test_a_second_campaign_waits_for_the_first(
    more: tuple[str, ...], file: Path, tmp_path: Path, capsys: Screen
) -> None:
    eight = ("campaign", file, "--runs", "8", "--out", tmp_path, "--no-figures")
    with held(tmp_path):
        assert "another grosmc-mj adds to it" in wrong(capsys, *eight, *more)
        assert [path.name for path in tmp_path.iterdir()] == [".lock"]


# Order of work.


def test_an_interrupted_campaign_says_how_to_go_on(
    file: Path, tmp_path: Path, monkeypatch: Patch
) -> None:
    def interrupted(*_: Any, **__: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr("grosmc_mj.studies.campaign.work.run_missing", interrupted)
    with pytest.raises(KeyboardInterrupt) as stop:
        CampaignCommand(str(file), runs=8, out=tmp_path).execute()
    assert str(stop.value) == (
        "interrupted: 0 of 1 parts are done; the same command with --resume runs the others"
    )


def test_results_are_written_before_shown(file: Path, tmp_path: Path, monkeypatch: Patch) -> None:
    written: dict[str, set[str]] = {}

    def documents() -> set[str]:
        """Documents that are there when something is shown."""
        return {path.stem for path in tmp_path.glob("*.json")} - {"manifest"}

    def note_figures(*_: Any, **__: Any) -> list[Path]:
        written["figures"] = documents()
        return []

    def note_verdict(to: Console, words: str, *, good: bool) -> None:
        """Note the documents at the first verdict of each answer."""
        found = [
            kind for kind in ("keeps everything", "worst plant", "no failure") if kind in words
        ]
        written.setdefault(" and ".join(found), documents())

    monkeypatch.setattr(screen, "say_verdict", note_verdict)
    monkeypatch.setattr(running, "write_figures", note_figures)
    assert run("campaign", file, "--runs", "8", "--out", tmp_path, *SEARCHES) == cli.DIFFERS
    # The headline has what the searches found.
    headline = "keeps everything and worst plant and no failure"
    assert [*written] == [headline, "worst plant", "no failure", "figures"]
    assert [len(names) for names in written.values()] == [1, 2, 3, 3]


# Files of plants.


def least_margin(folder: Path, which: str) -> float:
    """The least margin that a campaign recorded of a plant."""
    worst = document(folder, "worst")["controllers"]["lqr"]
    radius = document(folder, "radius")["controllers"]["lqr"]
    if which == "worst":
        return worst["relative"]
    if which == "shrunk":
        return worst["shrunk_relative"]
    if which == "outside":
        least = {look["scale"]: look["least"] for look in radius["looks"]}
        return least[radius["outside_scale"]]
    return pq.read_table(folder / PART)["relative"][int(which)].as_py()


@pytest.mark.parametrize("which", ["3", "worst", "shrunk", "outside"])
def test_a_plant_s_file_repeats_the_margin_of_the_campaign_to_the_bit(
    which: str, folder: Path, tmp_path: Path, capsys: Screen
) -> None:
    assert run("campaign", folder, "--plant", which, "--out", tmp_path) == cli.DONE
    file = tmp_path / f"small_{which}_lqr.toml"
    assert capsys.readouterr().out.endswith(f"{file}\ngrosmc-mj run {file}\n")

    margin = least_margin(folder, which)
    outcome = run_rows(Experiment.load(file), [Row("lqr")])
    assert outcome["relative"].tolist() == [margin]
    code = cli.DONE if margin >= 0 else cli.DIFFERS
    assert run("run", file, "--no-figures", "--out", tmp_path) == code
    assert run("diff", tmp_path, tmp_path, "--out", tmp_path / "diff") == cli.DONE


def test_a_plant_s_file_that_was_changed_is_kept(
    folder: Path, tmp_path: Path, capsys: Screen
) -> None:
    plant = ("campaign", folder, "--plant", "worst", "--out", tmp_path)
    assert run(*plant) == cli.DONE
    # The same command again writes the same.
    assert run(*plant) == cli.DONE
    file = tmp_path / "small_worst_lqr.toml"
    file.write_text(file.read_text() + "# mine\n")
    assert f"{file} is there already with other content: rename or remove it" in wrong(
        capsys, *plant
    )
    assert file.read_text().endswith("# mine\n")


def test_a_name_in_a_folder_leads_nowhere_else(tmp_path: Path) -> None:
    named_like_a_path = [{"law": "lqr", "name": "/../../../up/../a.b"}]
    file = written(tmp_path, under_lqr(numbers=[AMPLITUDE], laws=named_like_a_path))
    out = tmp_path / "deep" / "er" / "out"
    assert run("campaign", file, "--runs", "1", "--out", out, "--no-figures") == cli.DIFFERS
    assert run("campaign", out, "--plant", "0") == cli.DONE
    (plant,) = out.glob("*.toml")
    assert plant.name == "small_0__.._.._.._up_.._a.b.toml"
    assert set(tmp_path.rglob("*.toml")) == {file, plant}
