"""Rungs of a ladder: one more part of a machine on each, and each part alone."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import pytest
from cases import case

from grosmc_mj import Experiment
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.ground.fields import checked
from grosmc_mj.mechanics.machine import Stop, Transmission
from grosmc_mj.simulation.loop import Computing, Loop
from grosmc_mj.studies.ladder.rungs import Rung, rungs_of

SYSTEMS = ["servo", "cart_pendulum", "arm", "two_link_arm"]
IDEAL = ["corrected", "physics", "sampled"]
LOOP = ["sensors", "delay", "jitter", "missed samples", "actuator"]
MACHINE = ["motor", "friction", "backlash", "flexibility", "stops"]


def machine(system: str) -> Experiment:
    return find_experiment(system, "machine")


def kinds(rungs: list[Rung]) -> list[str]:
    return [" ".join(part.kind for part in rung.parts) for rung in rungs]


def test_the_rungs_of_a_servo_add_one_part_at_a_time() -> None:
    climbing, alone = rungs_of(machine("servo"))
    assert [rung.name for rung in climbing] == IDEAL + LOOP + MACHINE
    assert [rung.name for rung in alone] == LOOP + MACHINE
    # Equations and physics are run at every timestep, all others at the control period.
    assert [rung.sampled for rung in climbing] == [False, False, *[True] * 11]
    assert [rung.plant for rung in climbing] == ["corrected", *["physics"] * 12]


def test_parts_of_the_machine_come_after_the_loop() -> None:
    climbing, alone = rungs_of(machine("servo"))
    assert [rung.looped for rung in climbing] == [*[False] * 3, *[True] * 10]
    assert [rung.looped for rung in alone] == [*[True] * 5, *[False] * 5]
    gear = "motor lugre transmission"
    assert kinds(climbing) == [*[""] * 8, "motor", "motor lugre", gear, gear, f"{gear} stop"]
    single = ["motor", "lugre", "transmission", "transmission", "stop"]
    assert kinds(alone) == [*[""] * 5, *single]


def test_a_rung_alone_has_its_part_of_the_loop_alone() -> None:
    climbing, alone = rungs_of(machine("servo"))
    loop = machine("servo").loop
    assert loop is not None
    bare = Loop(seed=loop.seed)
    computing = loop.computing
    assert [rung.loop for rung in alone[:5]] == [
        replace(bare, sensors=loop.sensors, estimators=loop.estimators),
        replace(bare, computing=Computing(delay=computing.delay)),
        replace(bare, computing=Computing(jitter=computing.jitter)),
        replace(bare, computing=Computing(missed=computing.missed)),
        replace(bare, actuators=loop.actuators),
    ]
    # Missed samples come on top of the delay.
    assert climbing[6].loop.computing == computing


def test_rungs_name_the_numbers_that_nobody_has_published() -> None:
    _, alone = rungs_of(machine("servo"))
    assert {rung.title: rung.assumed for rung in alone} == {
        "sensors": (),
        "delay*": ("computing: delay",),
        "jitter*": ("computing: jitter",),
        "missed samples*": ("computing: missed",),
        "actuator": (),
        "motor": (),
        "friction*": ("shaft: static, stiffness, damping, stribeck",),
        "backlash*": ("shaft: backlash, restitution, duration",),
        "flexibility*": ("shaft: stiffness, damping",),
        "stops*": ("shaft: low, high, restitution",),
    }


@pytest.mark.parametrize("system", SYSTEMS)
def test_the_top_is_the_machine_with_all_its_parts(system: str) -> None:
    made = machine(system)
    top = rungs_of(made)[0][-1]
    assert sorted(map(repr, top.parts)) == sorted(map(repr, made.parts))
    assert top.loop == made.loop
    assert ("wall" in kinds([top])[0]) == (system == "two_link_arm")


@pytest.mark.parametrize("system", SYSTEMS)
def test_teeth_come_before_the_shaft_gives_way(system: str) -> None:
    """And make room for it."""
    gears = {part for part in machine(system).parts if isinstance(part, Transmission)}
    rigid = {replace(gear, stiffness=math.inf) for gear in gears}
    climbing, alone = rungs_of(machine(system))
    for rung in (*climbing, *alone):
        transmissions = {part for part in rung.parts if isinstance(part, Transmission)}
        assert transmissions <= (rigid if rung.name == "backlash" else gears)


def test_misprinted_equations_are_the_first_rung() -> None:
    climbing, _ = rungs_of(machine("cart_pendulum"))
    assert climbing[0].name == "printed"


def test_walls_of_one_body_do_not_take_each_other_s_place() -> None:
    walls = [
        {"body": "rotor", "radius": f"{size} cm", "point": ["0 m", "0 m", f"-{size} m"]}
        for size in (1, 2)
    ]
    shaft = {"joint": "shaft"}
    walled = case(
        "servo",
        wall=walls,
        stop={**shaft, "low": "-1 rad", "high": "1 rad"},
        transmission={**shaft, "inertia": "0.01 kg m^2", "stiffness": "100 N m/rad"},
    )
    climbing, alone = rungs_of(walled)
    assert [rung.name for rung in alone] == ["flexibility", "stops"]
    assert kinds(climbing)[-1] == "transmission stop wall wall"


@checked()
class Bumper(Stop):
    """A stop of a kind that no ladder has heard of."""

    kind = "bumper"
    effect = ""


def test_a_part_of_a_new_kind_has_a_rung_of_its_own_above_all_others() -> None:
    made = machine("servo")
    (stop,) = [part for part in made.parts if isinstance(part, Stop)]
    bumper = Bumper(**{item.name: getattr(stop, item.name) for item in fields(stop)})
    others = [edit for edit in made.edits if edit is not stop]

    climbing, alone = rungs_of(made.changed(edits=(*others, bumper)))
    assert climbing[-1].name == alone[-1].name == "bumper"
    assert alone[-1].parts == (bumper,)
    assert "stops" not in [rung.name for rung in climbing]
