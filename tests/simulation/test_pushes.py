"""Disturbances made by compiled code: bit by bit those of a table made in Python."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numba
import numpy as np
import pytest
from shipped import find_case

from grosmc_mj.control.controller import Controller
from grosmc_mj.control.memory import Memory
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation import native_engine
from grosmc_mj.simulation.disturbances import (
    Constant,
    Disturbance,
    Profile,
    Pulse,
    SineFrom,
    packed,
    push,
)
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory

PUSH = (0.2, 0.1, -0.3, 0.04, 0.05, 0.06)
OTHER = (-0.1, 0.0, 0.2, 0.0, -0.03, 0.0)
# Edges on instants, between them, and at k h that differs from the number by rounding.
PROFILES: tuple[Profile, ...] = (
    Constant(),
    Pulse(0.05, 0.08),
    Pulse(-math.inf, 0.0305),
    Pulse(3 * 0.1, math.inf),
    SineFrom(9.0, 0.05),
    SineFrom(-313.7, 0.0705, phase=2.0),
    SineFrom(1e15),
)
# Several on one body, and on several bodies; the wrenches on a body do not add up exactly.
LISTS = {
    "servo": [
        Disturbance("rotor", PUSH, SineFrom(9.0, 0.05)),
        Disturbance("rotor", OTHER, Pulse(0.1, 0.2)),
        Disturbance("rotor", PUSH, SineFrom(3.0, phase=0.3)),
    ],
    "cart_pendulum": [
        Disturbance("pole", PUSH, SineFrom(7.0)),
        Disturbance("cart", OTHER, Pulse(0.1, 0.2)),
        Disturbance("pole", OTHER),
    ],
    "arm": [
        Disturbance("link", PUSH, SineFrom(20.0, phase=0.3)),
        Disturbance("hub", OTHER, Pulse(0.05, 0.08)),
        Disturbance("link", OTHER, SineFrom(11.0, 0.13)),
    ],
}
FIELDS = ("state", "command", "input", "sliding", "weighed", "memory", "wrench", "physics")


@cache
def physics(system: str, integrator: Any = None) -> MujocoPlant:
    return MujocoPlant.load(system, integrator=integrator)


@cache
def grosmc(system: str) -> Controller:
    return chapter_controller("grosmc", physics(system).analytic())


def hidden(disturbances: Sequence[Disturbance]) -> list[Disturbance]:
    """The same ones by functions that compiled code does not know: a table is made of them."""

    def of(profile: Profile) -> Profile:
        return lambda t: profile(t)

    return [replace(each, profile=of(each.profile)) for each in disturbances]


def assert_equal(a: Trajectory, b: Trajectory) -> None:
    """Every bit of two trajectories."""
    for name in (*FIELDS, "status", "valid_until"):
        if getattr(a, name) is None and getattr(b, name) is None:
            continue
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def test_compiled_wrenches_are_those_of_the_profiles_bit_by_bit() -> None:
    """Python's sin and numba's are the same libm's; edges fall on the same instants."""
    own = Disturbance("link", OTHER, math.cos)
    items = [*(Disturbance("hub", PUSH, each) for each in PROFILES), own, *LISTS["arm"]]
    bodies, time = ("hub", "link"), np.arange(1000) * 1e-3
    pushes, values = packed(items, bodies, range(1000), 1e-3)
    assert values.shape == (1, 1000)

    @numba.njit
    def compiled(pushes: Any, values: Any, time: Any, found: Any) -> None:
        for i in range(len(time)):
            push(pushes, values, i, time[i], found[i])

    found, expected = np.ones((1000, 12)), np.ones((1000, 12))
    for i, t in enumerate(time.tolist()):
        push(pushes, values, i, t, expected[i])
    compiled(pushes, values, time, found)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("stride", [1, 3])
@pytest.mark.parametrize("integrator", ["RK4", "Euler", "implicitfast", "equations"])
@pytest.mark.parametrize("system", LISTS)
def test_compiled_pushes_give_the_bits_of_the_table_and_of_python(
    system: str, integrator: str, stride: int
) -> None:
    of_equations = integrator == "equations"
    options: dict[str, Any] = {
        "plant": physics(system).analytic() if of_equations else physics(system, integrator),
        "controller": grosmc(system),
        "x0": find_case(system, "nominal").x0,
        "duration": 0.25,
        "control_period": stride * 1e-3,
        "record": False,
    }
    pushed = simulate(**options, disturbances=LISTS[system])
    assert_equal(pushed, simulate(**options, disturbances=hidden(LISTS[system])))
    assert_equal(pushed, simulate(**options, disturbances=LISTS[system], engine="python"))
    recorded = simulate(**{**options, "record": True}, disturbances=LISTS[system])
    np.testing.assert_array_equal(pushed.state, recorded.state[[0, -1]])
    np.testing.assert_array_equal(pushed.memory[-1], recorded.memory[-1])


