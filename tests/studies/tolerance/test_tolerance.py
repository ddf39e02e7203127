"""Tolerances: the search, known margins, both engines, the tables, the command."""

from __future__ import annotations

import contextlib
import io
import json
import math
import pickle
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import control
import numpy as np
import pytest
from commands import run
from conftest import Stored

from grosmc_mj import cli
from grosmc_mj.ground.executors.pools import InProcess
from grosmc_mj.output.results.document import json_text
from grosmc_mj.output.results.verdicts import Verdict, Verdicts, verdict_of
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.studies.study import CellRunner
from grosmc_mj.studies.sweep.confirmation import LEAST_BAND, MarginConfirmation
from grosmc_mj.studies.sweep.search import Search, grid_of, run_searches
from grosmc_mj.studies.target import judgeable_in
from grosmc_mj.studies.tolerance import answer, imperfections, tolerance
from grosmc_mj.studies.tolerance.answer import verdict
from grosmc_mj.studies.tolerance.imperfections import Imperfection
from grosmc_mj.studies.tolerance.search import (
    BEYOND,
    FINER,
    PER_OCTAVE,
    RESOLUTION,
    ToleranceSearch,
    _confirmed,
    confirm_searches,
    geometric_mean,
)
from grosmc_mj.studies.tolerance.tolerance import ToleranceStudy, tolerance_study, tolerances
from grosmc_mj.studies.tolerance.words import with_words
from grosmc_mj.studies.trials import Trial, Trials

DELAY = 0.05
MOST = imperfections.MOST
SEARCH = "grosmc_mj.studies.tolerance.search"
FILE = f"""
plant = {{ system = "servo" }}
computing = {{ delay = "{DELAY} s" }}
sensor = [
  {{ of = "rotor angle", delay = "0.1 s", resolution = "0.1 rad" }},
  {{ of = "rotor speed", exact = true }},
]
controller = [{{ law = "lqr" }}]
requirement = [{{ stays_within = "0.5 rad", after = "50 s" }}]
[run]
start = {{ "rotor angle" = "0 rad" }}
duration = "60 s"
control_period = "5 ms"
timestep = "5 ms"
"""


def answered(
    keeps: Callable[[float], bool],
    begin: float = 0.0,
    *,
    most: float = MOST,
    per_octave: int = PER_OCTAVE,
    **options: Any,
) -> Search:
    """A search on its grid, or from where another one ended."""
    least = imperfections.LEAST
    search = Search(
        geometric_mean,
        most,
        least=least,
        grid=[] if begin else grid_of(least, most, per_octave),
        beyond=BEYOND,
        finer=grid_of(least, most, FINER),
        **options,
    )
    if begin:
        search.known[begin] = keeps(begin)

    def passing(tried: list[tuple[Search, float]]) -> list[bool]:
        assert not {factor for _, factor in tried} & set(search.known)
        return [keeps(factor) for _, factor in tried]

    run_searches([search], passing)
    return search


@pytest.mark.parametrize(
    ("keeps", "begin", "bound", "again"),
    [
        (lambda x: x <= 0.07, 0.0, 0.07, []),
        (lambda x: x <= 1.0, 0.0, 1.0, []),
        (lambda x: x <= 3.3, 0.0, 3.3, []),
        (lambda x: x <= 700.0, 0.0, 700.0, []),
        # Physics walks from where the equations end.
        (lambda x: x <= 5, 0.5, 5, []),
        (lambda x: x <= 5, 40.0, 5, []),
        (lambda x: x <= 3 or 8 <= x <= 16, 0.0, 3, [(8, 16)]),
        # The first failure counts though larger amounts are kept.
        (lambda x: not 0.2 < x < 0.28, 0.0, 0.2, [(2**-1.75, MOST)]),
        # A failure between two of the grid that are kept, as of the servo's sgn with a lag.
        (lambda x: not 1.19 < x < 1.26 and x <= 1.35, 0.0, 1.19, [(2 ** (11 / 32), 2**0.375)]),
        (lambda x: not 1.19 < x < 1.26 and x <= 1.35, 1.3, 1.19, [(2 ** (11 / 32), 1.3)]),
        # Whole multiples of a period may be kept where all else is not.
        (lambda x: x <= 11 or x == 16, 0.0, 11, [(16, 16)]),
    ],
)
def test_the_bound_is_searched_from_below(
    keeps: Callable[[float], bool],
    begin: float,
    bound: float,
    again: list[tuple[float, float]],
) -> None:
    search = answered(keeps, begin)
    assert search.largest is not None
    assert search.failed is not None
    resolution = RESOLUTION * 1.001
    assert search.largest <= bound < search.failed <= search.largest * resolution
    assert search.again == again


