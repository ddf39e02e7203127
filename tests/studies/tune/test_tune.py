"""Numbers of a law are found that keep all, judged on draws of no search, and written."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np
import pytest
from commands import Screen, run
from tune_cases import BLOCK, number_row, write_block, write_lag

from grosmc_mj import Experiment
from grosmc_mj.experiments.file.paths import place_of
from grosmc_mj.experiments.number import Number
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.fields import Range
from grosmc_mj.output.results.verdicts import Verdict, verdict_of
from grosmc_mj.studies.study import CellRunner
from grosmc_mj.studies.tune.answer import binding, conflict, numbers_table, shares_of
from grosmc_mj.studies.tune.numbers import TunedNumber, ranges_of, start_of
from grosmc_mj.studies.tune.row import TUNED, TunedLaw
from grosmc_mj.studies.tune.shares import Measure, TriedDesign
from grosmc_mj.studies.tune.tune import TuneStudy, tune_study

BLOCK_NUMBERS = ("laws.mine.frequency=0.2..20", "laws.mine.damping=0.2..2")
# Bang-bang takes longer.
IMPOSSIBLE = {"settles_within": "0.9 s", "overshoot_below": 0.02}
LAG_NUMBERS = ("laws.mine.kp=0.1..10", "laws.mine.ki=0.05..10")


def tuned(study: TuneStudy, folder: Path, *, resume: bool = False) -> TunedLaw:
    """The row of the first law."""
    return next(study.rows(study.cells(), CellRunner(folder, TunedLaw, resume)))


def gridded(study: TuneStudy, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points of a grid over the ranges, and the share of each."""
    law = study.laws[0]
    axes = [
        np.linspace(number.coordinate(number.low), number.coordinate(number.high), count)
        for number in law.numbers
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    measure = Measure(law, list(study.conditions))
    return points, np.exp(measure.tried(points, np.full(len(points), np.inf)).values)


# -- oracles ---------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("plant", ["block", "lag"])
def test_the_best_of_a_dense_grid_is_found(tmp_path: Path, plant: str, seed: int):
    path = write_block(tmp_path) if plant == "block" else write_lag(tmp_path)
    numbers = BLOCK_NUMBERS if plant == "block" else LAG_NUMBERS
    study = tune_study(str(path), ["mine"], numbers, conditions=["nominal"], runs=300, seed=seed)
    _, shares = gridded(study, 31)
    # Few points keep all: luck would not do.
    assert np.mean(shares < 1) < 0.07

    row = tuned(replace(study, target_share=1e-3), tmp_path / "pieces")
    assert row.share <= 1.02 * shares.min()


@pytest.mark.slow
def test_the_block_settles_no_sooner_than_bang_bang(tmp_path: Path):
    """At most 1.5 N move 1 kg by 0.98 m, the edge of the band, in sqrt(2 0.98/1.5) s at best."""
    study = tune_study(str(write_block(tmp_path)), ["mine"], BLOCK_NUMBERS, runs=120)
    row = tuned(replace(study, target_share=1e-3), tmp_path / "pieces")
    (after,) = row.after
    fastest = math.sqrt(2 * 0.98 / 1.5)
    assert fastest <= 3.0 * after.shares["settles_within"] <= 1.6


def test_what_no_numbers_keep_is_not_found(tmp_path: Path):
    path = write_block(tmp_path, requirement=IMPOSSIBLE)
    study = tune_study(str(path), ["mine"], BLOCK_NUMBERS, runs=30)
    row = tuned(study, tmp_path / "pieces")
    assert not row.found
    assert not row.kept
    assert row.share > 1
    assert row.runs == 30


# -- the search ------------------------------------------------------------------------------------


def drawn_lag(folder: Path, draws: int = 3, **options: object) -> TuneStudy:
    """The lag with late samples and an encoder, so that draws differ."""
    path = write_lag(
        folder,
        computing={"delay": "0.3 s", "missed": 0.2},
        sensor={"of": "y", "resolution": "10 mm"},
    )
    study = tune_study(str(path), ["mine"], LAG_NUMBERS, runs=90, draws=draws, held_out=4)
    return replace(study, target_share=1e-3, **options)


def test_racing_finds_the_same_and_runs_less(tmp_path: Path):
    # Two populations: after them the search without races has no runs left for a third one.
    count = 24
    racing, plain = (
        tuned(drawn_lag(tmp_path, races=races), tmp_path / f"races {races}")
        for races in (True, False)
    )
    assert len(racing.designs) > len(plain.designs)
    assert not all(design.complete for design in racing.designs[:count])
    for first, second in zip(racing.designs[:count], plain.designs[:count], strict=True):
        assert first.point == second.point
        if first.complete:
            assert first.value == second.value
        else:
            assert first.value <= second.value
    best = [
        min(design.value for design in row.designs[:count] if design.complete)
        for row in (racing, plain)
    ]
    assert best[0] == best[1]


def test_a_resumed_search_is_the_same_to_the_bit(tmp_path: Path):
    whole = tuned(drawn_lag(tmp_path), tmp_path / "whole")

    class Interrupted(CellRunner[TunedLaw]):
        """Interrupts after some batches."""

    batches = 0

    def progress(text: str = "", by: int = 1) -> None:
        nonlocal batches
        batches += 1
        if batches == 4:
            raise KeyboardInterrupt

    study = drawn_lag(tmp_path)
    rows = study.rows(study.cells(), Interrupted(tmp_path / "pieces", TunedLaw, True, progress))
    partial = next(rows)
    assert not partial.complete
    assert partial.share == min(math.exp(d.value) for d in partial.designs if d.complete)
    with pytest.raises(KeyboardInterrupt):
        next(rows)

    finished = set((tmp_path / "pieces").iterdir())
    resumed = tuned(study, tmp_path / "pieces", resume=True)
    assert finished < set((tmp_path / "pieces").iterdir())
    assert resumed == whole


def test_a_longer_search_goes_on_from_a_shorter_one(tmp_path: Path):
    """Its populations ask the same, as far as the shorter one has asked."""
    path = str(write_block(tmp_path, requirement=IMPOSSIBLE))
    short = tune_study(path, ["mine"], runs=30)
    tuned(short, tmp_path / "pieces")
    before = set((tmp_path / "pieces").iterdir())
    longer = replace(short, runs=60)
    resumed = tuned(longer, tmp_path / "pieces", resume=True)
    alone = tuned(longer, tmp_path / "alone")
    assert resumed == alone
    batches = len(list((tmp_path / "alone").iterdir()))
    assert len(set((tmp_path / "pieces").iterdir()) - before) < batches


def test_the_law_of_the_file_is_the_first_member(tmp_path: Path):
    study = drawn_lag(tmp_path)
    row = tuned(study, tmp_path / "pieces")
    first = study.laws[0].values_at(np.array(row.designs[0].point))
    assert first == pytest.approx({"kp": 0.3, "ki": 0.1})


def test_draws_that_judge_are_none_that_were_tuned_on(tmp_path: Path):
    study = drawn_lag(tmp_path)
    row = tuned(study, tmp_path / "pieces")
    (after,) = row.after
    assert after.draws == 4
    assert after.draw >= 1000


@pytest.mark.parametrize("law", ["lqr", "implicit", "super-twisting", "grosmc adaptive"])
def test_the_share_of_the_first_design_is_that_of_the_law_in_the_file(tmp_path: Path, law: str):
    study = tune_study("servo/bench", [law], conditions=["nominal"], runs=2, draws=2)
    measure = Measure(study.laws[0], list(study.conditions))
    first = start_of(study.laws[0].numbers)[None]
    (design,) = measure.tried(first, np.array([np.inf])).designs
    (verdict,) = measure.judged(study.laws[0].as_in_file, TUNED, 0, 2)
    assert math.exp(design.value) == pytest.approx(verdict.share)
    can_fail = verdict.shares.keys() - measure.unfailing["nominal"]
    assert design.shares == {"nominal": {name: verdict.shares[name] for name in can_fail}}


# -- what an input limit and a run that ends do ----------------------------------------------------


def test_a_limit_that_cannot_fail_has_no_part_in_the_measure(tmp_path: Path):
    asked = {**BLOCK["requirement"], "input_below": "1.5 N"}
    path = write_block(tmp_path, requirement=asked)
    study = tune_study(str(path), ["mine"], BLOCK_NUMBERS, runs=12)
    measure = Measure(study.laws[0], list(study.conditions))
    assert measure.unfailing == {"nominal": {"input_below"}}

    fast = study.laws[0].designed({"frequency": 5.6, "damping": 1.17})
    (verdict,) = measure.judged(fast, TUNED, 0, 1)
    assert verdict.shares["input_below"] == 1
    assert verdict.tightest != "input_below"
    assert verdict.share == max(verdict.shares["settles_within"], verdict.shares["overshoot_below"])


def test_the_value_orders_what_never_settles(tmp_path: Path):
    """A slower block is further away when its run ends; an undamped one is the worst."""
    study = tune_study(str(write_block(tmp_path)), ["mine"], BLOCK_NUMBERS, runs=12)
    frequencies = np.log10([0.8, 0.5, 0.35, 0.2])
    points = np.column_stack([frequencies, np.zeros(4)])
    measure = Measure(study.laws[0], list(study.conditions))
    values = measure.tried(points, np.full(4, np.inf)).values
    assert np.all(np.isfinite(values))
    assert np.all(np.diff(values) > 0)


def test_a_condition_that_cannot_be_kept_is_no_reason_to_give_up_another_one():
    """The worst share alone would take the second design."""
    keeps_one = TriedDesign(point=[0.0], tightest={"loaded": math.log(7.4), "heavy": -0.2})
    keeps_none = TriedDesign(
        point=[1.0], tightest={"loaded": math.log(3.7), "heavy": math.log(2.8)}
    )
    assert keeps_one.value == math.log(7.4)
    assert keeps_one.value < keeps_none.value
    assert keeps_none.share == pytest.approx(3.7)


class JudgedRuns(NamedTuple):
    """Outcomes of runs: columns by name, and the verdict on each row."""

    columns: Mapping[str, np.ndarray]
    verdicts: Sequence[Verdict]

    def __getitem__(self, name: Any) -> Any:
        return self.columns[name]

    def verdict(self, row: int) -> Verdict:
        return self.verdicts[row]


def test_a_design_counts_by_its_worst_draw_in_any_batch():
    """A number that mends all draws but one mends nothing."""
    item: Any = SimpleNamespace(name="nominal")
    design = TriedDesign(point=[0.0])
    for used in ([9.0, 4.0, 0.9], [9.0, 0.8, 1.5]):
        verdicts = [verdict_of({"rise": share}) for share in used]
        outcomes: Any = JudgedRuns({"order": 1 - np.array(used)}, verdicts)
        Measure._note(cast(Measure, None), design, item, outcomes, [1, 2])
    assert design.tightest["nominal"] == pytest.approx(math.log(4.0))
    assert design.shares == {"nominal": {"rise": 4.0}}


def test_where_all_is_kept_the_worst_condition_counts():
    roomy = TriedDesign(point=[0.0], tightest={"loaded": -0.3, "heavy": -0.4})
    tight = TriedDesign(point=[1.0], tightest={"loaded": -0.1, "heavy": -3.0})
    assert roomy.value == -0.3
    assert roomy.value < tight.value


# -- requirements that exclude each other ----------------------------------------------------------


def tried(value: float, **shares: float) -> TriedDesign:
    return TriedDesign(point=[0.0], tightest={"nominal": value}, shares={"nominal": dict(shares)})


def test_two_requirements_that_exclude_each_other_are_named():
    designs = [
        tried(0.3, rise=1.35, overshoot=1.3),
        tried(0.9, rise=0.2, overshoot=2.5),
        tried(1.4, rise=4.0, overshoot=0.1),
    ]
    row = TunedLaw(law="mine", numbers=[], share=1.35, history=[], designs=designs, best=0, runs=3)
    assert binding(shares_of(designs[0])).requirement == "rise"
    found = conflict(row)
    assert found is not None
    assert (found.binding.requirement, found.other.requirement) == ("rise", "overshoot")
    assert (found.least, found.other.share) == (0.2, 2.5)
    assert found.words.startswith("of the designs tried, none keeps both rise and overshoot: ")


def test_a_requirement_that_nothing_helps_excludes_no_other():
    designs = [tried(0.3, rise=1.35, overshoot=1.3), tried(0.9, rise=1.34, overshoot=2.5)]
    row = TunedLaw(law="mine", numbers=[], share=1.35, history=[], designs=designs, best=0, runs=2)
    assert conflict(row) is None


# -- numbers ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("target", "names"),
    [
        ("servo/case1", ["Q[1]", "Q[2]"]),
        ("two_link_arm/case1", ["Q[1]", "Q[2]", "Q[3]", "Q[4]", "R[2]"]),
    ],
)
def test_all_weights_are_tuned_but_that_of_the_first_input(target: str, names: list[str]):
    """Only their ratios count."""
    study = tune_study(target, ["lqr"], conditions=["nominal"])
    assert [number.name for number in study.laws[0].numbers] == names


