"""One law, two engines, one or many simulations: the same numbers, bit for bit."""

from __future__ import annotations

import itertools
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
from conftest import held
from looped import Noticed, seen
from mjcf import COMPLIANT, DELAY, LAG, ONE, SECOND, TREE, TWO
from shipped import find_case

from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import linearized_lqr, tracking_grosmc
from grosmc_mj.control.references import FourierSeries, fourier_series
from grosmc_mj.errors import ModelError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.loop import Actuator, Computing, Estimator, Loop, Sensor, in_loop
from grosmc_mj.physics.edits import AddedMass, BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import Plant
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation import native_engine
from grosmc_mj.simulation.disturbances import Disturbance, Pulse, SineFrom
from grosmc_mj.simulation.simulate import Engine, simulate
from grosmc_mj.simulation.trajectory import Trajectory

FIELDS = (
    "state", "command", "input", "sliding", "weighed", "memory", "seen", "wrench", "physics",
    "status", "valid_until",
)  # fmt: skip
ENGINES: tuple[Engine, Engine] = ("native", "python")
each_engine = pytest.mark.parametrize("engine", ENGINES)
H = 1e-3
ROBOTS = {"tree": TREE, "lag": ONE.format("", LAG), "delay": ONE.format("", DELAY),
          "coupled": TWO.format(SECOND, COMPLIANT)}  # fmt: skip
SHIPPED = ("servo", "cart_pendulum", "arm", "two_link_arm")


def assert_equal(a: Trajectory, b: Trajectory, fields: tuple[str, ...] = FIELDS) -> None:
    """Every bit of two trajectories: both engines use one libm in one order of operations."""
    for name in fields:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


# Plant, integrator, law and loop


@cache
def robot(system: str, integrator: Any = None) -> Robot:
    return Robot.from_mjcf(ROBOTS[system], integrator=integrator)


@cache
def plant_of(system: str, integrator: Any) -> Plant:
    if system in ROBOTS:
        plant = robot(system, integrator).built
        return plant.edited(AddedMass("tool", 0.5, (0.1, 0.0, 0.0))) if system == "tree" else plant
    if system == "machine":
        return Experiment.load("servo/machine").plant("physics")
    if integrator in ("corrected", "printed"):
        return MujocoPlant.load(system).analytic(integrator)
    return MujocoPlant.load(system, timestep=H, integrator=integrator)


@cache
def law_of(system: str, law: str = "grosmc") -> Controller:
    if system not in ROBOTS:
        case = "servo/nominal" if system == "machine" else f"{system}/nominal"
        return Experiment.load(case).law("corrected", law)
    n = robot(system).joints
    series = FourierSeries(2.0, np.full(n, 0.1), np.zeros((n, 1)), np.full((n, 1), 0.2))
    Q = np.kron(np.eye(n), np.diag([100.0, 0.0]))
    task = robot(system).task(fourier_series(n, 1), series, Q, np.eye(n))
    return linearized_lqr(task, "lqr") if law == "lqr" else tracking_grosmc(task, 5.0, 2.0)


ESTIMATORS: dict[str, dict[str, Any]] = {
    "difference": {"law": "difference"}, "filtered": {"law": "filtered", "time_constant": 3e-3},
    "levant": {"law": "levant", "slope": 40.0}, "high-gain": {"law": "high-gain", "bandwidth": 150},
    "eso": {"law": "eso", "bandwidth": 150.0}, "kalman": {"law": "kalman", "load": 1.0},
}  # fmt: skip


@cache
def law_in_loop(system: str, integrator: str, law: str, loop: str) -> Controller:
    """A law in a loop where every part does something, with an estimator of this kind."""
    plant, bare = plant_of(system, integrator), law_of(system, law)
    n = len(plant.system.states) // 2
    positions, rates = plant.system.states[:n], plant.system.states[n:]
    parts = Loop(
        Computing(delay=2 * H, jitter=H, missed=0.05),
        tuple(Sensor(x.name, 1e-5, noise=1e-5, bias=1e-5, delay=H) for x in positions),
        (Estimator(tuple(x.name for x in rates), **ESTIMATORS[loop], settled=loop != "levant"),),
        tuple(
            Actuator(u.name, H, 1e-3, limit=60.0, rate_limit=1e4, lag=1.5e-3, dead_zone=1e-3)
            for u in plant.system.inputs
        ),
        seed=1,
    )
    periods: dict[str, Any] = {"control_period": 2 * H, "timestep": H}
    return in_loop(bare, parts, plant.system, predict=loop != "difference", **periods)