def test_a_search_without_failure_ends_at_its_largest_factor() -> None:
    kept = answered(lambda _: True)
    assert kept.largest == MOST
    assert kept.failed is None
    bounded = answered(lambda _: True, most=3.0, per_octave=1)
    assert sorted(bounded.known) == [0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 3.0]


def test_a_search_that_never_passes_ends_at_its_least_factor() -> None:
    never = answered(lambda _: False)
    assert never.largest is None
    assert never.failed == imperfections.LEAST
    assert never.again == []


def test_times_on_a_grid_are_tried_once() -> None:
    coarse = answered(lambda x: round(4 * x) <= 5, same=lambda x: round(4 * x))
    assert coarse.largest is not None
    assert coarse.failed is not None
    assert round(4 * coarse.largest) == 5
    assert round(4 * coarse.failed) == 6


def search_for(studied: ToleranceStudy, name: str, *, local: bool = False) -> ToleranceSearch:
    kind = studied.kinds[name]
    return ToleranceSearch(studied.laws[0], kind, studied.conditions[0], local=local)


def result(share: float, draw: int = 0) -> Verdict:
    """The verdict on a run that uses this share of its limit."""
    return verdict_of({"deviation_below": share}, draw=draw)


@pytest.mark.parametrize("kept_at_the_bench", [True, False])
def test_the_bench_s_own_amount_is_run(*, kept_at_the_bench: bool) -> None:
    """Physics begins where the equations end, at 0.98 and 1.06 of the bench."""
    search = search_for(tolerance_study("servo", ["sign"]), "actuator lag", local=True)
    kept = {0.0: True, 0.98: True, 1.0: kept_at_the_bench, 1.06: False}
    factors = [0.0, 0.98, 1.06]
    while factors:
        for factor in factors:
            passes = kept.get(factor, factor < 1.0)
            search.note(factor, result(0.5 if passes else 1.5))
        factors = search.next_factors()

    assert 1.0 in search.results
    assert search.tolerance(physics_agrees=False).kept is kept_at_the_bench


def test_the_bench_s_own_amount_is_kept_in_all_draws() -> None:
    search = search_for(tolerance_study("servo", ["sign"]), "computing missed")
    for factor in (1.0, 2.0):
        search.note(factor, result(0.5))
    assert search.unsure() == [2.0, 1.0]


# The design.


def test_each_number_of_a_bench_is_an_imperfection() -> None:
    studied = tolerance_study("servo")
    assert [kind.name for kind in studied.imperfections] == [
        "computing delay",
        "computing jitter",
        "computing missed",
        "sensor resolution",
        "actuator resolution",
        "actuator limit",
        "actuator lag",
        "estimated rates",
        "sensor resolution, estimated rates",
        "all",
    ]


def imperfection(studied: ToleranceStudy, name: str) -> Imperfection:
    return studied.kinds[name]


def test_less_of_a_limit_is_more_of_an_imperfection() -> None:
    limit = imperfection(tolerance_study("servo"), "actuator limit")
    assert limit.at(4.0).actuators[0].limit == 1.0
    assert limit.at(0.0).actuators[0].limit == math.inf


