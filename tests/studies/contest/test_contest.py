"""Laws that are tuned by one budget are judged alike, and the simplest that keeps all is named."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from commands import run
from tune_cases import BLOCK, PLANTS, number_row, write_block

from grosmc_mj import Experiment
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.output.results.verdicts import Verdict
from grosmc_mj.studies.contest.answer import contest_result, contest_table
from grosmc_mj.studies.contest.contest import ContestStudy, contest_study
from grosmc_mj.studies.contest.row import ContestLaw, Entry, simplest
from grosmc_mj.studies.study import CellRunner
from grosmc_mj.studies.tune.row import AS_IN_FILE, TUNED
from grosmc_mj.studies.tune.tune import HELD_OUT

# Beside a PD of two numbers: one that has its damping, and one that has hardly any.
RIVALS = '''

def critical(t, x, memory, p):
    """PD of the block with a damping of 1."""
    return p.frequency**2 * (1.0 - x[0]) - 2 * p.frequency * x[1]


def swinging(t, x, memory, p):
    """PD of the block with hardly any damping."""
    return p.frequency**2 * (1.0 - x[0]) - 0.02 * p.frequency * x[1]
'''
CONTROLLERS = [
    BLOCK["controller"],
    {"name": "critical", "law": "plants:critical", "frequency": 0.4},
    {"name": "swinging", "law": "plants:swinging", "frequency": 0.4},
]


def write_contest(folder: Path, **tables: Any) -> Path:
    """Write the block with three laws, and return the path of its case."""
    path = write_block(folder, **({"controller": CONTROLLERS} | tables))
    (folder / "plants.py").write_text(PLANTS + RIVALS, encoding="utf-8")
    return path


def uncertain(low: float, high: float) -> dict[str, Any]:
    """Return the table of a mass that is uncertain by a factor."""
    return {"number": "edit.m.scale", "values": [low, high]}


def contested(study: ContestStudy, folder: Path, *, resume: bool = False) -> list[ContestLaw]:
    """The rows of all laws."""
    return list(study.rows(study.cells(), CellRunner(folder, ContestLaw, resume)))


@pytest.fixture(scope="module")
def contest(tmp_path_factory: pytest.TempPathFactory) -> tuple[ContestStudy, list[ContestLaw]]:
    """A contest of three laws."""
    folder = tmp_path_factory.mktemp("contest")
    study = contest_study(str(write_contest(folder)), runs=30)
    return study, contested(study, folder / "pieces")


def test_laws_have_two_rows_and_are_judged_alike(contest: tuple[ContestStudy, list[ContestLaw]]):
    _, rows = contest
    assert [row.law for row in rows] == ["mine", "critical", "swinging"]
    for row in rows:
        assert row.runs <= 30
        assert [entry.step for entry in row.entries] == [AS_IN_FILE, TUNED]
        for entry in row.entries:
            assert [verdict.condition for verdict in entry.verdicts] == ["nominal"]
            assert entry.largest_input is not None
            assert 0 < entry.largest_input <= 1.5
            assert entry.variation is not None
            assert entry.variation > 0


def test_the_simplest_law_that_keeps_all_wins(contest: tuple[ContestStudy, list[ContestLaw]]):
    study, rows = contest
    mine, critical, swinging = rows
    assert mine.kept
    assert critical.kept
    # A double integrator without damping overshoots by the whole step, whatever its frequency.
    assert not swinging.kept
    assert simplest(rows) is critical

    document = contest_result(study, rows, complete=True)
    assert "2 of 3 laws keep all, tuned: mine, critical" in document.answers[0].words
    assert "simplest: critical, 1 tuned number" in document.answers[0].words
    assert [standing.law for standing in document.standings if standing.breaks_at] == ["swinging"]


def test_only_a_law_that_keeps_its_task_has_margins(
    contest: tuple[ContestStudy, list[ContestLaw]],
):
    _, rows = contest
    for row in rows:
        for entry in row.entries:
            has_margins = entry.margin("delay") != "-"
            assert has_margins is entry.kept


def test_a_resumed_contest_is_the_same_to_the_bit(
    tmp_path: Path, contest: tuple[ContestStudy, list[ContestLaw]]
):
    study, whole = contest
    cells = study.cells()
    next(study.rows(cells, CellRunner(tmp_path, ContestLaw)))
    assert contested(study, tmp_path, resume=True) == whole


def test_the_law_that_keeps_most_draws_is_named_beside_the_nearest(
    contest: tuple[ContestStudy, list[ContestLaw]],
):
    study, rows = contest
    verdicts = {
        "mine": [Verdict(share=0.2, kept_draws=1), Verdict(share=5.0, condition="case1")],
        "critical": [Verdict(share=1.5), Verdict(share=4.0, condition="case1")],
    }
    failing = [
        row.model_copy(update={"entries": [Entry(step=TUNED, verdicts=verdicts[row.law])]})
        for row in rows[:2]
    ]
    answer = contest_result(study, failing, complete=True).answers[0]
    assert answer.words == "None of 2 laws keeps all with the numbers found"
    assert answer.more.startswith("Nearest: critical, ")
    assert answer.more.endswith("; most draws: mine, 1 of 2.")


def standing(name: str, numbers: int, share: float) -> ContestLaw:
    """Return the row of a law with so many tuned numbers, at this share of its limits."""
    number = number_row("k")
    entry = Entry(step=TUNED, verdicts=[Verdict(law=name, share=share)])
    return ContestLaw(law=name, numbers=[number] * numbers, entries=[entry])


def test_few_numbers_come_before_a_small_share():
    failing = standing("failing", 0, 1.1)
    keeping = [standing("two", 2, 0.2), standing("one", 1, 0.9), standing("near", 1, 0.8)]
    assert simplest([*keeping, failing]) is keeping[2]
    assert simplest([failing]) is None


def test_plants_have_a_column_and_none_has_been_seen(tmp_path: Path):
    path = write_contest(tmp_path, uncertain=uncertain(0.8, 1.25))
    study = contest_study(str(path), ["critical"], runs=30, plants=2, held_out=6)
    rows = contested(study, tmp_path / "pieces")
    tuned = rows[0].tuned
    assert tuned is not None
    plants = tuned.on_plants
    assert plants is not None
    assert plants.draws == 6
    assert plants.draw >= HELD_OUT

    table = contest_table(study, rows)
    place = [column.header for column in table.columns].index("plants kept")
    cells = [row[place] for row in table.rows]
    assert cells[-1] == f"{plants.kept_draws} of 6"


def test_six_of_six_plants_are_half_of_all_at_least(tmp_path: Path):
    """The interval of Clopper and Pearson is exact: 0.025^(1/6) = 0.54."""
    path = write_contest(tmp_path, uncertain=uncertain(1.0, 1.01))
    study = contest_study(str(path), ["critical"], runs=30, plants=1, held_out=6)
    table = contest_table(study, contested(study, tmp_path / "pieces"))
    place = [column.header for column in table.columns].index("plants kept")
    assert list(table.rows[-1][place : place + 2]) == ["6 of 6", "54 to 100 %"]


def test_the_worst_disturbance_is_searched_with_both_kinds_of_numbers(tmp_path: Path):
    """A stiffer PD gives way less."""
    held = {"stays_within": "0.1 m", "after": "5 s"}
    path = write_contest(tmp_path, requirement=[BLOCK["requirement"], held])
    study = contest_study(str(path), ["critical"], runs=30, on="force", bound="0.05 N")
    (row,) = contested(study, tmp_path / "pieces")
    in_file, tuned = row.entries
    assert in_file.worst_disturbance is not None
    assert tuned.worst_disturbance is not None
    assert tuned.worst_disturbance < in_file.worst_disturbance
    headers = [column.header for column in contest_table(study, [row]).columns]
    assert "worst disturbance" in headers


def test_a_place_of_a_disturbance_needs_a_bound(tmp_path: Path):
    path = write_contest(tmp_path)
    with pytest.raises(ArgumentError, match="--on and --bound go together"):
        contest_study(str(path), ["critical"], on="force")
    with pytest.raises(ArgumentError, match="nowhere"):
        contest_study(str(path), ["critical"], on="nowhere", bound="1 N")


def test_a_law_that_cannot_be_tuned_is_named_and_the_others_contend(tmp_path: Path):
    path = write_contest(tmp_path)
    study = contest_study(str(path), ["critical", "mine"], runs=30)

    def progress(text: str = "", by: int = 1) -> None:
        if text.startswith("critical"):
            raise ArgumentError("no design can be made")

    runner = CellRunner(tmp_path / "pieces", ContestLaw, False, progress)
    rows = list(study.rows(study.cells(), runner))
    assert [row.refused for row in rows] == ["no design can be made", ""]
    assert simplest(rows) is rows[1]
    answer = contest_result(study, rows, complete=True).answers[0]
    assert answer.notes == ["critical was not tuned: no design can be made"]
    assert contest_table(study, rows).rows[0][:2] == ["critical", "not tuned"]


def test_a_law_with_other_numbers_contends_once(tmp_path: Path):
    again = {"name": "quick", "law": "plants:critical", "frequency": 3.0}
    path = write_contest(tmp_path, controller=[*CONTROLLERS, again])
    study = contest_study(str(path))
    assert [law.name for law in study.tuning.laws] == ["mine", "critical", "swinging"]
    assert study.left_out == {"quick": "critical with other numbers"}


@pytest.mark.parametrize(
    ("laws", "code", "figures"),
    [(["critical"], 0, "--figures"), (["swinging"], 1, "--no-figures")],
)
def test_exit_code_says_whether_a_law_keeps_all(
    tmp_path: Path, laws: list[str], code: int, figures: str
):
    path = write_contest(tmp_path)
    out = tmp_path / "out"
    options = ["--laws", *laws, "--runs", 14, figures, "--out", out]
    assert run("study", "contest", path, *options) == code
    document = json.loads((out / "contest_mine.json").read_text(encoding="utf-8"))
    assert [law["law"] for law in document["laws"]] == laws
    assert (out / "contest_mine.png").exists() == (figures == "--figures")
    # The case of the tuned laws, beside the file.
    tuned = tmp_path / "contest_mine.toml"
    assert [item["name"] for item in Experiment.load(tuned).file.content["controller"]] == laws
    assert run("run", tuned, "--out", out) == code


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"laws": ["nothing"]}, "nothing"),
        ({"runs": 0}, "--runs 0 must be 1 at least"),
        ({"conditions": ["case9"]}, "case9"),
        ({"plants": 4}, "nothing is uncertain"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, options: dict[str, object], message: str):
    path = write_contest(tmp_path)
    with pytest.raises(ArgumentError, match=message):
        contest_study(str(path), **options)  # pyright: ignore[reportArgumentType]


def test_a_case_without_requirements_is_refused(tmp_path: Path):
    path = write_contest(tmp_path, requirement=[])
    with pytest.raises(ArgumentError, match="nothing is required"):
        contest_study(str(path))
