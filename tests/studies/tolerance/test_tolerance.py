"""Tolerances: the imperfections of a bench, and bounds that are known from the delay margin."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cases
import control
import numpy as np
import pytest

from grosmc_mj.output.results.verdicts import Verdict, Verdicts
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.studies.study import CellRunner
from grosmc_mj.studies.target import judgeable_in
from grosmc_mj.studies.tolerance.imperfections import MOST
from grosmc_mj.studies.tolerance.tolerance import ToleranceStudy, tolerance_study, tolerances
from grosmc_mj.studies.trials import Trial, Trials

DELAY = 0.05
SERVO = tolerance_study("servo", ["sign"])


@cache
def with_longer_period() -> ToleranceStudy:
    """The servo's study with a longer control period."""
    return tolerance_study("servo", ["sign", "implicit"], longer_period=True, draws=3)


# Imperfections of a bench.


def test_each_number_of_a_bench_is_an_imperfection() -> None:
    assert list(SERVO.kinds) == [
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
    assert "control period" in with_longer_period().kinds


def test_less_of_a_limit_is_more_of_an_imperfection() -> None:
    limit = SERVO.kinds["actuator limit"]
    assert limit.at(4.0).actuators[0].limit == 1.0
    assert limit.at(0.0).actuators[0].limit == math.inf


def test_all_at_once_are_in_the_bench_s_proportions() -> None:
    everything = SERVO.kinds["all"]
    assert everything.at(1.0) == SERVO.bench
    assert everything.at(2.0).estimators == SERVO.bench.estimators
    twice = everything.at(2.0).computing.missed
    assert twice == pytest.approx(2 * SERVO.bench.computing.missed)


def test_a_time_is_shown_on_the_grid_of_the_timestep() -> None:
    delay = SERVO.kinds["computing delay"]
    assert delay.text(4.4) == "4.5"
    assert delay.heading == "computing delay [ms]"


def test_amounts_end_at_their_physical_bounds() -> None:
    """One sample in a hundred comes through, times are below 1 s."""
    settings = SERVO.experiment.settings
    jitter = SERVO.kinds["computing jitter"]
    assert jitter.at(jitter.most).computing.jitter < settings.control_period

    far = SERVO.kinds["all"].at(MOST).computing
    assert far.missed == pytest.approx(0.99)
    assert far.jitter == pytest.approx(settings.control_period - settings.timestep)
    delay = min(MOST * SERVO.bench.computing.delay, 1 - settings.timestep)
    assert far.delay == pytest.approx(delay)


def test_a_longer_period_is_a_multiple_of_the_run_s() -> None:
    period = with_longer_period().kinds["control period"]
    assert period.heading == "control period [ms]"
    assert period.control_period(1.0) is None
    assert period.control_period(2.0) == pytest.approx(2e-3)


def test_a_longer_period_samples_the_law_with_its_surface() -> None:
    """A discrete surface of another period than the run's would be refused."""
    studied = with_longer_period()
    ideal = studied.kinds["control period"].base
    law = studied.laws[1]
    nominal = studied.conditions[0]
    trials = Trials("corrected", studied.limits, built=studied.bench)
    usual, longer = trials.over_draws(
        [Trial(law, nominal, ideal), Trial(law, nominal, ideal, 4e-3)]
    )
    assert usual.kept
    assert longer.kept
    assert usual.share != longer.share


# Laws, conditions and requirements of a study.


def test_rivals_are_studied_on_request() -> None:
    every = [law.name for law in tolerance_study("servo/case1", rivals=True).laws]
    assert every[:5] == ["lqr", "lqi", "fl-pid", "adrc", "adaptive"]
    assert len(every) == len(set(every)) == 14


def test_a_case_is_studied_on_its_system_s_bench_under_its_own_load() -> None:
    studied = tolerance_study("servo/case1")
    assert studied.bench_of == "servo/bench"
    assert [condition.name for condition in studied.conditions] == ["nominal", "under load"]
    assert [law.name for law in studied.laws[:2]] == ["lqr", "sign"]


@pytest.mark.parametrize("timestep", ["2 ms", "0.1 ms"])
def test_a_study_takes_the_finer_timestep_of_the_target_and_its_bench(
    timestep: str, tmp_path: Path
) -> None:
    run = {"duration": "20 ms", "control_period": "2 ms", "timestep": timestep}
    limit = {"input_below": "4 A"}
    studied = tolerance_study(str(cases.write(tmp_path, run=run, requirement=limit)), ["lqr"])
    own = float(timestep.split()[0]) / 1000
    finer = min(own, SERVO.experiment.settings.timestep)
    assert studied.bench == SERVO.bench
    assert studied.experiment.settings.timestep == finer
    assert {kind.timestep for kind in studied.imperfections} == {finer}


@pytest.mark.parametrize(
    "system",
    ["servo", *(pytest.param(x, marks=pytest.mark.slow) for x in ("cart_pendulum", "jaco"))],
)
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
    expected = kinds if judged else kinds - {"input_below"}
    assert {limit.key for limit in judgeable_in(limits, loop, bench)} == expected


# Stored answers, and other processes.


def test_finished_answers_of_a_law_are_read_for_the_same_question_alone(tmp_path: Path) -> None:
    answers = Verdicts(rows=(Verdict(law="sign", step="all", condition="nominal", share=0.5),))
    stored = CellRunner(tmp_path, Verdicts)
    (cell,) = SERVO.cells()
    stored.write(cell, answers)
    assert stored.read(cell) == answers
    (more_draws,) = replace(SERVO, draws=20).cells()
    assert stored.read(more_draws) is None
    (longer_period,) = tolerance_study("servo", ["sign"], longer_period=True).cells()
    assert stored.read(longer_period) is None


def test_another_process_reads_the_same_study() -> None:
    studied = with_longer_period()
    read = pickle.loads(pickle.dumps(studied))
    assert [cell.key for cell in read.cells()] == [("sign",), ("implicit",)]
    assert [cell.depends_on for cell in read.cells()] == [
        cell.depends_on for cell in studied.cells()
    ]


# Known bounds.


def of_file(folder: Path, kind: str, **options: Any) -> ToleranceStudy:
    """The study of one imperfection of a servo's LQR, whose error shall not grow in a minute."""
    file = cases.write(
        folder,
        run={
            "start": {"rotor angle": "0 rad"},
            "duration": "60 s",
            "control_period": "5 ms",
            "timestep": "5 ms",
        },
        computing={"delay": f"{DELAY} s"},
        sensor=[{"of": name, "exact": True} for name in ("rotor angle", "rotor speed")],
        requirement={"stays_within": "0.5 rad", "after": "50 s"},
    )
    studied = tolerance_study(str(file), ["lqr"], **options)
    return replace(studied, imperfections=[studied.kinds[kind]], conditions=studied.conditions[:1])


def factor(end: float | None) -> float:
    """An end of a search that has found both."""
    assert end is not None
    return end


def spectral_radius(studied: ToleranceStudy, control_period: float) -> float:
    """Largest |eigenvalue| of the LQR loop sampled with this period."""
    optimum = studied.laws[0].controller.designed.lqr
    sampled = control.c2d(control.ss(optimum.A, optimum.B, np.eye(2), 0), control_period)
    return float(np.abs(np.linalg.eigvals(sampled.A - sampled.B @ optimum.K)).max())


def test_lqr_keeps_up_to_the_period_at_which_the_sampled_loop_is_unstable(tmp_path: Path) -> None:
    studied = of_file(tmp_path, "control period", longer_period=True)
    (found,) = tolerances(studied, 0)
    (period,) = studied.imperfections
    longest = period.amount(factor(found.largest_kept))
    assert found.physics_agrees
    # A growth by less than half in fifty seconds is not told from none.
    assert spectral_radius(studied, longest) < 1.005
    assert spectral_radius(studied, period.amount(factor(found.smallest_failed))) > 0.995
    # Far beyond the 5 ms of the file, on the grid of the timestep.
    assert longest > 0.05
    assert math.remainder(longest, 5e-3) == pytest.approx(0, abs=1e-12)


def test_lqr_stands_its_delay_margin(tmp_path: Path) -> None:
    studied = of_file(tmp_path, "computing delay")
    (delay,) = tolerances(studied, 0)
    design = studied.laws[0].controller.designed.lqr
    _, phase, _, crossing = control.margin(control.ss(design.A, design.B, design.K, [[0.0]]))
    # The hold of a sample is another half of a control period.
    margin = math.radians(phase) / crossing - studied.experiment.settings.control_period / 2
    assert delay.physics_agrees
    # A growth by less than half in fifty seconds is not told from none.
    assert factor(delay.largest_kept) * DELAY < 1.1 * margin
    assert factor(delay.smallest_failed) * DELAY > 0.95 * margin
