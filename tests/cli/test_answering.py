"""Commands that answer: what is refused before the work, and what an interrupt leaves."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from commands import Screen, assert_one_line, run

from grosmc_mj import cli
from grosmc_mj.cli.answering import AnsweringCommand, Question
from grosmc_mj.cli.screen import AGAIN
from grosmc_mj.ground.errors import SetupError
from grosmc_mj.output.results.result import KEPT, MEASURED, NOT_KEPT, OPEN, Answer, Result, result
from grosmc_mj.studies.margins.margins import Setup
from grosmc_mj.studies.margins.row import LawMargins
from grosmc_mj.studies.target import StudiedLaw


class Count(Question):
    """Counts pieces, and is stopped before one of them."""

    def __init__(self, path: Path, pieces: int, stop: BaseException | None = None) -> None:
        self.path = path
        self.finished = 0
        self._pieces = pieces
        self._stop = stop

    def measure(self) -> None:
        for _ in range(self._pieces):
            self.finished += 1
        if self._stop is not None:
            raise self._stop

    def result(self, *, complete: bool) -> Result | None:
        if not self.finished:
            return None
        verdict = KEPT if complete else OPEN
        answer = Answer(question="Count", verdict=verdict, words=f"{self.finished} pieces")
        return result("count", {}, complete=complete, answers=[answer])


@dataclass(frozen=True)
class CountCommand(AnsweringCommand):
    """Command of some counts."""

    asked: Sequence[Count] = ()

    def questions(self) -> Sequence[Question]:
        return self.asked


class Failing(Count):
    """A count that keeps nothing of what is required."""

    @property
    def kept(self) -> bool:
        return False


@pytest.mark.parametrize("kinds", [(Count, Failing), (Failing, Count)])
def test_one_answer_of_several_that_is_not_kept_makes_the_exit_code(
    kinds: Sequence[type[Count]], tmp_path: Path
) -> None:
    asked = [kind(tmp_path / f"{kind.__name__}.json", 1) for kind in kinds]
    assert CountCommand(asked=asked).execute() == cli.DIFFERS
    assert CountCommand(asked=[Count(tmp_path / "count.json", 1)] * 2).execute() == cli.DONE


@pytest.mark.parametrize("pieces", [0, 2])
def test_an_interrupt_leaves_what_is_finished(pieces: int, tmp_path: Path, capsys: Screen) -> None:
    count = Count(tmp_path / "count.json", pieces, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt) as stop:
        CountCommand(asked=[count]).execute()
    assert str(stop.value) == AGAIN

    assert count.path.exists() == bool(pieces)
    shown = capsys.readouterr().out
    assert shown.startswith("2 pieces.") == bool(pieces)
    if pieces:
        document = json.loads(count.path.read_text())
        assert document["complete"] is False
        assert document["answers"][0]["verdict"] == OPEN


def test_an_interrupt_names_the_questions_that_are_not_begun(tmp_path: Path) -> None:
    first = Count(tmp_path / "first.json", 1, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt, match=r"; not begun: second$"):
        CountCommand(asked=[first, Count(tmp_path / "second.json", 1)]).execute()


def test_the_headline_of_a_part_names_what_is_not_finished(
    tmp_path: Path, capsys: Screen, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One law of three is judged, and the second one's measurement is interrupted."""

    def measured(_: object, setup: Setup, law: StudiedLaw, *__: object) -> LawMargins:
        if law.name != "lqr":
            raise KeyboardInterrupt
        return LawMargins(setup=setup.name, law=law.name, impossible="made up")

    monkeypatch.setattr("grosmc_mj.studies.margins.margins.law_margins", measured)
    laws = ("lqr", "grosmc", "fl-pid")
    code = run("study", "margins", "servo/case1", "--laws", *laws, "--out", tmp_path)
    assert code == cli.INTERRUPTED
    printed = " ".join(capsys.readouterr().out.split())
    missing, _, headline = printed.partition("; so far: ")
    assert missing.startswith("Not finished: ")
    assert "lqr" not in missing.partition("grosmc")[0]
    assert "the task is not kept by lqr." in headline


def test_an_error_in_the_work_is_the_one_that_is_told(tmp_path: Path) -> None:
    """Not that of the place of the results, which has gone meanwhile."""
    place = tmp_path / "out"

    class Gone(Count):
        def measure(self) -> None:
            super().measure()
            place.write_text("a file")
            raise SetupError("no more licences")

    with pytest.raises(SetupError, match="no more licences"):
        CountCommand(asked=[Gone(place / "count.json", 1)]).execute()


def test_every_place_is_tried_before_the_first_measurement(tmp_path: Path) -> None:
    first = Count(tmp_path / "first.json", 1)
    (tmp_path / "second.json").mkdir()
    with pytest.raises(SetupError, match=r"second\.json"):
        CountCommand(asked=[first, Count(tmp_path / "second.json", 1)]).execute()
    assert not first.finished


@pytest.mark.parametrize(
    ("command", "document"),
    [("diff . .", "diff.json"), ("campaign servo --runs 8 --radius", "radius.json")],
)
def test_results_that_cannot_be_written_are_refused_before_they_are_made(
    command: str, document: str, tmp_path: Path, capsys: Screen, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("grosmc_mj.studies.comparison.comparison.compare", pytest.fail)
    (tmp_path / document).mkdir()
    assert run(*command.split(), "--out", ".") == cli.WRONG
    error = capsys.readouterr().err
    assert_one_line(error)
    assert document in error
    assert [path.name for path in tmp_path.iterdir()] == [document]


def test_a_part_of_the_work_is_open_but_for_what_is_not_kept() -> None:
    verdicts = (KEPT, MEASURED, OPEN, NOT_KEPT)
    answers = [Answer(question="Count", verdict=verdict, words="") for verdict in verdicts]
    part = result("count", {}, answers=answers).unfinished([])
    assert not part.complete
    assert [answer.verdict for answer in part.answers] == [OPEN, OPEN, OPEN, NOT_KEPT]


def stopped_sweep(*_: object) -> Iterator[dict[str, Any]]:
    """A choice of a claim, and an interrupt at the second one."""
    trial = {"choice": "1", "measured": 1.0, "holds": True}
    yield {
        "claim": "servo-index",
        "choice": "gain",
        "printed": "1",
        "values": [trial],
        "flips": "",
    }
    raise KeyboardInterrupt


@pytest.mark.parametrize("record", [False, True])
def test_a_part_of_the_sweeps_is_kept_but_never_recorded(
    record: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded = tmp_path / "recorded.json"
    monkeypatch.setattr("grosmc_mj.chapter.claims.sweep.sweep", stopped_sweep)
    monkeypatch.setattr("grosmc_mj.chapter.claims.sweep.STORED", recorded)
    options = ("--record",) if record else ()
    assert run("claims", "sweep", *options, "--out", tmp_path) == cli.INTERRUPTED
    assert not recorded.exists()
    assert (tmp_path / "sweeps.json").exists() is not record
