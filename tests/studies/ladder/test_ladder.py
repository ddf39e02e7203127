"""From equations to a machine: measurements on rungs, what they depend on, the command."""

from __future__ import annotations

import json
import math
import shutil
import signal
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cases
import numpy as np
import pytest
from commands import assert_one_line, run

import grosmc_mj
from grosmc_mj import cli
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.mechanics.physics.edits import BodyEdit
from grosmc_mj.output.results.verdicts import Verdict, described, first_failed, verdict_of
from grosmc_mj.simulation.loop import Loop, Sensor
from grosmc_mj.simulation.loop.sensors import quantized
from grosmc_mj.studies import study as cells
from grosmc_mj.studies.ladder import answer
from grosmc_mj.studies.ladder import ladder as study
from grosmc_mj.studies.ladder.climb import ALONE, UP_TO, fallen
from grosmc_mj.studies.ladder.ladder import ladder, run_rung
from grosmc_mj.studies.ladder.rungs import Rung
from grosmc_mj.studies.study import CellRunner, StudyCell

FRICTION: dict[str, Any] = {"lugre": {"joint": "shaft", "coulomb": "0.05 N m"}}
REQUIRED: dict[str, Any] = {"requirement": {"deviation_below": "1 rad"}}
CLAIM = {"id": "servo-before-load", "deviation_below": "1 urad"}
LOAD = {"body": "rotor", "torque": ["0 N m", "1 N m", "0 N m"], "profile": "constant"}


def written(folder: Path, **tables: Any) -> str:
    """A servo with friction, a requirement and a claim, and further tables."""
    return str(cases.write(folder, **{**FRICTION, **REQUIRED, "claim": CLAIM, **tables}))


def first_rung_alone(studied: study.Ladder) -> Verdict:
    climb = (studied.laws[0], studied.alone[0], studied.conditions[0])
    return run_rung(studied, *climb, together=False)


# What is run on a rung.


def test_draws_are_the_runs_of_a_seed(tmp_path: Path) -> None:
    file = cases.write(
        tmp_path,
        run={"duration": "0.2 s"},
        computing={"seed": 0, "run": 0},
        sensor={"of": "rotor angle", "noise": "30 mrad"},
        requirement={"final_error_below": "0.89 rad"},
    )
    case = Experiment.load(file)
    runs = [case.changed({"computing.run": number}).run() for number in range(10)]
    kept = sum(run.requirements[0].kept for run in runs)
    assert 0 < kept < 10

    ten = ladder(str(file), ["lqr"], draws=10)
    judged = run_rung(ten, ten.laws[0], ten.climbing[-1], ten.conditions[0], together=True)
    assert (judged.draws, judged.kept_draws) == (10, kept)
    assert not judged.kept


def test_a_rung_without_a_draw_runs_once() -> None:
    ten = ladder("servo", ["lqr"], draws=10)
    sampled = next(rung for rung in ten.climbing if rung.name == "sampled")
    judged = run_rung(ten, ten.laws[0], sampled, ten.conditions[0], together=True)
    assert (judged.draws, judged.kept_draws) == (1, 1)


def test_a_draw_moves_the_steps_of_an_encoder() -> None:
    encoder = Loop(sensors=(Sensor("rotor angle", resolution=0.1),))
    phases = [encoder.draw(number).sensors[0].phase for number in range(100)]
    assert phases[0] == 0
    assert -0.5 <= min(phases) < -0.4
    assert 0.4 < max(phases) <= 0.5


@pytest.mark.parametrize("phase", [-0.5, -0.2, 0.0, 0.3, 0.5])
def test_an_encoder_of_any_phase_is_wrong_by_half_a_step_at_most(phase: float) -> None:
    angles = np.linspace(-0.3, 0.3, 1001)
    middle = phase * 0.1
    readings = np.array([quantized(angle - middle, 0.1) + middle for angle in angles])
    assert np.max(np.abs(readings - angles)) <= 0.05 * (1 + 1e-9)
    assert np.min(np.abs(readings - middle)) < 1e-9


def test_rivals_climb_on_request() -> None:
    names = {law.name for law in ladder("servo").laws}
    assert {"lqr", "pv", "implicit, predicted"} <= names
    assert names.isdisjoint({"lqi", "fl-pid", "adrc", "adaptive, quick"})
    assert len(ladder("servo", rivals=True).laws) == 19
    assert [law.name for law in ladder("servo", ["grosmc", "lqr"]).laws] == ["grosmc", "lqr"]


