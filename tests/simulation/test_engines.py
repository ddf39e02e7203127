"""One law, two engines, one or many simulations: the same numbers, bit for bit."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from looped import applied, seen
from shipped import find_case

from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import linearized_lqr, tracking_grosmc
from grosmc_mj.control.memory import Memory
from grosmc_mj.control.references import FourierSeries, fourier_series
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.loop import Actuator, Computing, Estimator, Loop, Sensor, in_loop, relooped
from grosmc_mj.physics.edits import BodyEdit
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
each_kind = pytest.mark.parametrize("kind", ["equations", "RK4", "implicitfast"])
BATCHES = [("servo", "equations"), ("cart_pendulum", "RK4"), ("arm", "implicitfast")]


def assert_equal(a: Trajectory, b: Trajectory, fields: tuple[str, ...] = FIELDS) -> None:
    """Every bit of two trajectories: both engines use one libm in one order of operations."""
    for name in fields:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


# The two engines

H, PERIOD, STEPS = 1e-3, 2e-3, 50
CRANE = """<mujoco model="crane"><option timestep="0.001"/><worldbody>
<body name="mast"><joint name="turn" axis="0 0 1" damping="0.3" armature="0.2"/>
<geom type="box" size="0.1 0.2 0.05" mass="2" pos="0.05 0 0"/>
<body name="boom" pos="0.2 0 0" euler="0 10 20"><joint name="lift" axis="0 -1 0" stiffness="3"/>
<geom type="capsule" fromto="0.1 0 0 0.5 0 0.1" size="0.03" mass="1.5"/></body></body></worldbody>
<actuator><motor joint="turn"/><motor joint="lift"/></actuator></mujoco>"""
SYSTEMS = ("servo", "cart_pendulum", "arm", "two_link_arm", "crane")
INTEGRATORS = ("printed", "equations", "Euler", "implicit", "implicitfast", "RK4")
# A robot has no equations, and two systems have no other printed ones.
PLANTS = [
    (system, integrator)
    for system, integrator in itertools.product(SYSTEMS, INTEGRATORS)
    if (system, integrator) != ("crane", "equations")
    and (integrator != "printed" or system in ("cart_pendulum", "arm"))
]


@cache
def plant_of(system: str, integrator: Any) -> Plant:
    if system == "crane":
        return Robot.from_mjcf(CRANE, integrator=integrator).plant
    if system == "machine":
        return Experiment.load("servo/machine").plant("physics")
    if integrator in ("equations", "printed"):
        variant = "printed" if integrator == "printed" else "corrected"
        return MujocoPlant.load(system).analytic(variant)
    return MujocoPlant.load(system, timestep=H, integrator=integrator)


@cache
def law_of(system: str, law: str) -> Controller:
    if system != "crane":
        case = "servo/nominal" if system == "machine" else f"{system}/nominal"
        return Experiment.load(case).law("corrected", law)
    sine = np.array([[0.3], [0.2]])
    series = FourierSeries(2.0, np.array([0.1, 0.2]), np.zeros((2, 1)), sine)
    Q = np.kron(np.eye(2), np.diag([100.0, 0.0]))
    task = Robot.from_mjcf(CRANE).task(fourier_series(2, 1), series, Q, np.eye(2))
    return linearized_lqr(task, "lqr") if law == "lqr" else tracking_grosmc(task, 5.0, 2.0)


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
    periods: dict[str, Any] = {"control_period": PERIOD, "timestep": H}
    return in_loop(bare, parts, plant.system, predict=loop != "difference", **periods)


ESTIMATORS: dict[str, dict[str, Any]] = {
    "difference": {"law": "difference"},
    "filtered": {"law": "filtered", "time_constant": 3e-3},
    "levant": {"law": "levant", "slope": 40.0},
    "high-gain": {"law": "high-gain", "bandwidth": 150.0},
    "eso": {"law": "eso", "bandwidth": 150.0},
    "kalman": {"law": "kalman", "load": 1.0},
}
MATRIX = [
    *itertools.product([("machine", "own")], ("lqr", "grosmc"), ("ideal",)),
    *itertools.product(PLANTS, ("lqr", "grosmc"), ("ideal", "eso")),
    *((("servo", "equations"), "grosmc", kind) for kind in ESTIMATORS if kind != "eso"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("plant", "law", "loop"), MATRIX, ids=str)
def test_both_engines_agree_in_every_bit(plant: tuple[str, str], law: str, loop: str) -> None:
    where, ideal = plant_of(*plant), loop == "ideal"
    h = where.step_length or H
    start = 0.1 * (1.0 + np.arange(len(where.system.states)))
    push = Disturbance(where.system.bodies[-1], (0.3, 0, -0.2, 0, 0.1, 0), SineFrom(20.0, 0.01))
    native, python = (
        simulate(
            where,
            law_of(plant[0], law) if ideal else law_in_loop(*plant, law, loop),
            start,
            duration=STEPS * h,
            control_period=2 * h,
            timestep=h,
            disturbances=[push],
            engine=engine,
        )
        for engine in ENGINES
    )
    assert len(native.time) == STEPS + 1
    assert np.all(np.ptp(native.state, axis=0) > 0)
    assert_equal(native, python)
    # A loop is at work: neither the input nor the state that the law gets is the ideal one.
    assert ideal or np.abs(native.input - native.command).max() > 0.1
    assert ideal or not np.array_equal(seen(native), native.state[:-1])


# Batches

# An edited body of each system, its parameter in the equations, and what acts on it.
EDITED = {"servo": ("rotor", "J"), "cart_pendulum": ("pole", "m"), "arm": ("link", "m")}
WRENCHES = {
    "servo": [Disturbance("rotor", (0, 0, 0, 0, -0.7, 0), SineFrom(9.0, 0.05))],
    "cart_pendulum": [
        Disturbance("cart", (2.0, 0, 0, 0, 0, 0), Pulse(0.1, 0.2)),
        Disturbance("pole", (0.3, 0, -0.2, 0, 0.1, 0), SineFrom(7.0)),
    ],
    "arm": [Disturbance("link", (0.05, 0, -0.2, 0, 0.1, 0), SineFrom(20.0, phase=0.3))],
}


def batch(system: str, kind: str, count: int) -> dict[str, Any]:
    """Simulations that differ in plant, controller, start and number of disturbances."""
    body, name = EDITED[system]
    scales = (1 + 0.1 * np.arange(count)).tolist()
    plant: Any = plant_of(system, kind)
    law, plants = law_of(system, "grosmc"), []
    for scale in scales:
        if kind == "equations":
            scaled = {name: scale * getattr(plant.parameters, name)}
            plants.append(replace(plant, parameters=replace(plant.parameters, **scaled)))
        else:
            plants.append(plant.edited(BodyEdit(body, scale, scale)))
    numbers = [replace(law.parameters, K=scale * law.parameters.K) for scale in scales]
    x0 = np.array(find_case(system, "nominal").x0) + 0.01 * np.arange(count)[:, None]
    return {
        "plant": plants,
        "controller": [replace(law, parameters=p) for p in numbers],
        "x0": x0,
        "disturbances": [[WRENCHES[system][-1]] * k for k in range(count)],
    }


@each_engine
@pytest.mark.parametrize(("system", "kind"), BATCHES)
def test_a_batch_is_its_single_runs(system: str, kind: str, engine: Engine) -> None:
    runs = batch(system, kind, 3)
    options: dict[str, Any] = {"duration": 0.1, "control_period": 2e-3, "engine": engine}
    together = simulate(**runs, threads=2, **options)
    assert len(together) == 3
    for i in range(3):
        alone = simulate(**{name: items[i] for name, items in runs.items()}, **options)
        # A batch with any disturbance has a table for each run; a free run has none.
        assert_equal(together[i], alone, tuple(f for f in FIELDS if i or f != "wrench"))


def test_an_argument_that_stands_once_serves_every_run() -> None:
    runs = batch("servo", "RK4", 3)
    base = {name: items[1] for name, items in runs.items()}
    for name, items in runs.items():
        together = simulate(**{**base, name: items}, duration=0.05)
        for i, item in enumerate(items):
            alone = simulate(**{**base, name: item}, duration=0.05)
            assert_equal(together[i], alone, ("state", "command", "sliding"))


@pytest.mark.parametrize("kind", ["equations", "RK4"])
@pytest.mark.parametrize("threads", [1, 3])
def test_threads_do_not_matter(kind: str, threads: int) -> None:
    """64 simulations of four plants and numbers, in whatever order the threads take them."""
    four = batch("servo", kind, 4)
    runs: Any = {name: [item for _ in range(16) for item in items] for name, items in four.items()}
    expected = simulate(**runs, duration=0.1, engine="python")
    assert_equal(simulate(**runs, duration=0.1, threads=threads), expected)


def test_runs_on_several_threads_of_python_do_not_meet() -> None:
    cases: list[tuple[str, Engine]] = [(s, e) for s in EDITED for e in ENGINES] * 2

    def run(case: tuple[str, Engine]) -> Trajectory:
        system, engine = case
        x0 = find_case(system, "nominal").x0
        return simulate(plant_of(system, "RK4"), law_of(system, "grosmc"), x0, duration=0.2,
                        engine=engine)  # fmt: skip

    expected = [run(case) for case in cases]
    with ThreadPoolExecutor(len(cases)) as pool:
        for one, other in zip(pool.map(run, cases), expected, strict=True):
            assert_equal(one, other)


@each_engine
@pytest.mark.parametrize("kind", ["equations", "RK4"])
def test_without_recording_the_rows_are_the_first_and_the_last(kind: str, engine: Engine) -> None:
    runs = batch("cart_pendulum", kind, 2)
    options: dict[str, Any] = {"duration": 0.1, "control_period": 3e-3, "engine": engine}
    full, short = (simulate(**runs, record=record, **options) for record in (True, False))
    np.testing.assert_array_equal(short.time, [0.0, 0.1])
    for field in ("state", "physics", "command", "sliding", "weighed", "memory", "wrench"):
        rows, ends = getattr(full, field), getattr(short, field)
        if rows is not None:
            last = [0, -1] if field in ("state", "physics") else [-1]
            np.testing.assert_array_equal(ends, rows[:, last], err_msg=field)


@pytest.mark.parametrize("record", [False, True])
def test_a_run_is_cut_into_pieces_without_a_seam(
    record: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where Python looks for Ctrl-C, the held input and the wrench stay."""
    runs = batch("servo", "RK4", 2)
    options: dict[str, Any] = {"duration": 0.25, "record": record, "control_period": 3e-3}
    whole = simulate(**runs, **options)
    monkeypatch.setattr(native_engine, "_FIRST", 2)
    monkeypatch.setattr(native_engine, "_PAUSE", 1e-5)
    assert_equal(whole, simulate(**runs, **options))


