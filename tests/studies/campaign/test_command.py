"""grosmc-mj campaign: the files, the exit codes, wrong use in one line."""

import io
import json
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.parquet as pq
import pytest
from campaign_cases import AMPLITUDE, DEVIATION, LQR, deviation_below, servo
from commands import Patch, Screen, run
from rich.console import Console

from grosmc_mj import cli
from grosmc_mj.cli import screen
from grosmc_mj.cli.commands.campaign import running
from grosmc_mj.cli.commands.campaign.command import CampaignCommand
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.studies.pieces import held
from grosmc_mj.studies.sweep.runs import Row, run_rows

TEXT = servo(laws=LQR, limits=DEVIATION)
PART = Path("parts") / "part-0000000.parquet"
SEARCHES = ("--worst", "--evaluations", "128", "--radius")


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A servo's campaign under LQR, which compiles soonest."""
    path = tmp_path_factory.mktemp("files") / "small.toml"
    path.write_text(TEXT)
    return path


@pytest.fixture(scope="module")
def folder(file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of sixteen runs with all searches."""
    path = tmp_path_factory.mktemp("campaign") / "out"
    sixteen = ("campaign", file, "--runs", "16", "--out", path, "--no-figures")
    assert run(*sixteen, *SEARCHES) == cli.DIFFERS
    return path


class Answer(NamedTuple):
    """A command's folder and what it printed."""

    folder: Path
    output: str
    errors: str

    @property
    def words(self) -> str:
        """The answer without its line breaks."""
        return " ".join(self.output.split())


def answered(out: Path, *arguments: object) -> Answer:
    """The answer of a command that succeeds, with this folder for its files."""
    output = io.StringIO()
    errors = io.StringIO()
    with redirect_stdout(output), redirect_stderr(errors):
        assert run(*arguments, "--out", out) == cli.DONE
    return Answer(out, output.getvalue(), errors.getvalue())


def document(folder: Path, name: str) -> dict[str, Any]:
    """A document of a campaign."""
    return json.loads((folder / f"{name}.json").read_text())


def words(capsys: Screen) -> str:
    """The answer without its line breaks."""
    return " ".join(capsys.readouterr().out.split())


def wrong(capsys: Screen, *arguments: object) -> str:
    """The one line about wrong use."""
    capsys.readouterr()
    assert run(*arguments) == cli.WRONG
    line = capsys.readouterr().err
    assert line.startswith("grosmc-mj: ")
    assert line.count("\n") == 1
    return line


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


@pytest.fixture(scope="module")
def resumed(file: Path, folder: Path) -> Answer:
    """The answer of a campaign that was complete already."""
    return answered(folder, "campaign", file, "--runs", "16", "--resume", "--no-figures")


@pytest.mark.parametrize(
    "phrase", ["1 of 1 part is there already.", "deviation below 3 mrad", "no proof"]
)
def test_a_complete_campaign_is_answered_again(phrase: str, resumed: Answer) -> None:
    assert phrase in resumed.words


@pytest.mark.parametrize(("runs", "code"), [(4, cli.DIFFERS), (5, cli.DONE)])
def test_five_runs_without_failure_show_50_percent(
    runs: int, code: int, tmp_path: Path, capsys: Screen
) -> None:
    """0.5^5 is below a doubt of 5 %, 0.5^4 above it."""
    path = tmp_path / "easy.toml"
    path.write_text(servo(laws=LQR, limits=deviation_below("100 mrad")))
    claim = ("--at-least", "0.5", "--no-figures", "--out", tmp_path / "out")
    assert run("campaign", path, "--runs", runs, *claim) == code
    answer_words = words(capsys)
    assert "of the declared design keep everything" in answer_words
    assert "50 % are asked for" in answer_words


@pytest.fixture(scope="module")
def free(tmp_path_factory: pytest.TempPathFactory) -> Answer:
    """The answer of sixteen runs without a requirement."""
    folder = tmp_path_factory.mktemp("free")
    path = folder / "free.toml"
    path.write_text(servo(laws=LQR, limits=""))
    return answered(folder / "out", "campaign", path, "--runs", "16", "--verbose")


def test_a_law_of_which_nothing_is_required_is_named(free: Answer) -> None:
    assert "lqr completes, and nothing more is required of it, on 16 of 16" in free.words


def test_without_a_requirement_runs_are_counted(free: Answer) -> None:
    assert "16 of 16" in free.words


def test_without_a_requirement_nothing_is_drawn(free: Answer) -> None:
    assert not list(free.folder.glob("map.*"))


SCREENED = ("--no-figures", "--runs", "64", "--screen", "equations")
OTHER_INTEGRATOR = "instead of the model's own"


@pytest.fixture(scope="module")
def screened(file: Path, tmp_path_factory: pytest.TempPathFactory) -> Answer:
    """The answer of runs that are screened by equations."""
    return answered(tmp_path_factory.mktemp("screened"), "campaign", file, *SCREENED)


def judges_of(folder: Path) -> list[str]:
    """The judge of each run."""
    return pq.read_table(folder / PART)["judged_by"].to_pylist()


def test_the_answer_says_who_judged(screened: Answer) -> None:
    count = judges_of(screened.folder).count("equations")
    assert f"{count} of 64 runs judged by the equations, " in screened.output


def test_the_model_s_own_integrator_needs_no_notice(screened: Answer) -> None:
    assert OTHER_INTEGRATOR not in screened.errors


def test_a_plant_s_file_says_who_judged(screened: Answer) -> None:
    number = judges_of(screened.folder).index("equations")
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
    path = tmp_path / "wrong.toml"
    path.write_text(servo(2 * AMPLITUDE, laws=LQR, limits=DEVIATION))
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


@pytest.mark.parametrize(
    ("asked", "code"), [((), cli.DIFFERS), (("--at-least", "0.005"), cli.DONE)]
)
def test_a_plant_that_a_search_finds_to_fail_decides_unless_a_share_is_asked_for(
    file: Path, tmp_path: Path, asked: tuple[str, ...], code: int
) -> None:
    """Of eight plants one keeps everything, and so at least 0.6 % of all, with 95 % confidence."""
    options = ("--runs", "8", "--out", tmp_path, "--no-figures", "--radius")
    assert run("campaign", file, *options, *asked) == code
    assert document(tmp_path, "results")["answers"][0]["verdict"] == (
        "not kept" if code else "kept"
    )


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


EACH_PLANT = pytest.mark.parametrize("which", ["3", "worst", "shrunk", "outside"])


@EACH_PLANT
def test_a_plant_s_file_is_run_like_any_other(
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


@EACH_PLANT
def test_a_plant_s_file_that_was_changed_is_kept(
    which: str, folder: Path, tmp_path: Path, capsys: Screen
) -> None:
    assert run("campaign", folder, "--plant", which, "--out", tmp_path) == cli.DONE
    # The same command again writes the same.
    assert run("campaign", folder, "--plant", which, "--out", tmp_path) == cli.DONE
    file = tmp_path / f"small_{which}_lqr.toml"
    file.write_text(file.read_text() + "# mine\n")
    line = wrong(capsys, "campaign", folder, "--plant", which, "--out", tmp_path)
    assert f"{file} is there already with other content: rename or remove it" in line
    assert file.read_text().endswith("# mine\n")


NAMED_LIKE_A_PATH = """
[[controller]]
law = "lqr"
name = "/../../../up/../a.b"
"""


def test_a_name_in_a_folder_leads_nowhere_else(tmp_path: Path) -> None:
    file = tmp_path / "case.toml"
    file.write_text(servo(AMPLITUDE, laws=NAMED_LIKE_A_PATH, limits=DEVIATION))
    out = tmp_path / "deep" / "er" / "out"
    assert run("campaign", file, "--runs", "1", "--out", out, "--no-figures") == cli.DIFFERS
    assert run("campaign", out, "--plant", "0") == cli.DONE
    (written,) = out.glob("*.toml")
    assert written.name == "case_0__.._.._.._up_.._a.b.toml"
    assert set(tmp_path.rglob("*.toml")) == {file, written}