MATRIX = [
    *itertools.product(itertools.product(SHIPPED, ("corrected", "implicitfast", "RK4")),
                       ["grosmc"], ("ideal", "eso")),
    *itertools.product([("cart_pendulum", "printed"), ("arm", "printed"), ("arm", "Euler"),
                        ("arm", "implicit"), ("machine", "own"), ("lag", "RK4"), ("delay", "RK4"),
                        ("coupled", None), ("tree", "RK4")], ["grosmc"], ["ideal"]),
    (("tree", "Euler"), "lqr", "ideal"),
    (("arm", "corrected"), "adaptive", "ideal"),
    (("tree", "implicitfast"), "grosmc", "eso"),
    *((("cart_pendulum", "RK4"), "lqr", loop) for loop in ("ideal", "eso")),
    (("two_link_arm", "corrected"), "pd", "ideal"),
    *((("servo", "corrected"), "grosmc", kind) for kind in ESTIMATORS if kind != "eso"),
    *((("cart_pendulum", "RK4"), law, "ideal") for law in ("cart-lqr", "cart-ism", "cart-pfl")),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("plant", "law", "loop"), MATRIX, ids=str)
def test_both_engines_agree_in_every_bit(plant: tuple[str, str], law: str, loop: str) -> None:
    where, ideal = plant_of(*plant), loop == "ideal"
    h = where.step_length or H
    start = 0.1 * (1.0 + np.arange(len(where.system.states)))
    push = Disturbance(where.system.bodies[-1], (0.3, 0, -0.2, 0, 0.1, 0), SineFrom(20.0, 0.01))
    control = law_of(plant[0], law) if ideal else law_in_loop(*plant, law, loop)
    native, python = (
        simulate(where, control, start, duration=50 * h, control_period=2 * h, timestep=h,
                 disturbances=[push], engine=engine)
        for engine in ENGINES
    )  # fmt: skip
    assert len(native.time) == 51
    assert np.all(np.ptp(native.state, axis=0) > 0)
    assert_equal(native, python)
    # A loop is at work: neither the input nor the state that the law gets is the ideal one.
    assert ideal or np.abs(native.input - native.command).max() > 0.1
    assert ideal or not np.array_equal(seen(native), native.state[:-1])


# Batches

# An edited body of each system, its parameter in the equations, and its pushes.
EDITED = {"servo": ("rotor", "J"), "cart_pendulum": ("pole", "m"), "arm": ("link", "m")}
PUSHES = {
    "servo": [("rotor", (0, 0, 0, 0, -0.7, 0), SineFrom(9.0, 0.05))],
    "cart_pendulum": [
        ("cart", (2.0, 0, 0, 0, 0, 0), Pulse(0.03, 0.06)),
        ("pole", (0.3, 0, -0.2, 0, 0.1, 0), SineFrom(7.0)),
        ("pole", (-0.1, 0, 0.2, 0, -0.03, 0), lambda t: t),
    ],
    "arm": [("link", (0.05, 0, -0.2, 0, 0.1, 0), SineFrom(20.0, phase=0.3))],
    "delay": [("link", (0.05, 0, -0.2, 0, 0.1, 0), Pulse(0.0, 0.05))],
}  # fmt: skip


def batch(system: str, kind: str, count: int = 4) -> dict[str, Any]:
    """Simulations that differ in plant, controller, start and number of disturbances."""
    scales, law, plant = 1 + 0.1 * np.arange(count), law_of(system), plant_of(system, kind)
    plants: list[Plant] = [plant] * count
    if system in EDITED:
        body, name = EDITED[system]
        plants = [
            plant.changed(scales={name: a}) if kind == "corrected"
            else plant.changed([BodyEdit(body, a, a)]) for a in scales.tolist()
        ]  # fmt: skip
    key = "k" if system in ROBOTS else "K"
    numbers = [replace(law.parameters, **{key: a * getattr(law.parameters, key)}) for a in scales]
    x0 = [0.1, 0.0] if system in ROBOTS else find_case(system, "nominal").x0
    pushes = [Disturbance(*push) for push in PUSHES[system]]
    return {
        "plant": plants,
        "controller": [replace(law, parameters=p) for p in numbers],
        "x0": np.array(x0) + 0.01 * np.arange(count)[:, None],
        "disturbances": [(pushes * count)[: count - 1 - k] for k in range(count)],
    }