def test_loads_of_the_system_act_on_request_and_the_file_s_own_always(tmp_path: Path) -> None:
    def conditions(target: str, *, loaded: bool = False) -> list[str]:
        return [condition.name for condition in ladder(target, loaded=loaded).conditions]

    assert conditions("servo") == ["nominal"]
    assert conditions("servo", loaded=True) == ["nominal", "case1", "case2"]
    mine = written(tmp_path, disturbance=LOAD)
    assert conditions(mine) == ["under load"]
    assert conditions(mine, loaded=True) == ["under load", "nominal"]


def test_no_verdict_depends_on_a_claim(tmp_path: Path) -> None:
    """Friction breaks it, the run keeps what is required; of its limits the worst counts."""
    loose = {"input_below": "100 A", "stays_within": "100 rad"}
    file = written(tmp_path, claim={**CLAIM, **loose})
    assert run("run", file, "--no-figures", "--out", tmp_path) == cli.DONE
    alone = first_rung_alone(ladder(file, ["lqr"]))
    assert alone.kept
    assert alone.claims["servo-before-load"] > 1


def test_a_law_that_cannot_be_designed_has_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise ArgumentError("there is no such law")

    monkeypatch.setattr(study, "trial_of", refused)
    step = first_rung_alone(ladder(written(tmp_path), ["lqr"]))
    assert (step.impossible, step.kept, step.shares) == ("there is no such law", False, {})


def test_the_measured_machine_stands_beside_the_model_of_it(tmp_path: Path) -> None:
    log = Path(grosmc_mj.__file__).parent / "experiments" / "cases" / "logs" / "servo_step.csv"
    shutil.copy(log, tmp_path)
    file = cases.write(
        tmp_path,
        plant={"compare": ["physics"]},
        run={"duration": "3 s", "timestep": "0.5 ms", "control_period": "1 ms"},
        task={"reference": ["1"]},
        computing={"delay": "6.5 ms"},
        edit=[{"body": "rotor", "mass_scale": 1.788}, {"joint": "shaft", "damping": 0.02734}],
        controller={"law": "pd", "frequency": 6, "damping": 0.7},
        requirement=[{"reaches_within": "1.5 s", "band": "20 mrad"}, {"overshoot_below": 0.08}],
        measured={"log": "servo_step.csv"},
    )
    studied = ladder(str(file), ["pd"])
    (measured,) = study.measured_rows(studied)
    (condition,) = studied.conditions
    modelled = run_rung(studied, studied.laws[0], studied.climbing[-1], condition, together=True)
    assert measured.tightest == modelled.tightest == "overshoot_below"
    assert not measured.kept
    assert measured.share == pytest.approx(modelled.share, rel=0.05)
    assert answer.verdict(studied, [modelled, measured], condition.name).endswith(
        "The measured machine agrees with the model on 1 of 1 law."
    )


# LQR on the servo.


@cache
def servo_climb() -> tuple[dict[str, Verdict], Verdict]:
    """Results of LQR on the rungs of a servo, and with its friction alone."""
    studied = ladder("servo", ["lqr"])
    steps = [x for x in studied.runs() if x[3] or x[1].name == "friction"]
    *rungs, friction_alone = [run_rung(studied, *x[:3], together=x[3]) for x in steps]
    return {rung.step: rung for rung in rungs}, friction_alone


@pytest.mark.slow
def test_lqr_climbs_a_servo_up_to_its_friction() -> None:
    by_name, friction_alone = servo_climb()
    rungs = list(by_name.values())
    broken = first_failed(rungs)
    assert broken is not None
    assert (broken.step, broken.tightest) == ("friction", "settles_within")
    # The optimum's poles are -1 and -12 rad/s: 2 % of 1 rad after ln(50 * 12/11) = 4.0 s.
    assert broken.numbers["optimum_settles"] == pytest.approx(math.log(50 * 12 / 11), abs=0.06)
    # The chapter's 2 % of the step fall there, too, as they are about both laws.
    assert fallen(rungs, "servo-before-load") is broken
    # It needs no other imperfection for that, and stops where friction holds the rest of K e.
    assert not friction_alone.kept
    assert not any(step.kept for step in rungs[rungs.index(broken) :])


@pytest.mark.slow
def test_rungs_of_the_servo_change_what_they_should() -> None:
    rungs, _ = servo_climb()
    assert rungs["physics"].share == pytest.approx(rungs["corrected"].share, rel=1e-3)

    # The model's damping has the motor's back-EMF in it, and 24 V are enough.
    motor, actuator = rungs["motor"], rungs["actuator"]
    assert motor.shares == pytest.approx(actuator.shares, rel=0.01)
    for name in ("variation", "amplitude"):
        assert motor.numbers[name] == pytest.approx(actuator.numbers[name], rel=0.01)

    # Steps of the encoders make the input move.
    sensors = rungs["sensors"]
    sampled = rungs["sampled"].numbers["variation"] or 0.0
    assert (sensors.numbers["variation"] or 0.0) > 1.5 * sampled
    assert sensors.numbers["frequency"] is not None