@pytest.mark.parametrize(("system", "kind"), [("servo", "equations"), ("two_link_arm", "RK4")])
@pytest.mark.parametrize("stride", [1, 4])
def test_a_loop_without_parts_is_no_loop(system: str, kind: str, stride: int) -> None:
    plant, law, x0 = (
        plant_of(system, kind),
        law_of(system, "grosmc"),
        find_case(system, "nominal").x0,
    )
    periods: dict[str, Any] = {"control_period": stride * H, "timestep": H}
    bare, looped = (
        simulate(plant, one, x0, duration=0.1, **periods)
        for one in (law, in_loop(law, Loop(), plant.system, **periods))
    )
    assert_equal(bare, looped, tuple(name for name in FIELDS if name not in ("seen", "memory")))
    np.testing.assert_array_equal(seen(looped), bare.state[np.arange(100) // stride * stride])
    assert bare.seen is None


def test_a_looped_run_of_a_batch_is_that_run_alone() -> None:
    law = law_in_loop("servo", "equations", "grosmc", "eso")
    options: dict[str, Any] = {"duration": 0.05, "control_period": PERIOD, "timestep": H}
    laws = [relooped(law, applied(law).loop, run) for run in (4, 7, 4, 2**40)]
    together = simulate(plant_of("servo", "equations"), laws, [0.1, 0.2], threads=3, **options)
    for run, one in enumerate(laws):
        alone = simulate(plant_of("servo", "equations"), one, [0.1, 0.2], **options)
        assert_equal(together[run], alone)


# Sampling


@dataclass
class Samples(Memory):
    """Counts the calls of a law and keeps the state that it got."""

    calls: float = 0.0
    x: Any = None

    def __post_init__(self) -> None:
        self.x = np.zeros(2)


@dataclass(frozen=True)
class Nothing:
    nothing: float = 0.0


def sampling(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.calls += 1.0
    memory.x[0], memory.x[1] = x[0], x[1]
    return t


def seen_position(t: float, x: Any, memory: Any, p: Any) -> float:
    return 1.0


@each_engine
# 9 k timesteps of 1 ms and k periods of 9 ms differ in binary.
@pytest.mark.parametrize("stride", [1, 9])
@each_kind
def test_a_law_is_sampled_once_a_control_period_at_exactly_k_T(
    kind: str, stride: int, engine: Engine
) -> None:
    """In the state at that instant, not that of a stage of RK4."""
    law, T = Controller("sampling", sampling, Nothing(), Samples), stride * 1e-3
    run = simulate(plant_of("servo", kind), law, [0.3, 1.0], duration=0.5, control_period=T,
                   engine=engine)  # fmt: skip
    k = np.arange(500) // stride
    np.testing.assert_array_equal(run.memory["calls"], k + 1)
    np.testing.assert_array_equal(run.command, k * T)
    np.testing.assert_array_equal(run.memory["x"], run.state[k * stride])
    np.testing.assert_array_equal(run.time, np.arange(501) * 1e-3)


# Replay


@pytest.mark.parametrize(("system", "integrator"), [("arm", "RK4"), *BATCHES[1:]])
def test_a_run_is_a_plain_loop_of_mj_step(system: str, integrator: str) -> None:
    """With the plant's own model, as drawn, from the start on and from each recorded state."""
    body, _ = EDITED[system]
    plant: Any = plant_of(system, integrator)
    plant = plant.edited(BodyEdit(body, 1.5, 1.2))
    x0 = find_case(system, "nominal").x0
    options: dict[str, Any] = {"disturbances": WRENCHES[system], "control_period": 3e-3}
    run = simulate(plant, law_of(system, "grosmc"), x0, duration=0.3, **options)
    assert run.wrench is not None
    assert run.physics is not None
    model, n = plant.model, plant.system.degrees_of_freedom
    plain, replayed = mujoco.MjData(model), mujoco.MjData(model)
    plain.qpos[:], plain.qvel[:] = run.state[0, :n], run.state[0, n:]
    bodies = [model.body(name).id for name in plant.system.bodies]
    for i in range(300):
        mujoco.mj_setState(model, replayed, run.physics[i], mujoco.mjtState.mjSTATE_FULLPHYSICS)
        assert replayed.time == pytest.approx(run.time[i], rel=1e-12)  # MuJoCo adds up the steps
        for data in (plain, replayed):
            data.ctrl[0] = run.command[i]
            data.xfrc_applied[bodies] = run.wrench[i].reshape(-1, 6)
            mujoco.mj_step(model, data)
            np.testing.assert_array_equal(np.r_[data.qpos, data.qvel], run.state[i + 1])


# Errors of MuJoCo's, which end a process that calls it by its address


OUT_OF_MEMORY = """
import sys
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ModelError
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation.simulate import simulate
from test_engines import Nothing, seen_position

boxes = "".join(f"<geom type='box' size='.04 .04 .04' pos='{i / 10} 0 0'/>" for i in range(64))
plant = Robot.from_mjcf(
    "<mujoco><size memory='40k'/><worldbody><geom type='plane' size='9 9 1'/><body pos='0 0 .1'>"
    f"<joint name='fall' type='slide' axis='0 0 1'/>{boxes}</body></worldbody>"
    "<actuator><motor name='fall' joint='fall'/></actuator></mujoco>"
).plant
law = Controller("pushing", seen_position, Nothing())
options = {"engine": sys.argv[1], "threads": int(sys.argv[2])}
assert simulate(plant, law, [[0.0, 0.0], [1.0, 0.0]], duration=0.01, **options).state.any()
for _ in range(3):
    try:
        simulate(plant, law, [[0.0, 0.0], [1.0, 0.0]], duration=0.5, **options)
    except ModelError as error:
        print("said:", error)
print(simulate(plant, law, [1.0, 0.0], duration=0.01, **options).status.name)
"""


@pytest.mark.parametrize(("engine", "threads"), [("native", 1), ("native", 2), ("python", 1)])
def test_an_error_of_mujoco_s_is_one_of_the_model_and_ends_no_process(engine, threads):
    """A body that falls on the floor with more contacts than its memory holds."""
    command = [sys.executable, "-c", OUT_OF_MEMORY, engine, str(threads)]
    root, here = Path(__file__).resolve().parents[2], Path(__file__).resolve().parent
    path = os.pathsep.join(map(str, (root, here, here.parent)))
    ran = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stderr == ""
    *said, last = ran.stdout.splitlines()
    assert len(said) == 3
    assert all("said: MuJoCo cannot step the model: mj_stackAlloc" in each for each in said)
    assert last == "COMPLETED"


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("kind", ["equations", "RK4"])
def test_ctrl_c_ends_a_long_run(kind: str, threads: int) -> None:
    """Of minutes, after which the next run is as ever."""
    plant, law, starts = plant_of("servo", kind), law_of("servo", "lqr"), np.ones((2, 2))
    options: dict[str, Any] = {"record": False, "threads": threads}

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
