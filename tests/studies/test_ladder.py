"""From equations to a machine: the rungs, what is measured on them, the answer, the command."""

from __future__ import annotations

import itertools
import json
import math
import signal
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grosmc_mj import cli
from grosmc_mj.arrays import Array
from grosmc_mj.chapter.claims.cited import cited_claims
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.loop import Computing, Loop
from grosmc_mj.machine import (
    LuGre,
    MachinePart,
    Motor,
    SlidingLoad,
    Stop,
    SwingingLoad,
    Transmission,
    Wall,
)
from grosmc_mj.results.document import json_text
from grosmc_mj.studies import ladder as study_of
from grosmc_mj.studies.ladder import (
    ENDED,
    Climb,
    Ladder,
    Rung,
    answer_table,
    assumed_text,
    claims_table,
    climb,
    fallen,
    first_failed,
    ladder,
    ladder_document,
    ladders_text,
    oscillation,
    rungs_of,
    verdict,
    way,
)
from grosmc_mj.studies.studied import Condition, StudiedLaw

TIME: Array = 1e-3 * np.arange(10_000)

# --- what a run does in its end ---


SWING, SLOW = np.sin(6 * math.pi * TIME), np.sin(2 * math.pi * TIME)
FIVE = 0.1 * np.sin(10 * math.pi * TIME)


@pytest.mark.parametrize(
    ("signal", "amplitude", "frequency"),
    [
        *((0.5 + 0.2 * np.sin(2 * math.pi * f * TIME), 0.2, f) for f in (2.0, 7.3, 40.0)),
        # Only the end of a run counts.
        (np.where(TIME < 8, 5 * np.sin(50 * TIME), FIVE), 0.1, 5.0),
        # A ripple on a swing is no swing of its own.
        (SWING + 0.05 * np.sin(2 * math.pi * 211 * TIME), 1.05, 3.0),
        # What rests, creeps (half of the way in 2 s) or swings twice is no cycle.
        (np.full(10_000, 0.3), 0.0, None),
        (0.1 * TIME, 0.1, None),
        (SLOW, 1.0, None),
    ],
)
def test_a_swing_has_its_amplitude_and_frequency(
    signal: Array, amplitude: float, frequency: float | None
) -> None:
    swings, cycle = oscillation(TIME, signal)
    assert swings == pytest.approx(amplitude, rel=0.01)
    # The end is 2 s long, in which a crossing more or less is a quarter of a hertz.
    near = frequency if frequency is None else pytest.approx(frequency, abs=0.25)
    assert cycle == near


# --- the rungs ---


def machine(system: str) -> Experiment:
    return find_experiment(system, "machine")


def kinds(rung: Rung) -> list[type[MachinePart]]:
    return [type(part) for part in rung.parts]


def test_the_rungs_of_a_servo_add_one_thing_each() -> None:
    climbing, alone = rungs_of(machine("servo"))
    loop = ["sensors", "delay", "jitter", "missed samples", "actuator"]
    added = [*loop, "motor", "friction", "backlash", "flexibility", "stops"]
    assert [rung.name for rung in climbing] == ["corrected", "physics", "sampled", *added]
    assert [rung.name for rung in alone] == added
    assert [rung.sampled for rung in climbing[:3]] == [False, False, True]
    assert [rung.plant for rung in climbing] == ["corrected", *["physics"] * 12]
    assert not any(rung.looped or rung.parts for rung in climbing[:3])
    grown = [kinds(rung) for rung in climbing[7:]]
    assert grown == [
        [],
        [Motor],
        [Motor, LuGre],
        [Motor, LuGre, Transmission],
        [Motor, LuGre, Transmission],
        [Motor, LuGre, Transmission, Stop],
    ]
    assert [kinds(rung) for rung in alone[5:]] == [
        [Motor], [LuGre], [Transmission], [Transmission], [Stop]
    ]  # fmt: skip


def test_the_top_is_the_whole_machine_in_its_whole_loop() -> None:
    for system in ("servo", "cart_pendulum", "arm", "two_link_arm"):
        whole = machine(system)
        top = rungs_of(whole)[0][-1]
        parts = {edit for edit in whole.case.edits if isinstance(edit, MachinePart)}
        assert set(top.parts) == parts
        assert len(top.parts) == len(parts)
        assert top.loop == whole.case.loop
        assert (Wall in kinds(top)) == (system == "two_link_arm")
    assert rungs_of(machine("cart_pendulum"))[0][0].name == "printed"