# What a row depends on.


@pytest.mark.parametrize(
    "other",
    [{"condition": "case2"}, {"law": "grosmc"}, {"step": "delay"}, {"group": ALONE}],
    ids=["condition", "law", "rung", "group"],
)
def test_rows_of_two_places_are_stored_apart(other: dict[str, str], tmp_path: Path) -> None:
    def cell(row: Verdict) -> StudyCell[Verdict]:
        key = (row.law, row.step, row.condition, row.group)
        return StudyCell("", key, "a ladder", lambda _: row)

    place = {"law": "lqr", "step": "sensors", "condition": "case1", "group": UP_TO}
    first = verdict_of({"settles_within": 0.5}).changed(**place)
    second = verdict_of({"settles_within": 2.0}).changed(**{**place, **other})
    stored = CellRunner(tmp_path, Verdict)
    stored.write(cell(first), first)
    stored.write(cell(second), second)
    assert [stored.read(cell(first)), stored.read(cell(second))] == [first, second]


def test_rows_of_a_ladder_are_made_anew_if_the_load_of_a_case_changes() -> None:
    """The load of case1 stands in no file of the ladder's own."""

    def depends_on(studied: study.Ladder) -> dict[str | bool, str]:
        return {cell.key[2]: cell.depends_on for cell in studied.cells()}

    studied = ladder("servo", ["lqr"], loaded=True)
    assert len({cell.key for cell in studied.cells()}) == 3 * 13 + 10
    *others, load = studied.conditions
    before = depends_on(studied)
    assert depends_on(studied) == before

    heavier = load.experiment.changed(edits=(BodyEdit("rotor", 2.0),))
    after = depends_on(replace(studied, conditions=[*others, replace(load, experiment=heavier)]))
    assert after.pop(load.name) != before.pop(load.name)
    assert after == before


def test_rows_depend_on_the_code_of_a_law_of_one_s_own(tmp_path: Path) -> None:
    file = cases.write(tmp_path, law="mine:law", **FRICTION, **REQUIRED)
    sources = []
    for value in ("0.0", "1.0"):
        (tmp_path / "mine.py").write_text(f"def law(t, x, memory, p):\n    return {value}\n")
        sources.append(ladder(str(file)).configuration()["sources"])
    assert sources[0].keys() == sources[1].keys() != set()
    assert sources[0] != sources[1]


# The command.


class Climber:
    """A law that keeps everything up to the motor, and ends at the stops; can be stopped."""

    def __init__(self) -> None:
        self.ran: list[tuple[str, bool]] = []
        self.at_delay: Callable[[], object] = lambda: None
        self.shares: dict[str, float] = {"friction": 3.25, "backlash": 3.25, "flexibility": 3.25}

    def __call__(self, _: Any, law: Any, rung: Rung, condition: Any, *, together: bool) -> Verdict:
        if rung.name == "delay":
            self.at_delay()
        self.ran.append((rung.name, together))
        verdict = verdict_of({"deviation_below": self.shares.get(rung.name, 0.5)})
        if rung.name == "stops":
            verdict = verdict_of({}, ended="diverged")
        claims = {"servo-before-load": verdict.share / 3} if law.name == "lqr" else {}
        return described(verdict).changed(
            law=law.name,
            step=rung.name,
            condition=condition.name,
            group=UP_TO if together else ALONE,
            claims=claims,
        )


@pytest.fixture
def climber(monkeypatch: pytest.MonkeyPatch) -> Climber:
    """Runs that are made up; no figure is drawn."""
    climber = Climber()
    monkeypatch.setattr(study, "run_rung", climber)
    monkeypatch.setattr("grosmc_mj.output.charts.figure.write_chart", lambda _, path: path)
    return climber


def test_the_command_prints_where_each_law_fails(
    climber: Climber, printed: Callable[..., None]
) -> None:
    printed("study", "ladder", "servo", "--laws", "lqr", "fl-pid")
    document = json.loads(Path("renders/ladder_servo_machine.json").read_text(encoding="utf-8"))
    assert document["complete"]
    assert len(document["verdicts"]) == len(climber.ran) == 2 * (13 + 10)
    assert [law["breaks_at"] for law in document["standings"]] == ["friction", "friction"]
    # JSON has no infinity.
    (teeth,) = (rung["parts"][-1] for rung in document["climbing"] if rung["name"] == "backlash")
    assert teeth["stiffness"] is None
    last = next(row for row in document["verdicts"] if row["step"] == "stops")
    assert (last["share"], last["ended"]) == (None, "diverged")
    assert document["claims"][0]["statement"].startswith("Without disturbance both laws")


