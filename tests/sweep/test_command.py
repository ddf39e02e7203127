"""grosmc-mj campaign: the files, the exit codes, wrong use in one line."""

import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from campaign_cases import AMPLITUDE, DEVIATION, LQR, servo
from commands import Patch, Screen, run

from grosmc_mj import cli
from grosmc_mj.cli.commands.campaign import answer
from grosmc_mj.cli.commands.campaign.command import CampaignCommand
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.sweep import map as maps
from grosmc_mj.sweep.runs import Row, run_rows
from grosmc_mj.sweep.store import Folder

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
    assert run(*sixteen, *SEARCHES) == cli.DONE
    return path


def document(folder: Path, name: str) -> dict[str, Any]:
    return json.loads((folder / f"{name}.json").read_text())


def words(capsys: Screen) -> str:
    """The answer without its line breaks."""
    return " ".join(capsys.readouterr().out.split())


def wrong(capsys: Screen, *arguments: object) -> str:
    """The one line about wrong use."""
    capsys.readouterr()
    assert run(*arguments) == cli.WRONG
    line = capsys.readouterr().err
    assert (line.startswith("grosmc-mj: "), line.count("\n")) == (True, 1)
    return line


def test_documents_have_the_numbers_of_the_runs(file: Path, folder: Path, capsys: Screen) -> None:
    documents = {"manifest.json", "results.json", "worst.json", "radius.json"}
    assert {path.name for path in folder.iterdir()} == {".lock", "parts", *documents}
    results = document(folder, "results")
    assert results["sampled"]["words"] == "16 runs, random, seed 0"
    relative = pq.read_table(folder / PART)["relative"].to_numpy()
    rates = {rate["requirement"]: rate for rate in results["pass_rates"]}
    assert rates["all requirements"]["kept"] == (relative >= 0).sum()
    assert document(folder, "worst")["controllers"]["lqr"]["relative"] <= relative.min()
    again = ("campaign", file, "--runs", "16", "--out", folder, "--resume", "--no-figures")
    capsys.readouterr()
    assert run(*again) == cli.DONE
    shown = words(capsys)
    for phrase in ("1 of 1 parts are there already.", "deviation below 3 mrad", "no proof"):
        assert phrase in shown


def test_five_runs_without_failure_show_50_percent(tmp_path: Path, capsys: Screen) -> None:
    """0.5^5 is below a doubt of 5 %, 0.5^4 above it."""
    path = tmp_path / "easy.toml"
    path.write_text(TEXT.replace("3 mrad", "100 mrad"))
    for runs, code in ((4, cli.DIFFERS), (5, cli.DONE)):
        claim = ("--at-least", "0.5", "--no-figures", "--out", tmp_path / str(runs))
        assert run("campaign", path, "--runs", runs, *claim) == code
        shown = words(capsys)
        assert "of the declared design keep everything" in shown
        assert "50 % are asked for" in shown
    path.write_text(servo(laws=LQR, limits=""))
    assert run("campaign", path, "--runs", "16", "--out", tmp_path / "out", "--verbose") == cli.DONE
    shown = words(capsys)
    assert "lqr: nothing is required of it." in shown
    assert "16 of 16" in shown
    assert not list((tmp_path / "out").glob("map.*"))


def test_who_judged_is_shown_and_why(file: Path, tmp_path: Path, capsys: Screen) -> None:
    screened = ("campaign", file, "--no-figures", "--runs", "64", "--screen", "equations", "--out")
    assert run(*screened, tmp_path / "a") == cli.DONE
    shown = capsys.readouterr()
    judges = pq.read_table(tmp_path / "a" / PART)["judged_by"].to_pylist()
    assert f"{judges.count('equations')} of 64 runs judged by the equations, " in shown.out
    number = judges.index("equations")
    assert run("campaign", tmp_path / "a", "--plant", number) == cli.DONE
    text = (tmp_path / "a" / f"small_{number}_lqr.toml").read_text()
    assert f"run {number} under lqr, judged by the equations." in text
    capsys.readouterr()
    assert run(*screened, tmp_path / "b", "--integrator", "implicitfast") == cli.DONE
    why = "equations are stepped by RK4, the model by implicitfast"
    other = capsys.readouterr()
    assert f"No run is screened by equations: {why}." in other.err
    assert ["instead of the model's own" in of.err for of in (shown, other)] == [False, True]


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