def test_a_rung_of_the_loop_has_that_part_of_it_alone() -> None:
    whole = machine("servo").case.loop
    assert whole is not None
    climbing, (sensors, delay, jitter, missed, actuator, motor, *_) = rungs_of(machine("servo"))
    computing = whole.computing
    none = Loop(seed=whole.seed)
    assert sensors.loop == Loop(sensors=whole.sensors, estimators=whole.estimators, seed=whole.seed)
    for rung, name in ((delay, "delay"), (jitter, "jitter"), (missed, "missed")):
        assert rung.loop == Loop(Computing(**{name: getattr(computing, name)}), seed=whole.seed)
    # What is late comes on top of the delay.
    assert next(r for r in climbing if r.name == "missed samples").loop.computing == computing
    assert actuator.loop == Loop(actuators=whole.actuators, seed=whole.seed)
    looped = (sensors, delay, jitter, missed, actuator)
    assert none not in [rung.loop for rung in looped]
    assert [rung.looped for rung in (*looped, motor)] == [*[True] * 5, False]


def test_rungs_say_which_of_their_numbers_nobody_has_published() -> None:
    found = {rung.name: rung for rung in rungs_of(machine("servo"))[1]}
    assert found["jitter"].assumed == ("computing: jitter",)
    assert found["friction"].assumed == ("shaft: static, stiffness, damping, stribeck",)
    assert found["backlash"].assumed == ("shaft: backlash",)
    assert found["flexibility"].assumed == ("shaft: stiffness, damping",)
    assert found["sensors"].assumed == found["motor"].assumed == ()
    titles = [found[name].title for name in ("jitter", "motor")]
    assert titles == ["jitter*", "motor"]


def test_teeth_come_before_what_gives_way_and_make_room_for_it() -> None:
    climbing, alone = rungs_of(machine("cart_pendulum"))
    named = {rung.name: rung for rung in climbing}
    (own,) = (e for e in machine("cart_pendulum").case.edits if isinstance(e, Transmission))
    for rungs in (named, {rung.name: rung for rung in alone}):
        for name, stiffness in (("backlash", math.inf), ("flexibility", own.stiffness)):
            (found,) = (p for p in rungs[name].parts if isinstance(p, Transmission))
            assert found.stiffness == stiffness
            assert (found.backlash, found.inertia) == (own.backlash, own.inertia)
    # Of two joints with friction none takes the other's place.
    assert {p.joint for p in named["stops"].parts if isinstance(p, LuGre)} == {"slider", "hinge"}


LOADED = """
plant = { system = "servo" }
run = { duration = "20 ms" }
controller = [{ law = "lqr" }]
stop = [{ joint = "shaft", low = "-1 rad", high = "1 rad" }]
swinging_load = [
  { body = "rotor", mass = "10 g", length = "10 cm" },
  { body = "rotor", mass = "20 g", length = "10 cm" },
]
sliding_load = [{ body = "rotor", mass = "10 g", stiffness = "100 N/m" }]
transmission = [{ joint = "shaft", inertia = "0.01 kg m^2", stiffness = "100 N m/rad" }]
"""


def test_what_a_machine_has_not_is_no_rung(tmp_path: Path) -> None:
    bench, alone = rungs_of(find_experiment("servo", "bench"))
    late = ["delay", "jitter", "missed samples"]
    assert [rung.name for rung in alone] == ["sensors", *late, "actuator"]
    assert len(bench) == 8
    file = tmp_path / "mine.toml"
    file.write_text(LOADED, encoding="utf-8")
    climbing, alone = rungs_of(Experiment.load(file))
    assert [rung.name for rung in alone] == ["flexibility", "loads", "stops"]
    # Loads of one body do not take each other's place.
    assert kinds(climbing[-1]) == [
        Transmission, SwingingLoad, SwingingLoad, SlidingLoad, Stop
    ]  # fmt: skip


# --- the answer ---


def row(rung: str, used: float, law: str = "lqr", **changes: Any) -> Climb:
    numbers = {"tightest": "settles_within", "together": True, "condition": "nominal", **changes}
    return Climb(law=law, rung=rung, share_of_the_tightest_limit=used, **numbers)