def test_a_law_that_fails_on_every_rung_is_a_verdict(climber: Climber, tmp_path: Path) -> None:
    rungs = [rung.name for rung in ladder("servo", ["lqr"]).climbing]
    climber.shares = dict.fromkeys(rungs, 2.0)
    assert run("study", "ladder", "servo", "--laws", "lqr", "--out", tmp_path) == cli.DIFFERS


class Killed(BaseException):
    """Ends a ladder as SIGKILL does: nothing that is done at an interrupt is done."""


@pytest.mark.parametrize("stop", [Killed, KeyboardInterrupt, signal.SIGTERM])
def test_a_stopped_ladder_goes_on_to_the_same_bytes(
    stop: type[BaseException] | signal.Signals, climber: Climber, tmp_path: Path
) -> None:
    """From the rung at which it was stopped."""

    def stopped() -> None:
        if isinstance(stop, signal.Signals):
            signal.raise_signal(stop)
        else:
            raise stop

    climber.at_delay = stopped
    file = tmp_path / "ladder_servo_machine.json"
    command = ("study", "ladder", "servo", "--laws", "lqr", "--out", tmp_path)
    if stop is Killed:
        with pytest.raises(Killed):
            run(*command)
        assert not file.exists()
    else:
        assert run(*command) == cli.INTERRUPTED
        assert not json.loads(file.read_text(encoding="utf-8"))["complete"]
    below = [(name, True) for name in ("corrected", "physics", "sampled", "sensors")]
    assert climber.ran == below

    climber.at_delay = lambda: None
    assert run(*command, "--resume") == cli.DONE
    assert len(climber.ran) == len(set(climber.ran))
    resumed = file.read_bytes()
    everything = climber.ran[:]
    assert run(*command, "--resume") == cli.DONE
    assert climber.ran == everything
    assert run(*command) == cli.DONE
    assert climber.ran == 2 * everything
    assert file.read_bytes() == resumed


@pytest.mark.parametrize(
    ("name", "other"), [("versions", {"mujoco": "another"}), ("source_digest", "another")]
)
def test_a_ladder_of_another_version_is_climbed_anew(
    name: str, other: Any, climber: Climber, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ("study", "ladder", "servo", "--laws", "lqr", "--out", tmp_path)
    assert run(*command) == cli.DONE
    everything = climber.ran[:]
    monkeypatch.setattr(cells, name, lambda: other)
    climber.ran.clear()
    assert run(*command, "--resume") == cli.DONE
    assert climber.ran == everything


WRONG = [
    ("maglev", "there is nothing to climb to: give the file a loop"),
    ("servo --laws lqrr", "unknown law 'lqrr': did you mean 'lqr'"),
    ("servo --film lqrr", "unknown law 'lqrr': did you mean 'lqr'"),
]
WRONG_CLAIMS = [
    ({"id": "servo-befor-load"}, "did you mean 'servo-before-load'"),
    ({"deviation_below": "1 V"}, 'claim 1: deviation_below: "1 V" cannot be converted to rad'),
    ({"under": "case3"}, "claim 1"),
    ({"of": ["lqrr"]}, "did you mean 'lqr'"),
]


def refused(capsys: pytest.CaptureFixture[str], out: Path, *arguments: object) -> str:
    """The one line of a ladder that is refused before anything is written."""
    assert run("study", "ladder", *arguments, "--out", out) == cli.WRONG
    error = capsys.readouterr().err
    assert_one_line(error)
    assert not out.exists()
    return error


@pytest.mark.parametrize(("arguments", "line"), WRONG)
def test_a_target_or_law_that_is_wrong_is_one_line(
    arguments: str, line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert line in refused(capsys, tmp_path / "out", *arguments.split())


@pytest.mark.parametrize(("wrong", "line"), WRONG_CLAIMS)
def test_a_claim_that_is_wrong_is_one_line(
    wrong: dict[str, Any], line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path, claim={**CLAIM, **wrong})
    assert line in refused(capsys, tmp_path / "out", file)


@pytest.mark.parametrize(
    ("tables", "line"),
    [
        ({"claim": {"id": "servo-before-load"}}, "claim 1: nothing is required"),
        ({"requirement": []}, "nothing is required: give it a"),
    ],
)
def test_a_ladder_without_a_limit_is_one_line(
    tables: dict[str, Any], line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert line in refused(capsys, tmp_path / "out", written(tmp_path, **tables))