def test_all_at_once_are_in_the_bench_s_proportions() -> None:
    studied = tolerance_study("servo")
    everything = imperfection(studied, "all")
    assert everything.at(1.0) == studied.bench
    assert everything.at(2.0).estimators == studied.bench.estimators
    twice = everything.at(2.0).computing.missed
    assert twice == pytest.approx(2 * studied.bench.computing.missed)


def test_a_time_is_shown_on_the_grid_of_the_timestep() -> None:
    delay = imperfection(tolerance_study("servo"), "computing delay")
    assert delay.text(4.4) == "4.5"
    assert delay.heading == "computing delay [ms]"


def test_amounts_end_at_their_physical_bounds() -> None:
    """One sample in a hundred comes through, times are below 1 s."""
    studied = tolerance_study("servo")
    settings = studied.experiment.settings
    jitter = imperfection(studied, "computing jitter")
    assert jitter.at(jitter.most).computing.jitter < settings.control_period

    far = imperfection(studied, "all").at(MOST).computing
    assert far.missed == pytest.approx(0.99)
    assert far.jitter == pytest.approx(settings.control_period - settings.timestep)
    delay = min(MOST * studied.bench.computing.delay, 1 - settings.timestep)
    assert far.delay == pytest.approx(delay)


def test_rivals_are_studied_on_request() -> None:
    every = tolerance_study("servo/case1", rivals=True)
    names = [law.name for law in every.laws]
    assert names[:5] == ["lqr", "lqi", "fl-pid", "adrc", "adaptive"]
    assert len(names) == 14
    assert len(set(names)) == 14
    assert [law.name for law in tolerance_study("servo/case1").laws[:2]] == ["lqr", "sign"]


def test_a_case_is_studied_on_its_system_s_bench_under_its_own_load() -> None:
    studied = tolerance_study("servo/case1")
    assert studied.bench_of == "servo/bench"
    assert [condition.name for condition in studied.conditions] == ["nominal", "under load"]


def test_another_process_reads_the_same_laws() -> None:
    studied = tolerance_study("servo/case1")
    copied = pickle.loads(pickle.dumps(studied))
    assert [law.name for law in copied.laws] == [law.name for law in studied.laws]


@pytest.mark.parametrize("system", ["servo", "cart_pendulum", "arm", "two_link_arm", "jaco"])
def test_every_system_s_laws_switch_in_every_way(system: str) -> None:
    names = {law.name for law in tolerance_study(system).laws}
    assert {"lqr", "implicit", "implicit, predicted"} <= names


@pytest.mark.parametrize(
    ("law", "kinds"),
    [
        ("lqr", ["deviation_below"]),
        ("implicit", ["deviation_below", "no_reaching_phase"]),
    ],
)
def test_requirements_hold_for_every_law_that_they_can_be_about(law: str, kinds: list[str]) -> None:
    arm = tolerance_study("arm/case1", [law])
    limits = arm.limits(arm.laws[0], arm.conditions[0])
    assert [limit.key for limit in limits] == kinds


SERVO = tolerance_study("servo", ["sign"])
BUILT = SERVO.bench
STRONGER = replace(BUILT, actuators=(replace(BUILT.actuators[0], limit=8.0),))


@pytest.mark.parametrize(
    ("loop", "bench", "judged"),
    [
        (BUILT, BUILT, True),
        (Loop(), BUILT, False),
        (STRONGER, BUILT, False),
        # Of a file whose loop has no actuator with a range the limit is the file's own.
        (Loop(), None, True),
        (Loop(), Loop(), True),
    ],
)
def test_an_input_is_judged_where_the_actuator_that_gives_it_is_there(
    loop: Loop, bench: Loop | None, judged: bool
) -> None:
    """sgn asks for 6 A of an ideal actuator on the servo's bench, whose amplifier gives 4 A."""
    limits = SERVO.limits(SERVO.laws[0], SERVO.conditions[0])
    kinds = {limit.key for limit in limits}
    assert "input_below" in kinds
    if not judged:
        kinds.remove("input_below")
    assert {limit.key for limit in judgeable_in(limits, loop, bench)} == kinds


# Runs.