RUNGS = ("printed", "physics", "sampled", "delay", "friction", "stops")
WAY = [
    row(name, used)
    for name, used in zip(RUNGS, (math.inf, 0.3, 1.0, 1.2, 0.9, math.inf), strict=True)
]


@cache
def study(*names: str, loaded: bool = False) -> Ladder:
    """A ladder of these rungs; those of ``RUNGS`` by default."""
    studied = ladder("servo", ["lqr", "pid"], loaded=loaded)
    own = tuple(Rung(name, "physics") for name in names or RUNGS)
    return replace(studied, climbing=own, conditions=studied.conditions[:2])


def test_a_law_climbs_from_equations_that_are_true() -> None:
    """What the book has misprinted is no rung to fall from."""
    rows = [*WAY, row("physics", 9.0, "pid"), row("delay", 9.0, together=False)]
    climbed = way(rows, "lqr", "nominal")
    assert climbed == WAY[1:]
    assert first_failed(climbed) is WAY[3]
    assert first_failed(climbed[:2]) is None
    assert way(rows, "lqr", "case1") == []


@pytest.mark.parametrize(
    ("used", "changes", "share", "why"),
    [
        (0.31, {}, "0.31", "settles within: 0.31 times"),
        (8.2, {}, "8.2x", "settles within: 8.2 times"),
        (math.inf, {}, "never", "settles within: never"),
        (
            3.0,
            {"optimum_settles": 1.84},
            "3x",
            "settles within: 3 times (the nominal optimum needs 1.84 s)",
        ),
        (math.inf, {"tightest": ENDED}, "ended", ENDED),
        (math.inf, {"impossible": "there is no loop"}, "-", "there is no loop"),
    ],
)
def test_shares_and_reasons_are_said_in_words(
    used: float, changes: dict[str, Any], share: str, why: str
) -> None:
    found = row("a", used, **changes)
    assert (found.share_text, found.reason) == (share, why)


def test_passing_every_rung_and_passing_the_complete_machine_are_two_columns() -> None:
    made, rows = (
        study(),
        [
            *WAY,
            *(row(name, 0.5, "stands") for name in RUNGS[1:]),
            row("delay", 3.0, "recovers"),
            row("stops", 0.9, "recovers"),
            row("physics", 0.5, "interrupted"),
        ],
    )
    assert verdict(made, rows, "nominal") == (
        "1 of 4 laws pass every rung, 2 the complete machine; delay breaks 2."
    )
    cells = {each[0]: each[1:4] for each in answer_table(made, rows, made.conditions[0]).rows}
    assert cells == {
        "stands": ["yes", "yes (0.5)", ""],
        "lqr": ["no", "no (never)", "delay: settles within: 1.2 times"],
        "recovers": ["no", "yes (0.9)", "delay: settles within: 3 times"],
        "interrupted": ["", "", ""],
    }


def test_a_run_that_cannot_be_is_said_and_not_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    studied = ladder("servo", ["lqr"])

    def refused(*_: object) -> None:
        raise ArgumentError("there is no such law")

    monkeypatch.setattr(study_of, "run_of", refused)
    (law,), (nominal,) = studied.laws, studied.conditions
    found = climb(studied, law, studied.climbing[0], nominal, together=True)
    assert found.impossible == "there is no such law"
    assert (found.kept, found.amplitude, found.shares) == (False, None, {})


def test_rivals_climb_on_request_and_the_file_s_own_loads_act(tmp_path: Path) -> None:
    names = {law.name for law in ladder("servo").laws}
    assert {"lqr", "pv", "implicit, predicted"} <= names
    assert names.isdisjoint({"lqi", "pid", "adrc", "adaptive, quick"})
    assert len(ladder("servo", rivals=True).laws) == 19
    # Any law of the file is known by its name, as the file has it.
    assert [law.name for law in ladder("servo", ["grosmc", "lqr"]).laws] == ["grosmc", "lqr"]
    assert [each.name for each in ladder("servo").conditions] == ["nominal"]
    loaded = [each.name for each in ladder("servo", loaded=True).conditions]
    assert loaded == ["nominal", "case1", "case2"]
    load = 'body = "rotor", torque = ["0 N m", "1 N m", "0 N m"], profile = "constant"'
    text = CLAIMED.replace("[[claim]]", f"disturbance = [{{ {load} }}]\n[[claim]]")
    mine = str(written(tmp_path, text))
    assert [each.name for each in ladder(mine).conditions] == ["under load"]
    both = [each.name for each in ladder(mine, loaded=True).conditions]
    assert both == ["under load", "nominal"]


