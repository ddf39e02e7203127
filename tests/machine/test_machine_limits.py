"""A machine's parts at their extremes, together, and in both engines."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from machined import stepped

from grosmc_mj.errors import ArgumentError, ModelError
from grosmc_mj.experiments.catalogue import chapter_controller, find_experiment
from grosmc_mj.machine import LuGre, MachinePart, Motor, Stop, SwingingLoad, Transmission, Wall
from grosmc_mj.physics.edit import Edit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.simulate import simulate


def test_a_part_of_the_models_inertia_is_taken_off_it() -> None:
    nominal = MujocoPlant.load("servo", timestep=1e-5)
    taken = Transmission("shaft", inertia=0.05, stiffness=1e5, damping=40.0, added=False)
    plant = nominal.edited(taken)
    soft, rigid = (
        stepped(one, 0.25, lambda d: d.qpos[0], lambda t: math.sin(20 * t))
        for one in (plant, nominal)
    )
    assert np.abs(soft - rigid).max() < 3e-4
    for same in (plant, plant.rigid):
        assert same.analytic().parameters == nominal.analytic().parameters


def test_hidden_states_are_named_with_their_unit() -> None:
    parts = (
        Transmission("slider", inertia=0.05, stiffness=1e4, damping=20.0),
        LuGre("slider", 1.0, stiffness=1e3),
        SwingingLoad("cart", 0.1, 0.2),
    )
    plant = MujocoPlant.load("cart_pendulum", edits=parts)
    units = {state.name: state.unit for state in plant.hidden_states}
    assert units == {"cart swing": "rad", "slider twist": "m", "slider friction bristle": "m"}
    law = find_experiment("cart_pendulum", "nominal").law("physics", "lqr")
    run = simulate(plant, law, [0, 0.1, 0, 0], duration=0.05, control_period=1e-3)
    assert run.physics is not None
    (state,) = (state for state in plant.hidden_states if state.name == "slider twist")
    twist = state.of(run.physics)
    assert twist[0] == 0
    assert 0 < np.abs(twist).max() < 1e-2
    assert run.state.shape[1] == 4
    assert run.physics[0, 1:4].tolist() == [0.0, 0.1, 0.0]  # the motor begins with its joint
    # A plant with states of its own has no derivative, but its rigid one has.
    with pytest.raises(ModelError, match=r"states that x does not tell \(cart swing, slider twist"):
        plant.derivative([0.0] * 4)
    with pytest.raises(ModelError, match=r"ask its \.rigid plant"):
        plant.linearization()
    rigid = plant.rigid.derivative([0.0, 1.0, 0.0, 0.0], 1.0)
    assert rigid == pytest.approx(plant.analytic().derivative([0.0, 1.0, 0.0, 0.0], 1.0))


def model(*edits: Edit, name: str = "servo", integrator: Any = "RK4", h: float = 1e-3) -> Any:
    return MujocoPlant.load(name, edits=edits, integrator=integrator, timestep=h).model


BRISTLES = LuGre("shaft", 0.05, 0.07, damping=3.0)
wrong: Any = partial


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (wrong(model, Transmission("shfat", 0.1, 1e3)), r"unknown joint 'shfat'.*did you mean"),
        (wrong(model, LuGre("shaft", 0.1), LuGre("shaft", 0.2)), "two of the kind 'lugre'"),
        (wrong(model, Transmission("hinge", 0.1, 1e3), name="cart_pendulum"),
         "no input drives joint 'hinge'"),
        (wrong(model, Motor("currant", 0.1, 1.0)), "unknown input 'currant'"),
        (wrong(model, Transmission("shaft", 1e-4, 1e4)), r"at most 0\.00\d+ s, or make it softer"),
        (wrong(model, Motor("current", 0.1, 1.0, inductance=1e-5)), "another integrator, or leave"),
        (wrong(model, Motor("current", 0.1, 1.0, added=False)), "let them be added"),
        (wrong(model, Transmission("shaft", inertia=0.06, stiffness=1e5, added=False)),
         r"0\.06 is no part .* armature of 0 .* 0\.0577: give less"),
        (wrong(model, BRISTLES, integrator="implicitfast"), r"= 1\.05: take integrator RK4"),
        # A part's own numbers.
        (wrong(Transmission, "j", 0.1), "it is rigid: give a stiffness, a backlash or both"),
        (wrong(LuGre, "j", 0.2, 0.1), r"static = 0\.1 must be at least coulomb = 0\.2"),
        (wrong(Stop, "j", 1.0, -1.0), "low = 1 must be below high = -1"),
        (wrong(Motor, "i", 0.1, 1.0, ratio=0.0), "ratio = 0 must be at least 1e-15, or negative"),
        (wrong(Motor, "i", 0.1, 1.0, thermal_resistance=1.0), "heating needs both"),
        (wrong(Wall, "b", 0.1, normal=(0, 0, 0)), "must point somewhere"),
        (wrong(Wall, "b", 0.1, at=(0, 0)), "3 finite numbers"),
    ],
)  # fmt: skip
def test_an_impossible_part_is_refused_in_one_line(make: Any, words: str) -> None:
    with pytest.raises(ModelError, match=words) as refused:
        make()
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "part",
    [
        Transmission("shaft", 0.05, backlash=0.1),
        Stop("shaft", -1.0, 0.5, duration=0.01),
        Wall("rotor", 0.02, point=(0, 0, 0), duration=0.01),
    ],
)
def test_no_integrator_makes_the_damping_of_a_constraint_implicit(part: MachinePart) -> None:
    with pytest.raises(ModelError, match=r"0\.001 s makes unstable: take at most (.*) s,") as info:
        model(part, integrator="implicitfast")
    longest = float(str(info.value).split("at most ")[1].split()[0])
    assert model(part, integrator="implicitfast", h=longest)
    assert model(BRISTLES, integrator="Euler")


@pytest.mark.parametrize("starts", [0.0, [-2.1, -1.5]])
def test_a_start_beyond_a_stop_is_refused(starts: Any) -> None:
    """MuJoCo would throw the rotor back by a force without bound: no run tells of that plant."""
    plant = MujocoPlant.load("servo", edits=(Stop("shaft", -2.0, -1.0),))
    law = chapter_controller("lqr", plant.analytic())
    x0 = np.stack([starts, np.zeros_like(starts)], axis=-1)
    with pytest.raises(ArgumentError, match="beyond its stops at -2 and -1 rad"):
        simulate(plant, law, x0, duration=0.01)


def test_batches_of_machines_are_their_single_runs() -> None:
    law = find_experiment("servo", "nominal").law("physics", "grosmc")
    plants = [
        MujocoPlant.load(
            "servo",
            edits=(
                Transmission("shaft", inertia=0.01, stiffness=k, damping=1.0, backlash=1e-3),
                LuGre("shaft", 0.05),
            ),
        )
        for k in (300.0, 500.0)
    ]
    starts = [[0.0, 0.0], [0.1, -0.2]]
    both = simulate(plants, law, starts, duration=0.2, control_period=1e-3)
    assert both.physics is not None
    for i, (plant, x0) in enumerate(zip(plants, starts, strict=True)):
        alone = simulate(plant, law, x0, duration=0.2, control_period=1e-3)
        assert alone.physics is not None
        assert np.array_equal(alone.physics, both.physics[i])
        # The motor begins with its joint.
        assert alone.physics[0].tolist() == [0.0, x0[0], x0[0], x0[1], x0[1], 0.0]
    ended = simulate(plants, law, starts, duration=0.2, control_period=1e-3, record=False)
    assert ended.physics is not None
    assert np.array_equal(ended.physics[:, -1], both.physics[:, -1])