def test_a_wrong_file_or_folder_is_one_line(folder: Path, tmp_path: Path, capsys: Screen) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(servo(2 * AMPLITUDE, laws=LQR, limits=DEVIATION))
    for command in ("run", "campaign"):
        line = wrong(capsys, command, path, "--out", tmp_path / "out")
        assert "two are uncertain 'load amplitude'" in line
    assert not (tmp_path / "out").exists()
    line = wrong(capsys, "campaign", folder)
    assert "is a campaign's folder: --plant WHICH writes the case file of one of its plants" in line


def test_a_second_campaign_waits_for_the_first(
    file: Path, tmp_path: Path, capsys: Any, monkeypatch: Patch
) -> None:
    eight = ("campaign", file, "--runs", "8", "--out", tmp_path, "--no-figures")
    with Folder(tmp_path).held():
        for more in ((), ("--resume",)):
            assert "another grosmc-mj campaign adds parts to it" in wrong(capsys, *eight, *more)
        assert [path.name for path in tmp_path.iterdir()] == [".lock"]

    def interrupted(*_: Any, **__: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr("grosmc_mj.sweep.store.run_missing", interrupted)
    with pytest.raises(KeyboardInterrupt) as stop:
        CampaignCommand(str(file), runs=8, out=tmp_path).execute()
    assert str(stop.value) == (
        "interrupted: 0 of 1 parts are done; the same command with --resume runs the others"
    )


def test_results_are_written_before_shown(file: Path, tmp_path: Path, monkeypatch: Patch) -> None:
    written: dict[str, set[str]] = {}

    def shows(name: str, returned: Any) -> Any:
        def show(*_: Any, **__: Any) -> Any:
            written[name] = {path.stem for path in tmp_path.glob("*.json")} - {"manifest"}
            return returned

        return show

    for name in ("say_verdict", "say_worst", "say_radius"):
        monkeypatch.setattr(answer, name, shows(name, cli.DONE))
    monkeypatch.setattr(maps, "write_figures", shows("figures", []))
    assert run("campaign", file, "--runs", "8", "--out", tmp_path, *SEARCHES) == cli.DONE
    # The verdict comes before searches and figures.
    assert [len(names) for names in written.values()] == [1, 2, 3, 3]
    assert [*written] == ["say_verdict", "say_worst", "say_radius", "figures"]


@pytest.mark.parametrize("which", ["3", "worst", "shrunk", "outside"])
def test_a_plant_s_file_is_run_like_any_other(
    which: str, folder: Path, tmp_path: Path, capsys: Screen
) -> None:
    worst, radius = (document(folder, name)["controllers"]["lqr"] for name in ("worst", "radius"))
    least = {look["scale"]: look["least"] for look in radius["looks"]}
    relative = {
        "3": pq.read_table(folder / PART)["relative"][3].as_py(),
        "worst": worst["relative"],
        "shrunk": worst["shrunk_relative"],
        "outside": least[radius["outside_scale"]],
    }
    assert run("campaign", folder, "--plant", which, "--out", tmp_path) == cli.DONE
    file = tmp_path / f"small_{which}_lqr.toml"
    assert capsys.readouterr().out.endswith(f"{file}\ngrosmc-mj run {file}\n")
    # The same command again writes the same; what somebody has changed is kept.
    assert run("campaign", folder, "--plant", which, "--out", tmp_path) == cli.DONE

    outcome = run_rows(Experiment.load(file), [Row("lqr")])
    assert outcome["relative"].tolist() == [relative[which]]
    code = cli.DONE if relative[which] >= 0 else cli.DIFFERS
    assert run("run", file, "--no-figures", "--out", tmp_path) == code
    assert run("diff", tmp_path, tmp_path, "--out", tmp_path / "diff") == cli.DONE

    file.write_text(file.read_text() + "# mine\n")
    line = wrong(capsys, "campaign", folder, "--plant", which, "--out", tmp_path)
    assert f"{file} is there already with other content: rename or remove it" in line
    assert file.read_text().endswith("# mine\n")


def test_a_name_in_a_folder_leads_nowhere_else(tmp_path: Path) -> None:
    file, out = tmp_path / "case.toml", tmp_path / "deep" / "er" / "out"
    laws = LQR + 'name = "/../../../up/../a.b"\n'
    file.write_text(servo(AMPLITUDE, laws=laws, limits=DEVIATION))
    assert run("campaign", file, "--runs", "1", "--out", out, "--no-figures") == cli.DONE
    assert run("campaign", out, "--plant", "0") == cli.DONE
    (written,) = out.glob("*.toml")
    assert written.name == "case_0__.._.._.._up_.._a.b.toml"
    assert set(tmp_path.rglob("*.toml")) == {file, written}