# --- the chapter's claims ---

RISEN = [
    row("printed", 0.5, claims={"quick": 7.0}),
    row("physics", 0.5, claims={"quick": 0.2, "same": 1.0, "well": 0.1}),
    row("delay", 0.5, claims={"quick": 1.01, "same": 0.9}),
    row("friction", 0.5, claims={"quick": 0.5, "same": math.inf}),
    row("physics", 0.5, "pid"),
]
SAID = {name: f"It is {name}" for name in ("quick", "same", "well")}


def test_a_claim_falls_on_the_first_rung_that_breaks_it() -> None:
    climbed = way(RISEN, "lqr", "nominal")
    assert fallen(climbed, "quick") is climbed[1]
    assert fallen(climbed, "same") is climbed[2]
    assert fallen(climbed[:1], "quick") is None
    table = claims_table(study(), RISEN, "nominal")
    assert table is not None
    assert [column.header for column in table.columns] == ["law", "`quick`", "`same`", "`well`"]
    assert table.rows == [["lqr", "delay", "friction", "stands"]]
    assert claims_table(study(), WAY, "nominal") is None


@pytest.mark.parametrize("system", ["servo", "cart_pendulum", "arm", "two_link_arm"])
def test_claims_of_machines_are_in_the_ledger_with_its_limits(system: str) -> None:
    """The same and well are 2 %: of the step, of the start, or of the amplitude of 1 rad."""
    made = machine(system)
    cited = cited_claims(made)
    assert {claim.system for claim in cited.values()} == {system}
    assert len(made.claimed) == len(made.file.claim)
    law, x0 = made.law("physics", "lqr"), np.array(made.case.x0)
    error = law.designed.error
    z = np.array(error.error_state(0.0, x0, law.parameters))
    start = float(np.linalg.norm(z[list(error.output_rows)]))
    for table, limit in zip(made.file.claim, made.claimed, strict=True):
        claim = cited[table.id]
        if claim.id == "arm-tracking":
            assert limit.value == claim.threshold / 100 * 1.0
        elif limit.kind == "settles_within":
            assert limit.value == 2 * (1 + claim.threshold / 100)
        else:
            assert limit.value == pytest.approx(claim.threshold / 100 * start, rel=2e-3)


def test_the_page_has_claims_distances_and_the_machine_under_each_condition() -> None:
    rows = [
        row("physics", 0.5, deviation=0.0123, claims={"quick": 0.5}),
        row("physics", 0.5, "pid"),
        row("physics", 3.25, condition="case1"),
        row("physics", 3.25, "pid", condition="case1"),
    ]
    rung = Rung("physics", "physics", assumed=("computing: jitter",))
    made = replace(study("physics", loaded=True), climbing=[rung], statements=SAID)
    document = json.loads(json_text(ladder_document(made, rows, complete=True)))
    assert [Climb.model_validate(x) for x in document["climbs"]] == rows
    parts = ladders_text([document]).split("\n\n")
    tables = {before: part.splitlines()[2:] for before, part in itertools.pairwise(parts)}
    assert tables["Rungs added one by one:"] == ["| lqr | 0.5 |", "| pid | 0.5 |"]
    loaded = f"The complete machine, nominally and under load (case1: {made.conditions[1].title}):"
    assert tables[loaded] == ["| lqr | 0.5 | 3.25x |", "| pid | 0.5 | 3.25x |"]
    distance = "Largest distance from the nominal optimum [mrad], of the laws that follow it:"
    assert tables[distance] == ["| lqr | 12.3 |"]
    assert tables["Rung on which each claim fails:"] == ["| lqr | stands |"]
    assert parts[-1] == "`quick`: It is quick."
    assert f"\\{assumed_text(made)}" in parts
    assert assumed_text(made) == (
        "* rests on numbers that are assumed: physics (computing: jitter)."
    )
    bare = ladders_text([json.loads(json_text(ladder_document(study(), WAY, complete=True)))])
    assert "under load" not in bare
    assert "falls" not in bare