def test_finished_answers_of_a_law_are_read_as_they_were_written(tmp_path: Path) -> None:
    studied = tolerance_study("servo", ["lqr"])
    rows = rows_of(studied)
    stored = CellRunner(tmp_path, Verdicts)
    (cell,) = studied.cells()
    stored.write(cell, Verdicts(rows=tuple(rows)))
    finished = stored.read(cell)
    assert finished is not None
    assert studied.tolerances([finished]) == rows
    (more_draws,) = replace(studied, draws=20).cells()
    assert stored.read(more_draws) is None


def test_answers_without_a_longer_period_are_not_read_for_a_study_with_it() -> None:
    (without,) = tolerance_study("servo", ["lqr"]).cells()
    (with_it,) = tolerance_study("servo", ["lqr"], longer_period=True).cells()
    assert without.depends_on != with_it.depends_on


def test_a_process_reads_the_same_study() -> None:
    studied = tolerance_study("servo", ["lqr"], longer_period=True, draws=3)
    read = pickle.loads(pickle.dumps(studied))
    assert read.cells()[0].depends_on == studied.cells()[0].depends_on


@pytest.fixture(scope="module")
def delayed(tmp_path_factory: pytest.TempPathFactory) -> ToleranceStudy:
    """The study of the servo's LQR with a delayed input, without a load."""
    file = tmp_path_factory.mktemp("delayed") / "mine.toml"
    file.write_text(FILE, encoding="utf-8")
    studied = tolerance_study(str(file), ["lqr"])
    return replace(studied, conditions=studied.conditions[:1])


def none_at_random(count: int) -> Any:
    return np.zeros(count, bool)


def checked(studied: ToleranceStudy) -> list[Verdict]:
    """The tolerances that are looked at in physics, none of them at random."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(f"{SEARCH}.drawn_at_random", none_at_random)
        rows = tolerances(studied, 0)
    return [row for row in rows if row.physics_agrees is not None]


@pytest.fixture(scope="module")
def neighbours(delayed: ToleranceStudy) -> list[Verdict]:
    """The tolerances that are looked at where all are neighbours of the least."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        # The distance of the others from their limits is less than that.
        unbounded = partial(MarginConfirmation, band=math.inf)
        monkeypatch.setattr(f"{SEARCH}.MarginConfirmation", unbounded)
        return checked(delayed)


@pytest.mark.slow
def test_physics_confirms_the_tolerances_of_lqr(neighbours: list[Verdict]) -> None:
    assert [row.physics_agrees for row in neighbours] == [True] * 4


@pytest.mark.slow
def test_physics_looks_at_the_least_tolerance(
    delayed: ToleranceStudy, neighbours: list[Verdict]
) -> None:
    assert checked(delayed) == [min(neighbours, key=lambda row: row.largest_kept or 0.0)]


@pytest.mark.slow
def test_lqr_stands_its_delay_margin(delayed: ToleranceStudy, neighbours: list[Verdict]) -> None:
    design = delayed.laws[0].controller.designed.lqr
    delay = neighbours[0]
    loop = control.ss(design.A, design.B, design.K, np.zeros((1, 1)))
    _, phase, _, crossing = control.margin(loop)
    margin = math.radians(phase) / crossing - delayed.experiment.settings.control_period / 2
    assert delay.step == "computing delay"
    assert delay.largest_kept is not None
    assert delay.smallest_failed is not None
    # A growth by less than half in fifty seconds is not told from none.
    assert delay.largest_kept * DELAY < 1.1 * margin
    assert delay.smallest_failed * DELAY > 0.95 * margin


class AnsweredSearch:
    """A search that the equations have answered at one end, with this margin."""

    ends = (1.0,)

    def __init__(self, margin: float, largest: float) -> None:
        self.results = {1.0: result(1 - margin)}
        self.weakness = (False, largest)

    def trial(self, _: float) -> AnsweredSearch:
        return self