@pytest.mark.parametrize(("low", "high"), [(0.2, 30.0), (-30.0, -0.2)])
def test_a_number_of_either_sign_is_searched_by_the_logarithm_of_its_size(low: float, high: float):
    path = "laws.mine.gain"
    of_file = Number(path, "", Range(), (), place_of({"laws": {"mine": {}}}, path))
    number = TunedNumber("gain", of_file, None, low, high)
    ranges = ranges_of([number])
    assert ranges.high[0] - ranges.low[0] == pytest.approx(math.log10(30 / 0.2))
    assert number.value(ranges.low[0]) == pytest.approx(low)
    assert number.value(ranges.high[0]) == pytest.approx(high)


def test_a_table_has_the_number_of_the_file_before_the_tuned_one():
    row = number_row("kp", unit="V/rad", after=2.0, low=0.5, high=8.0)
    law = TunedLaw(law="pid", numbers=[row], share=0.5, history=[], designs=[], best=0, runs=2)
    shown = numbers_table([law])
    assert [column.header for column in shown.columns][2:4] == ["in the file", "tuned"]
    assert shown.rows == [["pid", "kp", "1", "2", "0.5", "8", "V/rad"]]


# -- the command -----------------------------------------------------------------------------------


def test_the_command_writes_a_case_that_passes(tmp_path: Path, capsys: Screen):
    path = write_block(tmp_path)
    out = tmp_path / "out"
    assert run("run", path, "--out", out) == 1
    capsys.readouterr()
    assert run("tune", path, "--law", "mine", "--runs", 60, "--out", out) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("mine keeps all: ")

    written = tmp_path / "mine_tuned.toml"
    assert str(written) in printed
    assert Experiment.load(written).controllers == ["mine"]
    assert run("run", written, "--out", out) == 0

    result = out / "tune_mine.json"
    assert json.loads(result.read_text())["laws"][0]["kept"]
    assert (out / "tune_mine.png").stat().st_size > 0
    assert run("report", result, "--output", out / "page.html") == 0
    assert run("diff", result, result) == 0