@pytest.mark.parametrize(
    ("system", "kind"),
    [("servo", "corrected"), ("cart_pendulum", "RK4"), ("arm", "implicitfast"), ("delay", "RK4")],
)
def test_a_batch_is_its_single_runs_on_any_threads_in_either_engine(system: str, kind: str) -> None:
    runs = batch(system, kind)
    options: dict[str, Any] = {"duration": 0.1, "control_period": 2e-3}
    together = simulate(**runs, engine="python", **options)
    for i in range(4):
        alone = simulate(**{name: items[i] for name, items in runs.items()}, **options)
        # A batch with any disturbance has a table for each run; a free run has none.
        assert_equal(together[i], alone, tuple(f for f in FIELDS if i < 3 or f != "wrench"))
    # An argument that stands once serves every run.
    once = {name: items[1] for name, items in runs.items()}
    for name in ("plant", "controller", "x0", "disturbances"):
        alone = simulate(**{**once, name: runs[name][2]}, **options)
        shared = simulate(**{**once, name: runs[name]}, **options)
        assert_equal(shared[2], alone, ("state", "command", "sliding"))
    many: Any = {name: [item for _ in range(8) for item in items] for name, items in runs.items()}
    for threads in (1, 3):
        repeated = simulate(**many, threads=threads, **options)
        for name in FIELDS:
            rows = getattr(together, name)
            if rows is not None:
                expected = np.concatenate([rows] * 8)
                np.testing.assert_array_equal(getattr(repeated, name), expected, err_msg=name)


@each_engine
@pytest.mark.parametrize("kind", ["corrected", "RK4"])
def test_ends_are_those_of_the_record_and_pieces_have_no_seam(kind, engine, monkeypatch) -> None:
    """Where Python looks for Ctrl-C, the held input and the wrench stay."""
    runs = batch("cart_pendulum", kind, 2)
    options: dict[str, Any] = {"duration": 0.1, "control_period": 3e-3, "engine": engine}
    full, short = (simulate(**runs, record=record, **options) for record in (True, False))
    np.testing.assert_array_equal(short.time, [0.0, 0.1])
    for field in ("state", "physics", "command", "sliding", "weighed", "memory", "wrench"):
        rows, ends = getattr(full, field), getattr(short, field)
        if rows is not None:
            last = [0, -1] if field in ("state", "physics") else [-1]
            np.testing.assert_array_equal(ends, rows[:, last], err_msg=field)
    monkeypatch.setattr(native_engine, "_FIRST_STEPS", 2)
    monkeypatch.setattr(native_engine, "_PAUSE", 1e-5)
    for unbroken, record in ((full, True), (short, False)):
        assert_equal(unbroken, simulate(**runs, record=record, **options))


def test_runs_on_several_threads_of_python_do_not_meet() -> None:
    def run(case: tuple[str, Engine]) -> Trajectory:
        x0 = find_case(case[0], "nominal").x0
        return simulate(plant_of(case[0], "RK4"), law_of(case[0]), x0, duration=0.1, engine=case[1])

    cases: list[tuple[str, Engine]] = [(s, e) for s in EDITED for e in ENGINES] * 2
    with ThreadPoolExecutor(len(cases)) as pool:
        for one, case in zip(pool.map(run, cases), cases, strict=True):
            assert_equal(one, run(case))