@pytest.mark.parametrize(("difference", "band"), [(0.01, 0.1), (0.0, LEAST_BAND)])
def test_physics_looks_within_ten_times_the_largest_difference_of_a_margin(
    difference: float, band: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    least = AnsweredSearch(0.5, 1.0)
    near = AnsweredSearch(0.99 * band, 2.0)
    # Beyond the limit it counts as much.
    beyond = AnsweredSearch(-0.99 * band, 3.0)
    far = AnsweredSearch(1.01 * band, 4.0)
    far_beyond = AnsweredSearch(-1.01 * band, 5.0)
    searches: Any = [least, near, beyond, far, far_beyond]

    physics: Any = SimpleNamespace(known={})
    for search in searches:
        physics.known[search, 0] = search.results[1.0]
    physics.known[least, 0] = result(1 - 0.5 - difference)

    monkeypatch.setattr(f"{SEARCH}.drawn_at_random", none_at_random)
    monkeypatch.setattr(f"{SEARCH}._confirmed", lambda chosen, _: dict.fromkeys(chosen, True))
    assert set(confirm_searches(searches, physics)) == {least, near, beyond}


@pytest.mark.slow
def test_physics_looks_at_every_tolerance_once_one_differs(
    delayed: ToleranceStudy, monkeypatch: pytest.MonkeyPatch
) -> None:
    def differs(*parts: Any) -> dict[Any, bool]:
        return dict.fromkeys(_confirmed(*parts), False)

    monkeypatch.setattr(f"{SEARCH}._confirmed", differs)
    assert [row.physics_agrees for row in checked(delayed)] == [False] * 4


def spectral_radius(studied: ToleranceStudy, control_period: float) -> float:
    """Largest |eigenvalue| of the LQR loop sampled with this period."""
    optimum = studied.laws[0].controller.designed.lqr
    sampled = control.c2d(control.ss(optimum.A, optimum.B, np.eye(2), 0), control_period)
    return float(np.abs(np.linalg.eigvals(sampled.A - sampled.B @ optimum.K)).max())


def test_lqr_keeps_up_to_the_period_at_which_the_sampled_loop_is_unstable(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(FILE, encoding="utf-8")
    studied = tolerance_study(str(tmp_path / "mine.toml"), ["lqr"], longer_period=True)
    kinds = {kind.name: kind for kind in studied.imperfections}
    studied = replace(
        studied, imperfections=[kinds["control period"]], conditions=studied.conditions[:1]
    )
    (found,) = tolerances(studied, 0)
    assert found.physics_agrees
    assert found.largest_kept is not None
    assert found.smallest_failed is not None
    # A growth by less than half in fifty seconds is not told from none.
    period = kinds["control period"]
    longest = period.amount(found.largest_kept)
    assert spectral_radius(studied, longest) < 1.005
    assert spectral_radius(studied, period.amount(found.smallest_failed)) > 0.995
    # Far beyond the 5 ms of the file, on the grid of the timestep.
    assert longest > 0.05
    assert math.remainder(longest, 5e-3) == pytest.approx(0, abs=1e-12)


@cache
def with_longer_period() -> ToleranceStudy:
    return tolerance_study("servo", ["sign", "implicit"], longer_period=True)


def test_a_longer_period_is_studied_on_request_only() -> None:
    assert "control period" not in {kind.name for kind in tolerance_study("servo").imperfections}
    requested = {kind.name for kind in with_longer_period().imperfections}
    assert "control period" in requested


def test_another_process_reads_the_same_imperfections() -> None:
    studied = with_longer_period()
    copied = pickle.loads(pickle.dumps(studied))
    names = [kind.name for kind in studied.imperfections]
    assert [kind.name for kind in copied.imperfections] == names


def test_a_longer_period_is_a_multiple_of_the_run_s() -> None:
    period = imperfection(with_longer_period(), "control period")
    assert period.heading == "control period [ms]"
    assert period.control_period(1.0) is None
    assert period.control_period(2.0) == pytest.approx(2e-3)


def test_a_longer_period_samples_the_law_with_its_surface() -> None:
    """A discrete surface of another period than the run's would be refused."""
    studied = with_longer_period()
    period = imperfection(studied, "control period")
    law = studied.laws[1]
    nominal = studied.conditions[0]
    trials = Trials("corrected", studied.limits, built=studied.bench)
    usual, longer = trials.over_draws(
        [Trial(law, nominal, period.base), Trial(law, nominal, period.base, 4e-3)]
    )
    assert usual.kept
    assert longer.kept
    assert usual.share != longer.share


# The answer.


def row_of(
    studied: ToleranceStudy, at: int, kept: float | None, failed: float | None, **more: Any
) -> Verdict:
    """The tolerance to an imperfection; what the bench has of it is kept."""
    kind = studied.imperfections[at]
    fields = {
        "law": "lqr",
        "step": kind.name,
        "condition": "nominal",
        "share": 0.5,
        "tightest": "deviation_below",
        "largest_kept": kept,
        "smallest_failed": failed,
        **more,
    }
    return with_words(Verdict(**fields), kind)


def rows_of(studied: ToleranceStudy, kept: float | None = 2.0, **more: Any) -> list[Verdict]:
    """Tolerances to all imperfections."""
    changes = {"kept_again": ((4.0, 8.0),), "physics_agrees": True, **more}
    failed = 0.0 if kept is None else kept + 0.1
    return [row_of(studied, i, kept, failed, **changes) for i in range(len(studied.imperfections))]


@pytest.mark.parametrize(
    ("index", "kept", "failed", "more", "cell"),
    [
        (0, 2.9, 3.5, {}, "3"),
        # Less than half a timestep is none of it.
        (0, 0.125, 0.5, {}, "none"),
        (0, None, 0.0, {"share": math.inf}, "no"),
        (0, 1024.0, None, {"tightest": ""}, "≥ 1000"),
        (5, 16.0, None, {"tightest": ""}, "≤ 0.25"),
        (3, 2.0, 2.1, {"physics_agrees": False}, "3.07!"),
        (7, 1.0, None, {"tightest": "", "share": 0.0}, "yes"),
        (7, 0.0, 1.0, {"share": math.inf}, "no"),
        (9, 2.0, 2.1, {}, "2"),
        (1, None, 0.0, {"impossible": "there is no filter"}, "-"),
    ],
)
def test_a_cell_has_the_amount_that_is_run(
    index: int, kept: float | None, failed: float | None, more: dict[str, Any], cell: str
) -> None:
    studied = tolerance_study("servo", ["lqr"])
    assert row_of(studied, index, kept, failed, **more).cell == cell


def test_the_verdict_has_the_amount_that_fails() -> None:
    studied = tolerance_study("servo", ["lqr"])
    assert verdict([row_of(studied, 0, 2.9, 3.5)], studied.kinds) == (
        "lqr breaks first, by computing delay: all is kept up to 3 ms (2.9 times the bench's); "
        "the first failure found is at 3.5 ms (3.5 times the bench's): deviation below."
    )
    never = verdict([row_of(studied, 0, 0.125, 0.5, condition="case1")], studied.kinds)
    assert "under case1: all is kept only without it; the first failure found is at 0.5 ms" in never


def test_the_page_of_a_result_has_the_least_that_is_stood_ideally() -> None:
    studied = tolerance_study("servo", ["lqr", "implicit"])
    weaker = rows_of(studied, 1.0, condition="case1", kept_again=())
    never = rows_of(studied, None, condition="case2", share=math.inf)
    # The other law was interrupted after its first answer.
    endless = row_of(studied, 5, 0.0, 0.0625, law="implicit")
    rows = [*rows_of(studied), *weaker, *never, endless]
    content = answer.tolerance_result(studied, rows, complete=False)
    document = json.loads(json_text(content))
    lines = answer.tolerances_text([document]).splitlines()
    header, lqr, implicit = (
        [cell.strip() for cell in lines[i].strip("|").split("|")] for i in (2, 4, 5)
    )
    answers = {studied.kinds[row.step].heading: row.cell for row in weaker}
    expected = {"law": "lqr", "keeps ideally": "nominal, case1", **answers}
    assert dict(zip(header, lqr, strict=True)) == expected
    assert implicit[header.index("actuator limit [A]")] == "none"
    assert implicit.count("") == len(studied.imperfections) - 1
    assert lines[-1] == "MuJoCo confirmed 30 of 30 answers."
    assert [x["breaks_at"] for x in document["standings"]] == ["computing delay", "actuator limit"]
    words = "kept only without it, then deviation below (nominal)"
    assert document["standings"][1]["words"] == words


def answer_first_law(studied: ToleranceStudy, index: int, **_: object) -> list[Verdict]:
    """Made-up tolerances of the first law; an interrupt at the second one."""
    if index == 1:
        raise KeyboardInterrupt
    return rows_of(studied)


def study_of_first_law(laws: list[str], folder: Path) -> Stored:
    """The command about these laws, with made-up tolerances."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(tolerance, "tolerances", answer_first_law)
        monkeypatch.setattr(tolerance, "executor_for", lambda _: InProcess())
        with contextlib.redirect_stdout(io.StringIO()) as output:
            code = run("study", "tolerance", "arm", "--laws", *laws, "--out", folder)
    return Stored(code, output.getvalue(), folder)


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory: pytest.TempPathFactory) -> Stored:
    """A study that was interrupted at its second law; tests only read its folder."""
    return study_of_first_law(["lqr", "fl-pid"], tmp_path_factory.mktemp("interrupted"))


@pytest.fixture(scope="module")
def finished(interrupted: Stored, tmp_path_factory: pytest.TempPathFactory) -> Stored:
    """A finished study in a copy of the interrupted one's folder."""
    folder = tmp_path_factory.mktemp("finished")
    shutil.copytree(interrupted.folder, folder, dirs_exist_ok=True)
    return study_of_first_law(["lqr"], folder)


def assert_first_law_is_kept(studied: Stored, *, complete: bool) -> None:
    content = studied.read("tolerance_arm_bench.json")
    assert content["complete"] is complete
    assert {row["law"] for row in content["verdicts"]} == {"lqr"}
    row = content["verdicts"][0]
    assert row["largest_kept"] == 2.0
    assert row["kept_again"] == [[4.0, 8.0]]
    assert (studied.folder / "tolerance_arm_bench.png").is_file()


def test_an_interrupt_keeps_finished_laws(interrupted: Stored) -> None:
    assert interrupted.code == cli.INTERRUPTED
    assert_first_law_is_kept(interrupted, complete=False)


def test_a_finished_study_overwrites_an_interrupted_one(finished: Stored) -> None:
    assert finished.code == cli.DONE
    assert_first_law_is_kept(finished, complete=True)


def test_a_law_that_keeps_everything_under_no_condition_is_a_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never_kept(studied: ToleranceStudy, *_: object, **__: object) -> list[Verdict]:
        return rows_of(studied, None)

    monkeypatch.setattr(tolerance, "tolerances", never_kept)
    monkeypatch.setattr(tolerance, "executor_for", lambda _: InProcess())
    assert run("study", "tolerance", "arm", "--laws", "lqr", "--out", tmp_path) == cli.DIFFERS


def test_the_answer_names_the_law_that_breaks_first(finished: Stored) -> None:
    studied = tolerance_study("arm", ["lqr"])
    answer = verdict(rows_of(studied), studied.kinds)
    assert answer in " ".join(finished.said.split())


@pytest.mark.parametrize("name", ["interrupted", "finished"])
def test_no_line_of_the_command_is_too_wide(name: str, request: pytest.FixtureRequest) -> None:
    """100 characters, but for the path of the folder."""
    studied: Stored = request.getfixturevalue(name)
    lines = studied.said.splitlines()
    assert max(map(len, lines), default=0) <= 100 + len(str(studied.folder))


def test_a_search_halves_the_ratio_of_two_factors() -> None:
    assert geometric_mean(2.0, 18.0) == 6.0
