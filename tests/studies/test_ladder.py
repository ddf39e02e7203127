"""From equations to a machine: the rungs, what is measured on them, the answer, the command."""

from __future__ import annotations

import json
import math
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
from grosmc_mj.experiments.plants import PlantName
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
from grosmc_mj.studies.ladder import measure
from grosmc_mj.studies.ladder.answers import (
    fall_text,
    fallen,
    first_failed,
    judged_claims,
    of_law,
    reason,
    share_text,
    verdict,
)
from grosmc_mj.studies.ladder.measure import Standing, ladder, standing
from grosmc_mj.studies.ladder.oscillation import Oscillation, chatter, oscillation
from grosmc_mj.studies.ladder.page import ladders_text
from grosmc_mj.studies.ladder.report import assumed_text, claims_table
from grosmc_mj.studies.ladder.rungs import Rung, rungs_of
from grosmc_mj.studies.studied import Condition, StudiedLaw

H = 1e-3
TIME: Array = H * np.arange(10_000)
ALTERNATING: Array = np.where(np.arange(10_000) % 2, 1.0, -1.0)

# --- what a run does in its end ---


@pytest.mark.parametrize("frequency", [2.0, 7.3, 40.0])
def test_a_sine_has_its_amplitude_and_frequency(frequency: float) -> None:
    found = oscillation(TIME, 0.5 + 0.2 * np.sin(2 * math.pi * frequency * TIME))
    assert found.amplitude == pytest.approx(0.2, rel=0.01)
    # The end is 2 s long, in which a crossing more or less is a quarter of a hertz.
    assert found.frequency == pytest.approx(frequency, abs=0.25)


def test_only_the_end_of_a_run_counts() -> None:
    early = np.where(TIME < 8, 5 * np.sin(50 * TIME), 0.1 * np.sin(2 * math.pi * 5 * TIME))
    found = oscillation(TIME, early)
    assert found.amplitude == pytest.approx(0.1, rel=0.01)
    assert found.frequency == pytest.approx(5, abs=0.25)
    assert chatter(TIME, np.where(TIME < 8, ALTERNATING, 0.0)) == pytest.approx(0, abs=0.02)


def test_a_ripple_on_a_swing_is_no_swing_of_its_own() -> None:
    swing = np.sin(2 * math.pi * 3 * TIME)
    found = oscillation(TIME, swing + 0.05 * np.sin(2 * math.pi * 211 * TIME))
    assert found.frequency == pytest.approx(3, abs=0.25)


def test_what_rests_or_creeps_or_swings_twice_is_no_cycle() -> None:
    assert oscillation(TIME, np.full(10_000, 0.3)) == Oscillation(0.0, None)
    creeping = oscillation(TIME, 0.1 * TIME)
    assert creeping.frequency is None
    # Half of the way in 2 s.
    assert creeping.amplitude == pytest.approx(0.1, rel=1e-3)
    assert oscillation(TIME, np.sin(2 * math.pi * TIME)).frequency is None


@pytest.mark.parametrize("size", [0.0, 0.3, 2.0])
def test_a_command_that_switches_at_every_sample_chatters_by_its_size(size: float) -> None:
    assert chatter(TIME, 4.0 + size * ALTERNATING) == pytest.approx(size, rel=1e-3)


def test_a_slow_command_does_not_chatter_and_hides_none() -> None:
    slow = np.sin(2 * math.pi * TIME)
    # Of a sine a mean over T misses (pi f T)^2/6, and 20 samples are half a one off the middle.
    assert chatter(TIME, slow) < 5e-3
    assert chatter(TIME, slow + 0.3 * ALTERNATING) == pytest.approx(0.3, rel=1e-3)


def test_a_square_wave_chatters_by_what_its_mean_over_20_ms_leaves() -> None:
    """Of one of 20 ms the mean is nothing; of one of a second all but its edges."""
    fast = np.sign(np.sin(2 * math.pi * 50 * (TIME + H / 2)))
    assert chatter(TIME, fast) == pytest.approx(1.0, rel=0.01)
    slow = np.sign(np.sin(2 * math.pi * (TIME + 0.25 + H / 2)))
    # Around an edge what is left falls from 1 to 0 within T/2 on both sides: T/3 of two a second.
    assert chatter(TIME, slow) == pytest.approx(math.sqrt(2 * 0.02 / 3), rel=0.05)