def test_runs_of_a_batch_have_their_own_numbers_and_as_many_as_they_like() -> None:
    """Among them none at all, and two integrators."""
    scales = [0.5, 1.0, 1.5, 2.0, 2.5]
    plants = [
        physics("cart_pendulum", ("RK4", "implicitfast")[i % 2]).edited(BodyEdit("pole", a, a))
        for i, a in enumerate(scales)
    ]

    def of(a: float) -> list[Disturbance]:
        first, second, _ = LISTS["cart_pendulum"]
        return [
            replace(first, profile=SineFrom(7 * a, 0.01 * a, a)),
            replace(second, profile=Pulse(0.01, 0.03 * a)),
            Disturbance("pole", (0.3 * a, 0, 0, 0, -0.1 * a, 0)),
        ]

    lists = [of(a)[: i % 4] for i, a in enumerate(scales)]
    assert sorted(map(len, lists)) == [0, 0, 1, 2, 3]
    options: dict[str, Any] = {
        "x0": find_case("cart_pendulum", "nominal").x0,
        "duration": 0.1,
        "record": False,
    }
    law = grosmc("cart_pendulum")
    together = simulate(plants, law, disturbances=lists, threads=2, **options)
    assert_equal(together, simulate(plants, law, disturbances=[*map(hidden, lists)], **options))
    for run, plant, items in zip(together.state, plants, lists, strict=True):
        alone = simulate(plant, law, disturbances=items, **options)
        np.testing.assert_array_equal(run, alone.state)


