"""Trials: laws in loops over draws, each run once, many designs in one batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.requirements.judging import judge_run
from grosmc_mj.output.results.verdicts import Verdict, verdict_of
from grosmc_mj.simulation.loop import Loop, Sensor
from grosmc_mj.studies import trials as module
from grosmc_mj.studies.ladder.ladder import turned_by
from grosmc_mj.studies.target import Condition, StudiedLaw, chosen_laws, conditions_of, limits_in
from grosmc_mj.studies.trials import Trial, Trials

BENCH = Experiment.load("servo/bench")
BARE = BENCH.changed(loop=None)
(LQR,) = chosen_laws(BARE, ["lqr"])
NOMINAL = Condition("nominal", "", BARE)
# Encoders have other phases in each draw.
ENCODER = Loop(sensors=(Sensor("rotor angle", resolution=1e-3),))


def limits(law: StudiedLaw, condition: Condition) -> Sequence[Any]:
    """Limits of the bench's task."""
    return limits_in(BENCH.file.requirement, law, condition, ["corrected"])


def answered(monkeypatch: pytest.MonkeyPatch, failing: int | None) -> None:
    """Answer all runs: the draw of this number fails."""

    def made(self: Trials, runs: Sequence[tuple[Trial, int]]) -> None:
        for trial, number in runs:
            share = 1.5 if number == failing else 0.5
            self.known[trial, number] = verdict_of({"a": share}, draw=number)

    monkeypatch.setattr(Trials, "_run", made)


@pytest.mark.parametrize("failing", [None, 0, 1, 3])
def test_all_draws_must_keep_it(failing: int | None, monkeypatch: pytest.MonkeyPatch) -> None:
    answered(monkeypatch, failing)
    trials = Trials("corrected", limits, draws=4)
    (worst,) = trials.over_draws([Trial(LQR, NOMINAL, ENCODER)])
    assert worst.kept is (failing is None)
    assert worst.draw == (failing or 0)

    # None is run for a loop that has failed already.
    numbers = {number for _, number in trials.known}
    assert numbers == ({0} if failing == 0 else {0, 1, 2, 3})


def test_a_loop_without_chance_is_run_once() -> None:
    trials = Trials("corrected", limits, draws=4)
    assert len(trials.all_draws(Trial(LQR, NOMINAL, Loop()))) == 1


def test_nothing_is_run_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = []

    def counted(experiment: Experiment, design: Sequence[Any], *rest: Any, **more: Any) -> Any:
        rows.extend(design)
        return run_rows(experiment, design, *rest, **more)

    run_rows = module.run_rows
    monkeypatch.setattr(module, "run_rows", counted)
    trials = Trials("corrected", limits, draws=3)
    trial = Trial(LQR, NOMINAL, ENCODER)
    first = trials.all_draws(trial)
    assert trials.all_draws(trial) == first
    # An equal loop that is made anew is the same one.
    trials.over_draws([trial._replace(loop=replace(ENCODER))])
    assert len(rows) == 3


def test_a_recorded_run_is_the_first_draw() -> None:
    trials = Trials("corrected", limits, draws=2)
    trial = Trial(LQR, NOMINAL, ENCODER)
    trials.record(trial)
    recorded = trials.known[trial, 0]
    (batched,) = Trials("corrected", limits).results([(trial, 0)])
    assert recorded.tightest == batched.tightest
    assert recorded.shares == pytest.approx(batched.shares, rel=1e-9)


def test_draws_count_from_the_file_s_own_run() -> None:
    """Draw 1 of a file whose run is 2 is the run 3."""
    noisy = Loop(sensors=(Sensor("rotor angle", noise=0.03),))
    own = Condition("nominal", "", BARE.changed(run_number=2))
    trials = Trials("corrected", limits, draws=2)
    _, third = trials.all_draws(Trial(LQR, own, noisy))
    run = BARE.changed(loop=noisy, run_number=3).run("corrected", "lqr")
    (error,) = [limit for limit in limits(LQR, own) if limit.key == "final_error_below"]
    assert third.shares[error.name] == pytest.approx(judge_run(error, run).share, rel=1e-9)


def designs() -> list[StudiedLaw]:
    """LQR designed for a cheap input, and for a dear one."""
    laws = []
    for weight in (0.1, 10.0):
        controller = BARE.changed({"task.R": weight}).law("physics", "lqr")
        laws.append(replace(LQR, name=f"R = {weight}", controller=controller))
    return laws


def test_designs_of_a_law_under_all_conditions_run_in_one_batch(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    batches = []

    def counted(*arguments: Any, **more: Any) -> Any:
        batches.append(arguments)
        return run_rows(*arguments, **more)

    run_rows = module.run_rows
    monkeypatch.setattr(module, "run_rows", counted)
    conditions = [replace(item, experiment=item.experiment) for item in conditions_of(BARE)]
    trials = Trials("corrected", lambda law, _: limits(law, NOMINAL))
    tried = [Trial(law, condition, Loop()) for law in designs() for condition in conditions]
    together = trials.over_draws(tried)
    assert len(batches) == 1

    alone = [Trials("corrected", trials.limits).over_draws([trial])[0] for trial in tried]
    assert together == alone
    assert together[0].shares != together[len(conditions)].shares
    expected = [(trial.law.name, trial.condition.name) for trial in tried]
    assert [(row.law, row.condition) for row in together] == expected


def test_a_loop_that_cannot_be_is_a_verdict() -> None:
    late = Loop(sensors=(Sensor("rotor angle", delay=1.5e-4),))
    (verdict,) = Trials("corrected", limits).over_draws([Trial(LQR, NOMINAL, late)])
    assert "is no multiple" in verdict.impossible
    assert not verdict.kept


def rows_of(*shares: float) -> list[Verdict]:
    return [verdict_of({"a": share}, draw=draw) for draw, share in enumerate(shares)]


@pytest.mark.parametrize(
    ("kept", "changed", "turned"),
    [
        # A change that breaks the worst draw turns a rung that is kept.
        (True, (1.5, 0.5, 0.5), True),
        (True, (0.5, 0.5, 0.5), False),
        # One that is kept in all draws turns a rung that is not.
        (False, (0.5, 0.5, 0.5), True),
        (False, (0.5, 0.5, 1.5), False),
        (False, (1.5, 0.5, 0.5), False),
    ],
)
def test_an_assumed_number_turns_a_verdict(
    kept: bool, changed: tuple[float, ...], turned: bool
) -> None:
    trial = Trial(LQR, NOMINAL, ENCODER)
    trials = Trials("corrected", limits)
    trials.known.update({(trial, row.draw): row for row in rows_of(*changed)})
    found = turned_by(trials, {"lag times 2": trial}, [0, 1, 2], kept=kept)
    assert found == (("lag times 2",) if turned else ())