def test_the_command_says_how_near_the_nearest_came(tmp_path: Path, capsys: Screen):
    path = write_block(tmp_path, requirement=IMPOSSIBLE)
    assert run("tune", path, "--law", "mine", "--runs", 40, "--no-figures", "--out", tmp_path) == 1
    printed = capsys.readouterr().out
    (law,) = json.loads((tmp_path / "tune_mine.json").read_text())["laws"]
    nearest = f"nearest: settles within {law['share']:.3g} times its limit"
    assert printed.startswith(f"None found for mine in 40 runs; {nearest}.")
    assert "impossible" not in printed
    assert "Go on with --resume --runs 80" in printed


WRONG = {
    "reversed": (["laws.mine.damping=2..0.2"], "laws.mine.damping: the range 2..0.2 must rise"),
    "unit": (
        ["laws.mine.frequency=1 m..2 m"],
        'laws.mine.frequency: "1 m" cannot be converted to rad/s',
    ),
    "unknown number": (["laws.mine.dumping=1..2"], "laws.mine.dumping"),
    "unknown law": (["laws.your.damping=1..2"], "unknown law 'your'"),
    "form": (["damping"], "must be laws.NAME.NUMBER=LOW..HIGH"),
    "no number": (["laws.mine.damping=a..b"], "laws.mine.damping: 'a' must be a number"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_numbers_are_refused_in_a_line(tmp_path: Path, name: str):
    numbers, line = WRONG[name]
    with pytest.raises(ArgumentError, match=line.replace("[", r"\[")) as refused:
        tune_study(str(write_block(tmp_path)), ["mine"], numbers)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"conditions": ["case7"]}, "unknown condition 'case7'"),
        ({"runs": 0}, "--runs 0 must be 1 at least"),
        ({"seed": -1}, "--seed -1 must be 0 at least"),
    ],
)
def test_wrong_options_are_refused_in_a_line(
    tmp_path: Path, options: dict[str, Sequence[str]], line: str
):
    with pytest.raises(ArgumentError, match=line):
        tune_study(str(write_block(tmp_path)), ["mine"], BLOCK_NUMBERS, **options)  # pyright: ignore[reportArgumentType]


def test_requirements_that_no_run_can_judge_are_refused(tmp_path: Path):
    path = write_block(tmp_path, requirement={"settles_within": "5.9 s"})
    with pytest.raises(ArgumentError, match=r"no requirement of .* can be judged by a run under"):
        tune_study(str(path), ["mine"], BLOCK_NUMBERS, runs=12)


def test_a_law_that_cannot_be_designed_in_its_ranges_is_refused(tmp_path: Path):
    numbers = ["laws.lqr.Q[1]=-9..-1", "laws.lqr.Q[2]=-9..-1"]
    study = tune_study("servo/nominal", ["lqr"], numbers, conditions=["nominal"], runs=40)
    with pytest.raises(ArgumentError, match="law lqr: none of 12 designs within the ranges"):
        tuned(study, tmp_path)