# --- a real one ---


@cache
def climbed() -> list[Climb]:
    """LQR on the servo, rung by rung, and with friction alone."""
    studied = ladder("servo", ["lqr"])
    steps = [x for x in studied.steps() if x[3] or x[1].name == "friction"]
    return [climb(studied, *x[:3], together=x[3]) for x in steps]


@pytest.mark.slow
def test_lqr_climbs_a_servo_up_to_its_friction() -> None:
    rungs = way(climbed(), "lqr", "nominal")
    assert [each.rung for each in rungs[:4]] == ["corrected", "physics", "sampled", "sensors"]
    broken = first_failed(rungs)
    assert broken is not None
    assert (broken.rung, broken.tightest) == ("friction", "settles_within")
    # The optimum's poles are -1 and -12 rad/s: 2 % of 1 rad after ln(50 * 12/11) = 4.0 s.
    assert broken.optimum_settles == pytest.approx(math.log(50 * 12 / 11), abs=0.06)
    # The chapter's 2 % of the step fall there, too, as they are said of both laws.
    assert fallen(rungs, "servo-before-load") is broken
    assert {claim for each in rungs for claim in each.claims} == {"servo-before-load"}
    # It needs no other imperfection for that, and stops where friction holds the rest of K e.
    assert not climbed()[-1].kept
    assert not any(each.kept for each in rungs[rungs.index(broken) :])


@pytest.mark.slow
def test_physics_stands_as_the_equations_and_a_motor_as_its_amplifier() -> None:
    found = {each.rung: each for each in climbed() if each.together}
    used = {name: each.share_of_the_tightest_limit for name, each in found.items()}
    assert used["physics"] == pytest.approx(used["corrected"], rel=1e-3)
    # The model's damping has the back-EMF in it, and 24 V are enough: it changes nothing.
    motor, actuator = found["motor"], found["actuator"]
    for name in ("share_of_the_tightest_limit", "variation", "amplitude", "shares"):
        assert getattr(motor, name) == pytest.approx(getattr(actuator, name), rel=0.01)
    # Encoders' steps make the input move.
    assert (found["sensors"].variation or 0.0) > 1.5 * (found["sampled"].variation or 0.0)
    assert found["sensors"].frequency is not None


# --- the command ---


def ran(*arguments: str) -> int:
    with pytest.raises(SystemExit) as stop:
        cli.main(["study", "ladder", *arguments])
    assert isinstance(stop.value.code, int)
    return stop.value.code


def stood(_: object, law: StudiedLaw, rung: Rung, condition: Condition, *, together: bool) -> Climb:
    """A law that keeps everything up to the motor, and ends at the stops."""
    high, ended = rung.name in ("friction", "backlash", "flexibility"), rung.name == "stops"
    used = math.inf if ended else 3.25 if high else 0.5
    claims = {"servo-before-load": used / 3} if law.name == "lqr" else {}
    changes = {"together": together, "condition": condition.name, "claims": claims}
    tightest = ENDED if ended else "deviation_below"
    return row(rung.name, used, law.name, **changes, tightest=tightest)


def test_the_command_writes_what_it_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(study_of, "climb", stood)
    assert ran("servo", "--laws", "lqr", "pid", "--out", str(tmp_path)) == cli.DONE
    said = capsys.readouterr().out
    assert "0 of 2 laws pass every rung, 0 the complete machine; friction breaks 2." in said
    assert "deviation below: 3.25" in " ".join(said.split())
    assert "ladder_servo_machine.json" in said
    # A limit of three times the requirement's falls where 3.25 times that are used.
    assert "servo-before-load" in said
    found = json.loads((tmp_path / "ladder_servo_machine.json").read_text(encoding="utf-8"))
    assert found["complete"]
    assert found["configuration"]["target"] == "servo/machine"
    assert [law["name"] for law in found["laws"]] == ["lqr", "pid"]
    climbing, alone = rungs_of(machine("servo"))
    assert [rung["name"] for rung in found["climbing"]] == [rung.name for rung in climbing]
    assert len(found["climbs"]) == 2 * (len(climbing) + len(alone))
    flexible = next(rung for rung in found["climbing"] if rung["name"] == "backlash")
    # What has no end is null in a document.
    gears = [x["stiffness"] for x in flexible["parts"] if x["kind"] == "transmission"]
    assert gears == [None]
    stated = {each["claim"]: each["statement"] for each in found["claims"]}
    assert stated["servo-before-load"].startswith("Without disturbance both laws")
    assert found["climbs"][0]["claims"] == {"servo-before-load": 0.5 / 3}
    last = next(s for s in found["climbs"] if s["rung"] == "stops")
    assert last["share_of_the_tightest_limit"] is None
    assert (last["kept"], last["tightest"]) == (False, ENDED)
    assert [x["breaks_at"] for x in found["standings"]] == ["friction", "friction"]
    for suffix in ("png", "svg"):
        assert (tmp_path / f"ladder_servo_machine.{suffix}").stat().st_size > 1000


