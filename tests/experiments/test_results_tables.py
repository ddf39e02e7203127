"""Results of a run: its tables, its answer, how each law stands, and its comparable values."""

from __future__ import annotations

from dataclasses import replace

import pytest

from grosmc_mj.experiments.document import experiment_document
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.requirements import Judgement, judge_all
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.experiments.tables import results_table
from grosmc_mj.results.document import json_text
from grosmc_mj.results.result import Result

CASE = """
[plant]
system = "servo"
compare = ["corrected"]
[run]
start = { "rotor angle" = "0.5 rad" }
duration = "0.05 s"
engine = "python"
[[controller]]
law = "lqr"
[[controller]]
law = "grosmc"
[[requirement]]
of = ["lqr"]
input_below = "1 kA"
stays_within = "0.1 rad"
"""


def test_the_table_of_a_system_has_a_row_for_each_run() -> None:
    experiment = Experiment.load("arm/nominal").varied(duration=0.02)
    runs = [experiment.run("corrected", law) for law in ("lqr", "grosmc")]
    arm = results_table(runs)
    assert str(arm.title).startswith(runs[0].trajectory.system.title)
    assert [row[2] for row in arm.rows] == ["lqr", "grosmc"]


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> tuple[Experiment, list[RunResult]]:
    file = tmp_path_factory.mktemp("case") / "mine.toml"
    file.write_text(CASE, encoding="utf-8")
    experiment = Experiment.load(file)
    return experiment, list(experiment.runs())


def result_of(
    judged: tuple[Experiment, list[RunResult]], judgements: list[Judgement], *, complete: bool
) -> Result:
    content = experiment_document(*judged, judgements, complete=complete)
    return Result.model_validate_json(json_text(content))


def test_a_run_answers_which_requirement_is_nearest_and_where_each_law_stands(
    judged: tuple[Experiment, list[RunResult]],
) -> None:
    experiment, runs = judged
    judgements = judge_all(experiment.limits, runs)
    found = result_of(judged, judgements, complete=True)
    (answer,), within = found.answers, "stays within: 0.5 of 0.1 rad"
    assert (answer.verdict, answer.more) == ("not kept", f"tightest: {within} by lqr on corrected")
    assert answer.words == "1 of 2 requirements are not kept"
    standings = [(each.law, each.breaks_at, each.words) for each in found.standings]
    assert standings == [
        ("lqr", "corrected", within),
    ]  # fmt: skip
    titles = [sheet.table.title.split(":")[0] for sheet in found.sheets]
    assert titles == ["Requirements", experiment.nominal.system.title, ""]
    kept = [item for item in judgements if item.kept]
    for complete, verdict in ((True, "kept"), (False, "not decided")):
        (answer,) = result_of(judged, kept, complete=complete).answers
        assert answer.verdict == verdict
    (answer,) = result_of(judged, [], complete=True).answers
    assert (answer.verdict, answer.more) == ("kept", "")
    (ended,) = (replace(run, ended="diverged") for run in runs[:1])
    (answer,) = result_of((experiment, [ended]), [], complete=True).answers
    assert answer.verdict == "not kept"


def test_values_repeat_as_closely_as_their_law_lets_them(
    judged: tuple[Experiment, list[RunResult]],
) -> None:
    experiment, runs = judged
    found = result_of(judged, judge_all(experiment.limits, runs), complete=True)
    values = {value.name: value for value in found.values}
    margin = values["servo/mine corrected lqr: stays within 0.1 rad, margin"]
    assert (margin.unit, margin.better, margin.relative) == ("rad", 1, 1e-6)
    assert (margin.value, margin.size) == (pytest.approx(-0.4), pytest.approx(0.5))
    assert values["servo/mine corrected lqr: status"].value == "completed"
    smooth = values["servo/mine corrected lqr: deviation"]
    rough = values["servo/mine corrected grosmc: deviation"]
    assert (smooth.relative, rough.relative, rough.absolute) == (1e-6, 0.25, 1e-4)
    assert rough.value == runs[1].metrics["deviation"].value