@pytest.mark.parametrize("record", [False, True])
def test_a_run_is_cut_into_pieces_without_a_seam(
    record: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where Python is asked for Ctrl-C, the held input and the wrench stay."""
    options: dict[str, Any] = {"duration": 0.25, "record": record, "control_period": 3e-3}
    options = {**options, "x0": [1.0, 0.0], "disturbances": LISTS["servo"]}
    whole = simulate(physics("servo"), grosmc("servo"), **options)
    monkeypatch.setattr(native_engine, "_FIRST", 2)
    monkeypatch.setattr(native_engine, "_PAUSE", 1e-5)
    assert_equal(whole, simulate(physics("servo"), grosmc("servo"), **options))


@pytest.mark.parametrize("engine", ["native", "python"])
def test_the_wrench_is_zero_outside_its_window(engine: Any) -> None:
    """MuJoCo keeps xfrc_applied until it is written again; the next run begins without."""
    pulse = Disturbance("rotor", (0, 0, 0, 0, 0.1, 0), Pulse(0.01, 0.02))
    still = Controller("none", metered, Gain(0.0), Meter)
    options: dict[str, Any] = {"duration": 0.03, "engine": engine, "threads": 1}
    run = simulate(physics("servo"), still, np.zeros((2, 2)), disturbances=[[pulse], []], **options)
    assert run.wrench is not None
    acts = np.flatnonzero(run.wrench[0, :, 4])
    np.testing.assert_array_equal(acts, np.arange(10, 20))
    speed = run.state[0, :, 1]
    assert speed[10] == 0 != speed[11]
    free = simulate(physics("servo"), still, run.state[0, 20], **{**options, "duration": 0.01})
    np.testing.assert_array_equal(run.state[0, 20:], free.state)
    assert not run.wrench[1].any()
    assert not run.state[1].any()


@dataclass(frozen=True)
class Gain:
    k: float


def pushing_away(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.v = p.k * x[0]
    return memory.v


@pytest.mark.parametrize("integrator", ["RK4", "implicitfast"])
def test_a_run_that_diverges_under_its_disturbance_has_its_step_and_cause(integrator: str) -> None:
    """At rest on the target it stays for ever; the pulse starts what then grows."""
    plant, pulse = physics("servo", integrator), Pulse(0.0501, 0.06)
    push = Disturbance("rotor", (0, 0, 0, 0, 0.1, 0), pulse)
    law = Controller("pushing away", pushing_away, Gain(1000.0))
    lists = [[push], [], [replace(push, profile=replace(pulse, start=0.04))]]
    options: dict[str, Any] = {"plant": plant, "controller": law, "x0": np.zeros((3, 2))}
    options = {**options, "duration": 0.5, "record": False}
    runs = [
        simulate(**options, disturbances=lists),
        simulate(**options, disturbances=lists, engine="python"),
        simulate(**options, disturbances=[*map(hidden, lists)]),
    ]
    assert list(runs[0].status) == [Status.DIVERGED, Status.COMPLETED, Status.DIVERGED]
    assert 0.1 < runs[0].valid_until[2] < runs[0].valid_until[0] < 0.4
    for other in runs[1:]:
        assert_equal(runs[0], other)


@pytest.mark.parametrize("record", [False, True])
def test_a_users_own_profile_is_asked_once_for_each_timestep(record: bool) -> None:
    """It may not answer twice alike."""
    asked: list[float] = []

    def profile(t: float) -> float:
        asked.append(t)
        return float(len(asked))

    own = [Disturbance("rotor", PUSH, profile), Disturbance("rotor", PUSH, Pulse(0.0, 0.01))]
    run = simulate(
        physics("servo"),
        grosmc("servo"),
        [1.0, 0.0],
        duration=0.02,
        disturbances=own,
        record=record,
    )
    assert asked == (np.arange(20) * 1e-3).tolist()
    assert run.wrench is not None
    np.testing.assert_array_equal(run.wrench[-1], 20.0 * np.array(PUSH))


class Louder(SineFrom):
    """A profile that is a known one by its class, but not by its values."""

    def __call__(self, t: float) -> float:
        return 2.0 * super().__call__(t)


def test_a_subclass_keeps_its_own_values() -> None:
    options: dict[str, Any] = {"duration": 0.02, "record": False, "x0": [1.0, 0.0]}
    runs = [
        simulate(
            physics("servo"),
            grosmc("servo"),
            disturbances=[Disturbance("rotor", (0, 0, 0, 0, 0.5, 0), Louder(40.0))],
            engine=engine,
            **options,
        )
        for engine in ("native", "python")
    ]
    assert_equal(*runs)


def test_a_known_profile_without_a_value_at_the_end_is_refused_before_the_run() -> None:
    """frequency t overflows from t = 10 ms on: known without asking for every instant."""
    never = [Disturbance("rotor", PUSH, SineFrom(1.7e308, phase=1.7e308))]
    options: dict[str, Any] = {"x0": [1.0, 0.0], "disturbances": never, "record": False}
    assert simulate(physics("servo"), grosmc("servo"), duration=0.05, **options).time[-1] == 0.05
    with pytest.raises(ArgumentError, match=r"on 'rotor' must take t \[s\] and return a number"):
        simulate(physics("servo"), grosmc("servo"), duration=0.2, **options)
    with pytest.raises(ArgumentError, match=r"unknown body 'rotr': did you mean 'rotor'"):
        prepare(
            physics("servo"),
            grosmc("servo"),
            [1.0, 0.0],
            duration=0.1,
            disturbances=[Disturbance("rotr", PUSH)],
            record=False,
        )


# What a law remembers


@dataclass
class Meter(Memory):
    """The largest angle, and two numbers more, of which one is an array."""

    largest: float = 0.0
    samples: float = 0.0
    last: Any = None

    def __post_init__(self) -> None:
        self.last = np.zeros(2)


def metered(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.largest = max(memory.largest, abs(x[0]))
    memory.samples += 1.0
    memory.last[0], memory.last[1] = x[0], t
    return p.k


@pytest.mark.parametrize("kind", ["physics", "analytic"])
@pytest.mark.parametrize("engine", ["native", "python"])
def test_memory_is_that_of_the_law_after_each_kept_sample(kind: str, engine: Any) -> None:
    plant = physics("servo") if kind == "physics" else physics("servo").analytic()
    law = Controller("metered", metered, Gain(0.3), Meter)
    options: dict[str, Any] = {"duration": 0.03, "control_period": 3e-3, "engine": engine}
    full = simulate(plant, law, [0.3, -9.0], **options)
    samples = np.arange(30) // 3
    np.testing.assert_array_equal(full.memory["samples"], samples + 1)
    np.testing.assert_array_equal(full.memory["last"][:, 0], full.state[3 * samples, 0])
    np.testing.assert_array_equal(full.memory["last"][:, 1], samples * 3e-3)
    seen = np.abs(full.state[:30:3, 0])
    np.testing.assert_array_equal(full.memory["largest"][::3], np.maximum.accumulate(seen))
    batch = simulate(plant, law, [[0.3, -9.0], [0.1, 0.0]], record=False, **options)
    assert batch.memory.shape == (2, 1)
    assert batch.memory[0, -1] == full.memory[-1] == batch[0].memory[-1]
    assert batch.memory["largest"][1, -1] == batch.memory["last"][1, -1, 0]


def test_memory_holds_no_address() -> None:
    """Or two runs of one robot would differ."""
    law = Controller("metered", metered, Gain(0.3), lambda: Meter(workspace=4711.0))
    run = simulate(physics("servo"), law, [0.0, 1.0], duration=0.01)
    np.testing.assert_array_equal(run.memory["workspace"], 0.0)