class Killed(BaseException):
    """Ends a ladder as SIGKILL does: nothing that is done at an interrupt is done."""


def test_a_killed_ladder_goes_on_to_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the rung at which it was killed; a file of another version is climbed anew."""
    ran_rungs: list[tuple[str, bool]] = []
    stop = ["delay"]

    def counted(studied: Any, law: Any, rung: Rung, *rest: Any, **options: Any) -> Climb:
        if rung.name in stop:
            raise Killed
        ran_rungs.append((rung.name, options["together"]))
        return stood(studied, law, rung, *rest, **options)

    monkeypatch.setattr(study_of, "climb", counted)
    file = tmp_path / "ladder_servo_machine.json"
    options = ("--laws", "lqr", "--out", str(tmp_path))
    with pytest.raises(Killed):
        cli.main(["study", "ladder", "servo", *options])
    assert not file.exists()
    below = ran_rungs.copy()
    assert below == [(name, True) for name in ("corrected", "physics", "sampled", "sensors")]
    stop.clear()
    assert ran("servo", *options, "--resume") == cli.DONE
    resumed = file.read_bytes()
    assert len(ran_rungs) == len(set(ran_rungs))
    ran_rungs.clear()
    assert ran("servo", *options) == cli.DONE
    assert ran_rungs[: len(below)] == below
    assert file.read_bytes() == resumed
    ran_rungs.clear()
    assert ran("servo", *options, "--resume") == cli.DONE
    assert not ran_rungs
    for name, other in (("versions", {"mujoco": "another"}), ("source_digest", "another")):
        monkeypatch.setattr(study_of, name, lambda other=other: other)
        assert ran("servo", *options, "--resume") == cli.DONE
        assert ran_rungs[: len(below)] == below
        ran_rungs.clear()


# Killed by itself while its fifth run is under way.
KILLED = """
import os, signal, sys
from grosmc_mj import cli
from grosmc_mj.studies import ladder
climb, count = ladder.climb, iter(range(4))
def killed(*parts, **options):
    if next(count, None) is None:
        os.kill(os.getpid(), signal.SIGKILL)
    return climb(*parts, **options)
ladder.climb = killed
cli.main(sys.argv[1:])
"""


@pytest.mark.slow
def test_sigkill_keeps_what_was_climbed(tmp_path: Path) -> None:
    file = written(tmp_path, CLAIMED)
    outs = [tmp_path / name for name in ("killed", "undisturbed")]
    options = [("study", "ladder", str(file), "--laws", "lqr", "--out", str(out)) for out in outs]
    process = subprocess.run([sys.executable, "-c", KILLED, *options[0]], check=False)
    assert process.returncode == -signal.SIGKILL
    assert len(list((outs[0] / "ladder_mine").iterdir())) == 4
    assert ran(*options[0][2:], "--resume") == ran(*options[1][2:]) == cli.DONE
    one, other = ((out / "ladder_mine.json").read_text(encoding="utf-8") for out in outs)
    assert one.replace(str(outs[0]), str(outs[1])) == other


def test_a_ladder_of_other_python_or_of_another_model_is_another_one(tmp_path: Path) -> None:
    """Rows depend on what a law of the user's own says, not on its name alone."""
    studied, law = ladder("servo", ["lqr"]), tmp_path / "mine.py"
    law.write_text("def law(): ...", encoding="utf-8")
    machine = replace(studied.machine, path=tmp_path / "mine.toml")
    table = machine.file.law("lqr").model_copy(update={"law": "mine:law"})
    file = machine.file.model_copy(update={"controller": [table]})
    own = replace(studied, machine=replace(machine, file=file), laws=[])
    before = own.configuration()
    law.write_text("def law(): return 0.0", encoding="utf-8")
    assert before["sources"].keys() == own.configuration()["sources"].keys() != set()
    assert before["sources"] != own.configuration()["sources"]
    assert before["model"] != ladder("arm", ["lqr"]).configuration()["model"]