@pytest.mark.parametrize(("system", "kind"), [("servo", "corrected"), ("two_link_arm", "RK4")])
def test_a_loop_without_parts_is_no_loop(system: str, kind: str) -> None:
    plant, law, x0 = plant_of(system, kind), law_of(system), find_case(system, "nominal").x0
    periods: dict[str, Any] = {"control_period": 4 * H, "timestep": H}
    bare, looped = (
        simulate(plant, one, x0, duration=0.1, **periods)
        for one in (law, in_loop(law, Loop(), plant.system, **periods))
    )
    assert_equal(bare, looped, tuple(name for name in FIELDS if name not in ("seen", "memory")))
    np.testing.assert_array_equal(seen(looped), bare.state[np.arange(100) // 4 * 4])
    assert bare.seen is None


# Sampling and replay


def sampling(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.samples += 1.0
    memory.x[0], memory.x[1] = x[0], x[1]
    return t


@each_engine
@pytest.mark.parametrize("kind", ["corrected", "RK4"])
def test_a_law_is_sampled_once_a_control_period_at_exactly_k_T(kind: str, engine: Engine) -> None:
    """In the state at that instant, not that of a stage of RK4.

    9 k timesteps of 1 ms and k periods of 9 ms differ in binary.
    """
    law = replace(held(0.0), law=sampling, memory=Noticed)
    run = simulate(plant_of("servo", kind), law, [0.3, 1.0], duration=0.2, control_period=9e-3,
                   engine=engine)  # fmt: skip
    k = np.arange(200) // 9
    np.testing.assert_array_equal(run.memory["samples"], k + 1)
    np.testing.assert_array_equal(run.command, k * 9e-3)
    np.testing.assert_array_equal(run.memory["x"], run.state[k * 9])
    np.testing.assert_array_equal(run.time, np.arange(201) * 1e-3)


@pytest.mark.parametrize(
    ("system", "integrator"), [("cart_pendulum", "RK4"), ("arm", "implicitfast")]
)
def test_a_run_is_a_plain_loop_of_mj_step(system: str, integrator: str) -> None:
    """With the plant's own model, as drawn, from the start on and from each recorded state."""
    one: dict[str, Any] = {name: items[0] for name, items in batch(system, integrator).items()}
    plant = plant_of(system, integrator).changed([BodyEdit(EDITED[system][0], 1.5, 1.2),
                                                  AddedMass(EDITED[system][0], 0.1)])  # fmt: skip
    run = simulate(**{**one, "plant": plant}, duration=0.1, control_period=3e-3)
    assert run.physics is not None
    assert run.wrench is not None
    model, n = plant.model, plant.system.degrees_of_freedom
    plain, replayed = mujoco.MjData(model), mujoco.MjData(model)
    plain.qpos[:], plain.qvel[:] = run.state[0, :n], run.state[0, n:]
    bodies = [model.body(name).id for name in plant.system.bodies]
    for i in range(100):
        mujoco.mj_setState(model, replayed, run.physics[i], mujoco.mjtState.mjSTATE_FULLPHYSICS)
        assert replayed.time == pytest.approx(run.time[i], rel=1e-12)  # MuJoCo adds up the steps
        for data in (plain, replayed):
            data.ctrl[:] = run.command[i]
            data.xfrc_applied[bodies] = run.wrench[i].reshape(-1, 6)
            mujoco.mj_step(model, data)
            np.testing.assert_array_equal(np.r_[data.qpos, data.qvel], run.state[i + 1])
        assert run.physics[i + 1, 0] == plain.time


# Errors of MuJoCo's, which end a process that calls it by its address, and Ctrl-C


@pytest.mark.parametrize(("engine", "threads"), [("native", 2), ("python", 1)])
def test_an_error_of_mujoco_s_is_one_of_the_model_and_ends_no_process(
    engine: Engine, threads: int, capfd: pytest.CaptureFixture[str]
) -> None:
    """A body that falls on the floor with more contacts than its memory holds."""
    boxes = "".join(f"<geom type='box' size='.04 .04 .04' pos='{i / 10} 0 0'/>" for i in range(64))
    plant = Robot.from_mjcf(
        "<mujoco><size memory='40k'/><worldbody><geom type='plane' size='9 9 1'/><body pos='0 0 "
        f".1'><joint name='fall' type='slide' axis='0 0 1'/>{boxes}</body></worldbody>"
        "<actuator><motor name='fall' joint='fall'/></actuator></mujoco>"
    ).plant
    two, options = [[0.0, 0.0], [1.0, 0.0]], {"engine": engine, "threads": threads}
    for _ in range(2):
        with pytest.raises(ModelError, match="MuJoCo cannot step the model: mj_stackAlloc"):
            simulate(plant, held(1.0), two, duration=0.5, **options)
    after = simulate(plant, held(1.0), two, duration=0.01, **options)
    assert after.valid_until.tolist() == [0.01, 0.01]
    assert capfd.readouterr().err == ""


def test_ctrl_c_ends_a_long_run() -> None:
    """Of minutes, after which the next run is as ever."""
    plant, law, starts = plant_of("servo", "RK4"), law_of("servo", "lqr"), np.ones((2, 2))
    options: dict[str, Any] = {"record": False, "threads": 2}

    def press(*_: Any) -> None:
        raise KeyboardInterrupt

    before = simulate(plant, law, starts, duration=0.1, **options)
    was = signal.signal(signal.SIGALRM, press)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.5)
        began = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            simulate(plant, law, starts, duration=90_000.0, **options)
        # 0.2 s, and a busy machine.
        assert time.monotonic() - began < 5
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, was)
    assert_equal(simulate(plant, law, starts, duration=0.1, **options), before)