def test_of_several_inputs_the_one_that_chatters_most_counts() -> None:
    both = np.column_stack([0.1 * ALTERNATING, 0.7 * ALTERNATING, np.zeros(10_000)])
    assert chatter(TIME, both) == pytest.approx(0.7, rel=1e-3)


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
    assert (found["jitter"].title, found["motor"].title) == ("jitter*", "motor")
    assert "jitter (computing: jitter), missed samples" in assumed_text(
        {name: rung.assumed for name, rung in found.items()}
    )
    assert assumed_text({"motor": found["motor"].assumed}) == ""


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


def test_printed_equations_and_walls_are_rungs_where_there_are_some() -> None:
    assert rungs_of(machine("cart_pendulum"))[0][0].name == "printed"
    top = rungs_of(machine("two_link_arm"))[0][-1]
    assert top.name == "stops"
    assert Wall in kinds(top)


LOADED = """
[plant]
system = "servo"
[run]
duration = "20 ms"
[[controller]]
law = "lqr"
[[stop]]
joint = "shaft"
low = "-1 rad"
high = "1 rad"
[[swinging_load]]
body = "rotor"
mass = "10 g"
length = "10 cm"
[[swinging_load]]
body = "rotor"
mass = "20 g"
length = "10 cm"
[[sliding_load]]
body = "rotor"
mass = "10 g"
stiffness = "100 N/m"
[[transmission]]
joint = "shaft"
inertia = "0.01 kg m^2"
stiffness = "100 N m/rad"
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

LAW = StudiedLaw("lqr", None)  # pyright: ignore[reportArgumentType]
OTHER = StudiedLaw("pid", None)  # pyright: ignore[reportArgumentType]
NOMINAL = Condition("nominal", "the nominal plant", None)  # pyright: ignore[reportArgumentType]


def row(name: str, used: float, law: StudiedLaw = LAW, **changes: Any) -> Standing:
    plant: PlantName = "printed" if name == "printed" else "physics"
    made = Standing(law, Rung(name, plant), True, NOMINAL, used, "settles_within", {})
    return made._replace(**changes)


WAY = [
    row("printed", math.inf),
    row("physics", 0.3),
    row("sampled", 1.0),
    row("delay", 1.2),
    row("friction", 0.9),
    row("stops", math.inf),
]


def test_a_law_climbs_from_equations_that_are_true() -> None:
    """What the book has misprinted is no rung to fall from."""
    way = of_law([*WAY, row("physics", 9.0, OTHER), row("delay", 9.0, together=False)], "lqr",
                 "nominal")  # fmt: skip
    assert way == WAY[1:]
    assert first_failed(way) is WAY[3]
    assert first_failed(way[:2]) is None
    assert of_law(WAY, "lqr", "case1") == []


def test_all_of_a_limit_is_kept_and_more_is_not() -> None:
    assert row("a", 1.0).kept
    assert not row("a", 1.0001).kept
    assert not row("a", 0.0, impossible="no such law").kept


def test_shares_and_reasons_are_said_in_words() -> None:
    shown = [
        (row("a", 0.31), "0.31", "settles within: 0.31 times"),
        (row("a", 8.2), "8.2x", "settles within: 8.2 times"),
        (row("a", math.inf), "never", "settles within: never"),
        (row("a", math.inf, worst=measure.ENDED), "ended", measure.ENDED),
        (row("a", math.inf, impossible="there is no loop"), "-", "there is no loop"),
    ]
    for each, share, why in shown:
        assert (share_text(each), reason(each)) == (share, why)


def test_the_verdict_counts_what_breaks_most() -> None:
    rows = [
        *WAY,
        *(row(r.rung.name, r.used, OTHER) for r in WAY),
        *(row(r.rung.name, 0.5, StudiedLaw("stands", LAW.controller)) for r in WAY[1:]),
        row("physics", 0.5, StudiedLaw("slips", LAW.controller)),
        row("stops", 3.0, StudiedLaw("slips", LAW.controller)),
        row("delay", 3.0, StudiedLaw("recovers", LAW.controller)),
        row("stops", 0.9, StudiedLaw("recovers", LAW.controller)),
    ]
    whole = "laws keep everything on the whole machine"
    assert verdict(rows, "nominal") == (
        f"2 of 5 {whole}, 1 of them not on every rung below it; delay breaks 2, stops breaks 1."
    )
    assert verdict(rows[12:17], "nominal") == f"1 of 1 {whole}."
    # The last rung alone decides: what fails on the way and stands at the top is counted.
    assert verdict(rows[-2:], "nominal") == f"1 of 1 {whole}, 1 of them not on every rung below it."


def test_a_run_that_cannot_be_is_said_and_not_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    studied = ladder("servo", ["lqr"])

    def refused(*_: object) -> None:
        raise ArgumentError("there is no such law")

    monkeypatch.setattr(measure, "run_of", refused)
    found = standing(
        studied, studied.laws[0], studied.climbing[0], studied.conditions[0], together=True
    )
    assert found.impossible == "there is no such law"
    assert not found.kept
    assert (found.oscillation, found.chatter, found.shares) == (None, None, {})


# --- the chapter's claims ---

RISEN = [
    row("printed", 0.5, claims={"quick": 7.0}),
    row("physics", 0.5, claims={"quick": 0.2, "same": 1.0}),
    row("delay", 0.5, claims={"quick": 1.01, "same": 0.9}),
    row("friction", 0.5, claims={"quick": 0.5, "same": math.inf}),
    row("physics", 0.5, OTHER),
]


def test_a_claim_falls_on_the_first_rung_that_breaks_it() -> None:
    way = of_law(RISEN, "lqr", "nominal")
    assert judged_claims(way) == ["quick", "same"]
    assert fallen(way, "quick") is way[1]
    assert fallen(way, "same") is way[2]
    assert fallen(way[:1], "quick") is None
    assert [fall_text(way, claim) for claim in ("quick", "same", "another")] == [
        "delay", "friction", ""
    ]  # fmt: skip
    assert fall_text(way[:1], "same") == "stands"


def test_a_table_of_claims_has_the_laws_that_they_are_about() -> None:
    made = claims_table("falls", RISEN, "nominal")
    assert made is not None
    assert made.rows == [["lqr", "delay", "friction"]]
    assert claims_table("falls", WAY, "nominal") is None


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


DOCUMENT = {
    "configuration": {"target": "servo/machine", "title": "A step"},
    "output_unit": "rad",
    "laws": [{"name": "lqr", "follows_optimum": True}, {"name": "pid", "follows_optimum": False}],
    "climbing": [{"name": "physics", "assumed": ["computing: jitter"]}],
    "conditions": [{"name": "nominal", "title": "the nominal plant"}],
    "alone": [],
    "standings": [
        {
            "law": law,
            "rung": "physics",
            "together": True,
            "condition": "nominal",
            "share_of_the_tightest_limit": 0.5,
            "tightest": "deviation_below",
            "impossible": None,
            "deviation": 0.0123 if law == "lqr" else None,
        }
        for law in ("lqr", "pid")
    ],
    "claims": [{"claim": "quick", "statement": "It is quick"}],
    "fallen": [
        {"law": "lqr", "condition": "nominal", "claim": "quick", "rung": None},
        {"law": "lqr", "condition": "case1", "claim": "quick", "rung": "physics"},
    ],
}


def test_the_page_says_where_claims_fall_and_what_they_say() -> None:
    said = ladders_text([DOCUMENT])
    assert "| law | `quick` |\n|---|---|\n| lqr | stands |" in said
    assert said.endswith("`quick`: It is quick.")
    assert "falls" not in ladders_text([{**DOCUMENT, "fallen": []}])


def test_the_page_has_the_distance_from_the_optimum_of_the_laws_that_follow_it() -> None:
    said = ladders_text([DOCUMENT])
    (table,) = (part for part in said.split("\n\n") if part.startswith("| law | physics |"))
    assert table.splitlines()[2:] == ["| lqr | 12.3 |"]
    assert "Largest distance from the nominal optimum [mrad], of the laws that follow it:" in said
    assert "| law | physics* |" in said
    assert "\\* rests on numbers that are assumed: physics (computing: jitter)." in said


def test_the_page_has_the_whole_machine_under_each_condition() -> None:
    nominal = DOCUMENT["standings"]
    loaded = [{**row, "condition": "case1", "share_of_the_tightest_limit": 3.25} for row in nominal]
    conditions = [*DOCUMENT["conditions"], {"name": "case1", "title": "a load"}]
    said = ladders_text([{**DOCUMENT, "standings": nominal + loaded, "conditions": conditions}])
    (table,) = (part for part in said.split("\n\n") if part.startswith("| law | nominal | case1 |"))
    assert table.splitlines()[2:] == ["| lqr | 0.5 | 3.25x |", "| pid | 0.5 | 3.25x |"]
    assert "The whole machine, nominally and under load (case1: a load):" in said
    assert "under load" not in ladders_text([DOCUMENT])


# --- a real one ---


@cache
def climbed() -> list[Standing]:
    """LQR on the servo, rung by rung, and with friction alone."""
    studied = ladder("servo", ["lqr"])
    (law,), (nominal,) = studied.laws, studied.conditions
    ways = [(rung, True) for rung in studied.climbing]
    ways += [(rung, False) for rung in studied.alone if rung.name == "friction"]
    return [standing(studied, law, rung, nominal, together=at) for rung, at in ways]


@pytest.mark.slow
def test_lqr_climbs_a_servo_up_to_its_friction() -> None:
    way = of_law(climbed(), "lqr", "nominal")
    assert [each.rung.name for each in way[:4]] == ["corrected", "physics", "sampled", "sensors"]
    broken = first_failed(way)
    assert broken is not None
    assert broken.rung.name == "friction"
    assert broken.worst == "settles_within"
    # The chapter's 2 % of the step fall there, too, as they are said of both laws.
    at = fallen(way, "servo-before-load")
    assert at is broken
    assert judged_claims(way) == ["servo-before-load"]
    # It needs no other imperfection for that, and stops where friction holds the rest of K e.
    assert not climbed()[-1].kept
    assert not any(each.kept for each in way[way.index(broken) :])
    assert "friction breaks 1" in verdict(climbed(), "nominal")


@pytest.mark.slow
def test_physics_stands_as_the_equations_and_a_motor_as_its_amplifier() -> None:
    found = {each.rung.name: each for each in climbed() if each.together}
    assert found["physics"].used == pytest.approx(found["corrected"].used, rel=1e-3)
    # The model's damping has the back-EMF in it, and 24 V are enough: it changes nothing.
    motor, actuator = found["motor"], found["actuator"]
    assert motor.used == pytest.approx(actuator.used, rel=0.01)
    assert motor.chatter == pytest.approx(actuator.chatter, rel=0.01)
    assert motor.oscillation is not None
    assert actuator.oscillation is not None
    assert motor.oscillation.amplitude == pytest.approx(actuator.oscillation.amplitude, rel=0.01)
    for key, share in actuator.shares.items():
        assert motor.shares[key] == pytest.approx(share, rel=0.01)


@pytest.mark.slow
def test_encoders_make_an_input_chatter_that_friction_stills() -> None:
    found = {each.rung.name: each for each in climbed() if each.together}
    quiet, seen, stuck = (found[name].chatter for name in ("sampled", "sensors", "friction"))
    assert quiet is not None
    assert seen is not None
    assert stuck is not None
    assert seen > 1e3 * quiet
    assert stuck < 1e-6
    assert found["sensors"].oscillation is not None
    assert found["sensors"].oscillation.frequency is not None


# --- the command ---


def ran(*arguments: str) -> int:
    with pytest.raises(SystemExit) as stop:
        cli.main(["study", "ladder", *arguments])
    assert isinstance(stop.value.code, int)
    return stop.value.code


def stood(_: object, law: StudiedLaw, rung: Rung, condition: Condition, *, together: bool) -> Any:
    """A law that keeps everything up to the motor, and ends at the stops."""
    high = rung.name in ("friction", "backlash", "flexibility")
    used = math.inf if rung.name == "stops" else 3.25 if high else 0.5
    worst = measure.ENDED if rung.name == "stops" else "deviation_below"
    shares = {} if rung.name == "stops" else {"deviation_below": used}
    swing = None if rung.name == "stops" else Oscillation(0.01, 12.5 if high else None)
    claims = {"servo-before-load": used / 3} if law.name == "lqr" else {}
    return Standing(
        law, rung, together, condition, used, worst, shares, swing, 0.25, claims=claims
    )  # fmt: skip


def test_the_command_writes_what_it_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(measure, "standing", stood)
    assert ran("servo", "--laws", "lqr", "pid", "--out", str(tmp_path)) == cli.DONE
    said = capsys.readouterr().out
    assert "0 of 2 laws keep everything on the whole machine; friction breaks 2." in said
    assert "deviation below: 3.25 times" in said
    assert "ladder_servo_machine.json" in said
    found = json.loads((tmp_path / "ladder_servo_machine.json").read_text(encoding="utf-8"))
    assert found["complete"]
    assert found["configuration"]["target"] == "servo/machine"
    assert [law["name"] for law in found["laws"]] == ["lqr", "pid"]
    climbing, alone = rungs_of(machine("servo"))
    assert [rung["name"] for rung in found["climbing"]] == [rung.name for rung in climbing]
    assert len(found["standings"]) == 2 * (len(climbing) + len(alone))
    flexible = next(rung for rung in found["climbing"] if rung["name"] == "backlash")
    # What has no end is null in a document.
    assert [part["stiffness"] for part in flexible["parts"] if part["kind"] == "transmission"] == [
        None
    ]
    # A limit of three times the requirement's falls where 3.25 times that are used.
    assert "servo-before-load" in said
    assert found["fallen"] == [
        {
            "law": "lqr",
            "condition": "nominal",
            "claim": "servo-before-load",
            "rung": "friction",
        }
    ]
    stated = {each["claim"]: each["statement"] for each in found["claims"]}
    assert stated["servo-before-load"].startswith("Without disturbance both laws")
    assert found["standings"][0]["claims"] == {"servo-before-load": 0.5 / 3}
    last = next(s for s in found["standings"] if s["rung"] == "stops")
    assert last["share_of_the_tightest_limit"] is None
    assert (last["kept"], last["tightest"]) == (False, measure.ENDED)
    for suffix in ("png", "svg"):
        assert (tmp_path / f"ladder_servo_machine.{suffix}").stat().st_size > 1000


def test_what_was_climbed_before_an_interrupt_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(studied: Any, law: Any, rung: Rung, *rest: Any, **options: Any) -> Any:
        if rung.name == "delay":
            raise KeyboardInterrupt
        return stood(studied, law, rung, *rest, **options)

    monkeypatch.setattr(measure, "standing", interrupted)
    assert ran("servo", "--laws", "lqr", "--out", str(tmp_path)) == 130
    assert "ladder_servo_machine.json" in capsys.readouterr().out
    found = json.loads((tmp_path / "ladder_servo_machine.json").read_text(encoding="utf-8"))
    assert not found["complete"]
    assert [each["rung"] for each in found["standings"]] == [
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
        ((), "Missing from grosmc-mj study ladder: SYSTEM"),
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
[plant]
system = "servo"
[run]
duration = "20 ms"
[[controller]]
law = "lqr"
[[lugre]]
joint = "shaft"
coulomb = "0.05 N m"
[[requirement]]
deviation_below = "1 rad"
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
    found = standing(studied, law, studied.alone[0], condition, together=False)
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
    ],
)
@pytest.mark.parametrize("command", [["run"], ["study", "ladder"]], ids=" ".join)
def test_a_wrong_claim_is_told_in_one_line(
    command: list[str], old: str, new: str, said: str, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    file = written(tmp_path, CLAIMED.replace(old, new))
    with pytest.raises(SystemExit) as stop:
        cli.main([*command, str(file), "--out", str(tmp_path)])
    assert stop.value.code == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith(f"grosmc-mj: {file}: ")
    assert said in error
    assert "\n" not in error


def test_a_file_that_requires_nothing_has_nothing_to_break(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        '[plant]\nsystem = "servo"\n[run]\nduration = "20 ms"\n[[controller]]\nlaw = "lqr"\n'
        '[[lugre]]\njoint = "shaft"\ncoulomb = "0.05 N m"\n',
        encoding="utf-8",
    )
    assert ran(str(file), "--out", str(tmp_path)) == 2
    said = f"grosmc-mj: {file}: nothing is required: give it a [[requirement]]\n"
    assert capsys.readouterr().err == said