@pytest.mark.parametrize("terminated", [False, True])
def test_an_interrupt_and_a_termination_keep_what_was_climbed(
    terminated: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def stopped(studied: Any, law: Any, rung: Rung, *rest: Any, **options: Any) -> Any:
        if rung.name == "delay":
            if terminated:
                signal.raise_signal(signal.SIGTERM)
            raise KeyboardInterrupt
        return stood(studied, law, rung, *rest, **options)

    monkeypatch.setattr(study_of, "climb", stopped)
    assert ran("servo", "--laws", "lqr", "--out", str(tmp_path)) == 130
    output = capsys.readouterr()
    assert "ladder_servo_machine.json" in output.out
    assert "the same command with --resume" in output.err
    found = json.loads((tmp_path / "ladder_servo_machine.json").read_text(encoding="utf-8"))
    assert not found["complete"]
    assert [each["rung"] for each in found["climbs"]] == [
        "corrected", "physics", "sampled", "sensors"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("servoo",), "unknown case 'servoo': did you mean 'servo'"),
        (("nowhere.toml",), "nowhere.toml: there is no such file"),
        (("maglev",), "there is nothing to climb to: give the file a loop"),
        (("servo/nominal",), "there is nothing to climb to"),
        (("servo", "--laws", "lqrr"), "unknown law 'lqrr': did you mean 'lqr'"),
        (("servo", "--film", "lqrr"), "unknown law 'lqrr': did you mean 'lqr'"),
        ((), "missing: SYSTEM|SYSTEM/CASE|FILE.toml"),
    ],
)
def test_a_target_that_cannot_be_climbed_is_told_in_one_line(
    arguments: tuple[str, ...], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ran(*arguments, "--out", str(tmp_path)) == 2
    error = capsys.readouterr().err.strip()
    assert said in error
    assert "\n" not in error
    assert list(tmp_path.iterdir()) == []


CLAIMED = """
plant = { system = "servo" }
run = { duration = "20 ms" }
controller = [{ law = "lqr" }]
lugre = [{ joint = "shaft", coulomb = "0.05 N m" }]
requirement = [{ deviation_below = "1 rad" }]
[[claim]]
id = "servo-before-load"
deviation_below = "1 urad"
"""


def written(folder: Path, text: str) -> Path:
    file = folder / "mine.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_no_verdict_depends_on_a_claim(tmp_path: Path) -> None:
    """Friction breaks it, and the run keeps all that is required."""
    file = written(tmp_path, CLAIMED)
    with pytest.raises(SystemExit) as stop:
        cli.main(["run", str(file), "--out", str(tmp_path)])
    assert stop.value.code == 0
    studied = ladder(str(file), ["lqr"])
    (law,), condition = studied.laws, studied.conditions[0]
    found = climb(studied, law, studied.alone[0], condition, together=False)
    assert found.kept
    assert found.claims["servo-before-load"] > 1


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("servo-before-load", "servo-befor-load", "did you mean 'servo-before-load'"),
        ("1 urad", "1 V", 'claim 1: deviation_below: "1 V" cannot be converted to rad'),
        ('"servo-before-load"', '"servo-before-load"\nunder = "case3"', "claim 1"),
        ('"servo-before-load"', '"servo-before-load"\nof = ["lqrr"]', "did you mean 'lqr'"),
        ('deviation_below = "1 urad"', "", "claim 1: nothing is required"),
        ('requirement = [{ deviation_below = "1 rad" }]', "", "nothing is required: give it a"),
    ],
)
def test_a_wrong_claim_is_told_in_one_line(
    old: str, new: str, said: str, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    file = written(tmp_path, CLAIMED.replace(old, new))
    with pytest.raises(SystemExit) as stop:
        cli.main(["study", "ladder", str(file), "--out", str(tmp_path)])
    assert stop.value.code == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith(f"grosmc-mj: {file}: ")
    assert said in error
    assert "\n" not in error
