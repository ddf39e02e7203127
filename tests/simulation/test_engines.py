"""One law, two engines, one or many simulations: the same numbers, bit for bit."""

from __future__ import annotations

import itertools
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest
from looped import Noticed, seen
from mjcf import COMPLIANT, CROWDED, DELAY, LAG, ONE, SECOND, TREE, TWO
from open_loop import held
from shipped import find_case

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.mechanics.physics.edits import AddedMass, BodyEdit
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.simulation import native_engine
from grosmc_mj.simulation.disturbances import Disturbance, Pulse, SineFrom
from grosmc_mj.simulation.loop import (
    Actuator,
    AppliedLoop,
    Computing,
    Estimator,
    Loop,
    Sensor,
    apply_loop,
)
from grosmc_mj.simulation.simulate import Engine, simulate
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.design import linearized_lqr, tracking_grosmc
from grosmc_mj.theory.control.references import FourierSeries, fourier_series
from grosmc_mj.theory.plants import Plant

FIELDS = (
    "state",
    "command",
    "input",
    "sliding",
    "weighed",
    "memory",
    "seen",
    "wrench",
    "physics",
    "status",
    "valid_until",
)
ENGINES: tuple[Engine, Engine] = ("native", "python")
each_engine = pytest.mark.parametrize("engine", ENGINES)
H = 1e-3
ROBOTS = {
    "tree": TREE,
    "lag": ONE.format("", LAG),
    "delay": ONE.format("", DELAY),
    "coupled": TWO.format(SECOND, COMPLIANT),
}
SHIPPED = ("servo", "cart_pendulum", "arm", "two_link_arm")


def assert_equal(a: Trajectory, b: Trajectory, fields: Sequence[str] = FIELDS) -> None:
    """Every bit of two trajectories: both engines use one libm in one order of operations."""
    for name in fields:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


# Plant, integrator, law and loop


@cache
def robot(system: str, integrator: Any = None) -> Robot:
    return Robot.from_mjcf(ROBOTS[system], integrator=integrator)


@cache
def plant_of(system: str, integrator: Any) -> Plant:
    if system == "tree":
        tool = AddedMass("tool", 0.5, (0.1, 0.0, 0.0))
        return robot(system, integrator).built.changed(tool)
    if system in ROBOTS:
        return robot(system, integrator).built
    if system == "machine":
        return Experiment.load("servo/machine").plant("physics")
    if integrator in ("corrected", "printed"):
        return MujocoPlant.load(system).analytic(integrator)
    return MujocoPlant.load(system, timestep=H, integrator=integrator)


@cache
def law_of(system: str, law: str = "grosmc") -> Controller:
    if system in ROBOTS:
        return law_of_robot(system, law)
    if system == "machine":
        return Experiment.load("servo/nominal").law("corrected", law)
    return Experiment.load(f"{system}/nominal").law("corrected", law)


def law_of_robot(system: str, law: str) -> Controller:
    n = robot(system).joints
    series = FourierSeries(
        2.0,
        np.full(n, 0.1),
        np.zeros((n, 1)),
        np.full((n, 1), 0.2),
    )
    Q = np.kron(np.eye(n), np.diag([100.0, 0.0]))
    task = robot(system).task(fourier_series(n, 1), series, Q, np.eye(n))
    if law == "lqr":
        return linearized_lqr(task, "lqr")
    return tracking_grosmc(task, 5.0, 2.0)


ESTIMATORS: dict[str, dict[str, Any]] = {
    "difference": {"law": "difference"},
    "filtered": {"law": "filtered", "time_constant": 3e-3},
    "eso": {"law": "eso", "bandwidth": 150.0},
    "kalman": {"law": "kalman", "load": 1.0},
}


@cache
def loop_around(system: str, integrator: str, law: str, estimator: str) -> AppliedLoop:
    """A loop where every part does something, with an estimator of this kind."""
    plant = plant_of(system, integrator)
    n = len(plant.system.states) // 2
    positions = [state.name for state in plant.system.states[:n]]
    rates = tuple(state.name for state in plant.system.states[n:])

    sensors = [Sensor(name, 1e-5, noise=1e-5, bias=1e-5, delay=H) for name in positions]
    actuators = [
        Actuator(
            u.name,
            delay=H,
            resolution=1e-3,
            limit=60.0,
            rate_limit=1e4,
            lag=1.5e-3,
            dead_zone=1e-3,
        )
        for u in plant.system.inputs
    ]
    loop = Loop(
        Computing(delay=2 * H, jitter=H, missed=0.05),
        tuple(sensors),
        (Estimator(rates, **ESTIMATORS[estimator]),),
        tuple(actuators),
        seed=1,
    )
    return apply_loop(
        loop,
        law_of(system, law),
        plant.system,
        predict=estimator != "difference",
        control_period=2 * H,
        timestep=H,
    )


# Plant, integrator and law, without a loop.
IDEAL = [
    ("servo", "RK4", "grosmc"),
    ("two_link_arm", "implicitfast", "grosmc"),
    ("cart_pendulum", "printed", "grosmc"),
    ("arm", "printed", "grosmc"),
    ("arm", "Euler", "grosmc"),
    ("arm", "implicit", "grosmc"),
    ("machine", "own", "grosmc"),
    ("lag", "RK4", "grosmc"),
    ("delay", "RK4", "grosmc"),
    ("coupled", None, "grosmc"),
    ("tree", "RK4", "grosmc"),
    ("tree", "Euler", "lqr"),
    ("arm", "corrected", "adaptive"),
    ("cart_pendulum", "RK4", "lqr"),
    ("two_link_arm", "corrected", "pd"),
    ("cart_pendulum", "RK4", "cart-lqr"),
    ("cart_pendulum", "RK4", "cart-ism"),
    ("cart_pendulum", "RK4", "cart-pfl"),
]
# Plant, integrator, law and estimator, in a loop.
LOOPED = [
    *itertools.product(SHIPPED, ("corrected", "RK4"), ["grosmc"], ["eso"]),
    ("tree", "implicitfast", "grosmc", "eso"),
    ("cart_pendulum", "RK4", "lqr", "eso"),
    ("servo", "corrected", "grosmc", "difference"),
    ("servo", "corrected", "grosmc", "filtered"),
    ("servo", "corrected", "grosmc", "kalman"),
]


def run_where_engines_agree(
    plant: Plant, law: Controller, loop: AppliedLoop | None = None
) -> Trajectory:
    """A run of 50 steps under a disturbance, which is the same in both engines."""
    h = plant.step_length or H
    start = 0.1 * (1.0 + np.arange(len(plant.system.states)))
    wrench = (0.3, 0, -0.2, 0, 0.1, 0)
    options: dict[str, Any] = {
        "duration": 50 * h,
        "loop": loop,
        "control_period": 2 * h,
        "timestep": h,
        "disturbances": [Disturbance(plant.system.bodies[-1], wrench, SineFrom(20.0, 0.01))],
    }
    native = simulate(plant, law, start, engine="native", **options)
    python = simulate(plant, law, start, engine="python", **options)
    assert_equal(native, python)

    assert len(native.time) == 51
    assert np.all(np.ptp(native.state, axis=0) > 0)
    return native


@pytest.mark.slow
@pytest.mark.parametrize(("system", "integrator", "law"), IDEAL)
def test_both_engines_agree_in_every_bit(system: str, integrator: str, law: str) -> None:
    run_where_engines_agree(plant_of(system, integrator), law_of(system, law))


@pytest.mark.slow
@pytest.mark.parametrize(("system", "integrator", "law", "estimator"), LOOPED)
def test_both_engines_agree_in_every_bit_of_a_loop(
    system: str, integrator: str, law: str, estimator: str
) -> None:
    loop = loop_around(system, integrator, law, estimator)
    run = run_where_engines_agree(plant_of(system, integrator), loop.controller, loop)
    # The loop is at work: neither the input nor the state that the law gets is the ideal one.
    assert np.abs(run.input - run.command).max() > 0.1
    assert not np.array_equal(seen(run), run.state[:-1])


# Batches

# An edited body of each system, its parameter in the equations, and its disturbances.
EDITED = {"servo": ("rotor", "J"), "cart_pendulum": ("pole", "m"), "arm": ("link", "m")}
DISTURBANCES = {
    "servo": [Disturbance("rotor", (0, 0, 0, 0, -0.7, 0), SineFrom(9.0, 0.05))],
    "cart_pendulum": [
        Disturbance("cart", (2.0, 0, 0, 0, 0, 0), Pulse(0.03, 0.06)),
        Disturbance("pole", (0.3, 0, -0.2, 0, 0.1, 0), SineFrom(7.0)),
        Disturbance("pole", (-0.1, 0, 0.2, 0, -0.03, 0), lambda t: t),
    ],
    "arm": [Disturbance("link", (0.05, 0, -0.2, 0, 0.1, 0), SineFrom(20.0, phase=0.3))],
    "delay": [Disturbance("link", (0.05, 0, -0.2, 0, 0.1, 0), Pulse(0.0, 0.05))],
}
EACH_4: dict[str, Any] = {"duration": 0.1, "control_period": 2e-3}


def scaled_plant(system: str, kind: str, scale: float) -> Plant:
    plant = plant_of(system, kind)
    if system not in EDITED:
        return plant
    body, parameter = EDITED[system]
    if kind == "corrected":
        return plant.changed(scales={parameter: scale})
    return plant.changed(BodyEdit(body, scale, scale))


def scaled_law(system: str, scale: float) -> Controller:
    law = law_of(system)
    gain = "k" if system in ROBOTS else "K"
    scaled = scale * getattr(law.parameters, gain)
    return replace(law, parameters=replace(law.parameters, **{gain: scaled}))


def arguments_of_batch(system: str, kind: str, count: int = 4) -> dict[str, Any]:
    """Simulations that differ in plant, controller, start and number of disturbances."""
    scales = (1 + 0.1 * np.arange(count)).tolist()
    x0 = [0.1, 0.0] if system in ROBOTS else find_case(system, "nominal").x0
    disturbances = DISTURBANCES[system] * count
    return {
        "plant": [scaled_plant(system, kind, scale) for scale in scales],
        "controller": [scaled_law(system, scale) for scale in scales],
        "x0": np.array(x0) + 0.01 * np.arange(count)[:, None],
        "disturbances": [disturbances[: count - 1 - k] for k in range(count)],
    }


def arguments_of_run(batch: dict[str, Any], i: int) -> dict[str, Any]:
    """Arguments of one run of a batch."""
    return {name: items[i] for name, items in batch.items()}


each_batch = pytest.mark.parametrize(
    ("system", "kind"),
    [("servo", "corrected"), ("cart_pendulum", "RK4"), ("arm", "implicitfast"), ("delay", "RK4")],
)


@cache
def batch_in_python(system: str, kind: str) -> Trajectory:
    return simulate(**arguments_of_batch(system, kind), engine="python", **EACH_4)


@each_batch
def test_a_batch_is_its_single_runs(system: str, kind: str) -> None:
    batch = arguments_of_batch(system, kind)
    together = batch_in_python(system, kind)
    for i in range(3):
        alone = simulate(**arguments_of_run(batch, i), **EACH_4)
        assert_equal(together[i], alone)

    # A batch with any disturbance has a table for each run; a free run has none.
    free = simulate(**arguments_of_run(batch, 3), **EACH_4)
    assert_equal(together[3], free, [name for name in FIELDS if name != "wrench"])


@pytest.mark.parametrize("argument", ["plant", "controller", "x0", "disturbances"])
def test_arguments_that_stand_once_serve_every_run(argument: str) -> None:
    batch = arguments_of_batch("cart_pendulum", "RK4")
    shared = arguments_of_run(batch, 1)
    together = simulate(**(shared | {argument: batch[argument]}), **EACH_4)
    alone = simulate(**(shared | {argument: batch[argument][2]}), **EACH_4)
    assert_equal(together[2], alone, ("state", "command", "sliding"))


@each_batch
def test_a_batch_is_the_same_on_several_threads(system: str, kind: str) -> None:
    batch = arguments_of_batch(system, kind)
    repeated: dict[str, Any] = {name: list(items) * 8 for name, items in batch.items()}
    run = simulate(**repeated, threads=3, **EACH_4)
    expected = batch_in_python(system, kind)
    for name in FIELDS:
        rows = getattr(expected, name)
        if rows is not None:
            values = getattr(run, name)
            np.testing.assert_array_equal(values, np.concatenate([rows] * 8), err_msg=name)


def run_pendulums(kind: str, engine: Engine, *, record: bool) -> Trajectory:
    batch = arguments_of_batch("cart_pendulum", kind, 2)
    return simulate(**batch, duration=0.1, control_period=3e-3, engine=engine, record=record)


@cache
def pendulums(kind: str, engine: Engine, record: bool) -> Trajectory:
    return run_pendulums(kind, engine, record=record)


each_kind = pytest.mark.parametrize("kind", ["corrected", "RK4"])


@each_engine
@each_kind
def test_a_run_without_record_has_the_ends_of_the_record(kind: str, engine: Engine) -> None:
    recorded = pendulums(kind, engine, True)
    ends = pendulums(kind, engine, False)
    np.testing.assert_array_equal(ends.time, [0.0, 0.1])
    np.testing.assert_array_equal(ends.state, recorded.state[:, [0, -1]])
    assert (ends.physics is None) == (kind == "corrected")
    for name in ("command", "sliding", "weighed", "memory", "wrench"):
        np.testing.assert_array_equal(getattr(ends, name), getattr(recorded, name)[:, [-1]])


@each_kind
@pytest.mark.parametrize("record", [True, False])
def test_pieces_of_a_native_run_have_no_seam(
    kind: str, record: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where Python looks for Ctrl-C, the held input and the wrench stay."""
    unbroken = pendulums(kind, "native", record)
    monkeypatch.setattr(native_engine, "_FIRST_STEPS", 2)
    monkeypatch.setattr(native_engine, "_PAUSE", 1e-5)
    assert_equal(unbroken, run_pendulums(kind, "native", record=record))


def nominal_run(system: str, engine: Engine) -> Trajectory:
    x0 = find_case(system, "nominal").x0
    return simulate(plant_of(system, "RK4"), law_of(system), x0, duration=0.1, engine=engine)


def test_runs_on_several_threads_of_python_do_not_meet() -> None:
    cases = list(itertools.product(EDITED, ENGINES)) * 2
    with ThreadPoolExecutor(len(cases)) as pool:
        runs = list(pool.map(nominal_run, *zip(*cases, strict=True)))
    for (system, engine), run in zip(cases, runs, strict=True):
        assert_equal(run, nominal_run(system, engine))


@pytest.mark.parametrize(("system", "kind"), [("servo", "corrected"), ("cart_pendulum", "RK4")])
def test_a_loop_without_parts_is_no_loop(system: str, kind: str) -> None:
    plant = plant_of(system, kind)
    law = law_of(system)
    x0 = find_case(system, "nominal").x0
    periods: dict[str, Any] = {"control_period": 4 * H, "timestep": H}

    bare = simulate(plant, law, x0, duration=0.1, **periods)
    looped = simulate(plant, law, x0, duration=0.1, loop=Loop(), **periods)
    assert_equal(bare, looped, [name for name in FIELDS if name not in ("seen", "memory")])
    np.testing.assert_array_equal(seen(looped), bare.state[np.arange(100) // 4 * 4])
    assert bare.seen is None


# Sampling and replay


def sampling(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.samples += 1.0
    memory.x[0] = x[0]
    memory.x[1] = x[1]
    return t


@each_engine
@pytest.mark.parametrize("kind", ["corrected", "RK4"])
def test_a_law_is_sampled_once_a_control_period_at_exactly_k_T(kind: str, engine: Engine) -> None:
    """In the state at that instant, not that of a stage of RK4.

    9 k timesteps of 1 ms and k periods of 9 ms differ in binary.
    """
    law = replace(held(0.0), law=sampling, memory=Noticed)
    run = simulate(
        plant_of("servo", kind),
        law,
        [0.3, 1.0],
        duration=0.2,
        control_period=9e-3,
        engine=engine,
    )
    k = np.arange(200) // 9
    np.testing.assert_array_equal(run.memory["samples"], k + 1)
    np.testing.assert_array_equal(run.command, k * 9e-3)
    np.testing.assert_array_equal(run.memory["x"], run.state[k * 9])
    np.testing.assert_array_equal(run.time, np.arange(201) * 1e-3)


class EditedRun(NamedTuple):
    """A run of 100 timesteps of an edited plant."""

    model: mujoco.MjModel
    bodies: list[int]
    run: Any

    def assert_next_state(self, data: mujoco.MjData, i: int) -> None:
        """Step with the input and the wrench of an instant, and assert the state after it."""
        data.ctrl[:] = self.run.command[i]
        data.xfrc_applied[self.bodies] = self.run.wrench[i].reshape(-1, 6)
        mujoco.mj_step(self.model, data)
        np.testing.assert_array_equal(np.r_[data.qpos, data.qvel], self.run.state[i + 1])


@pytest.fixture(scope="module", params=[("cart_pendulum", "RK4"), ("arm", "implicitfast")])
def edited(request: pytest.FixtureRequest) -> EditedRun:
    system, integrator = request.param
    arguments = arguments_of_run(arguments_of_batch(system, integrator), 0)
    body, _ = EDITED[system]
    plant: Any = plant_of(system, integrator).changed(
        BodyEdit(body, 1.5, 1.2), AddedMass(body, 0.1)
    )
    run = simulate(**arguments | {"plant": plant}, duration=0.1, control_period=3e-3)
    bodies = [plant.model.body(name).id for name in plant.system.bodies]
    return EditedRun(plant.model, bodies, run)


def test_a_run_is_a_plain_loop_of_mj_step(edited: EditedRun) -> None:
    """With the plant's own model, as drawn."""
    data = mujoco.MjData(edited.model)
    data.qpos[:], data.qvel[:] = np.split(edited.run.state[0], 2)
    for i in range(100):
        edited.assert_next_state(data, i)
        assert edited.run.physics[i + 1, 0] == data.time


def test_a_run_goes_on_from_each_recorded_state(edited: EditedRun) -> None:
    """With the plant's own model, as drawn."""
    data = mujoco.MjData(edited.model)
    for i in range(100):
        row = edited.run.physics[i]
        mujoco.mj_setState(edited.model, data, row, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        # MuJoCo adds up the steps.
        assert data.time == pytest.approx(edited.run.time[i], rel=1e-12)
        edited.assert_next_state(data, i)


# Errors of MuJoCo's, which end a process that calls it by its address, and Ctrl-C


@pytest.mark.parametrize(("engine", "threads"), [("native", 2), ("python", 1)])
def test_an_error_of_mujoco_s_ends_no_process(
    engine: Engine, threads: int, capfd: pytest.CaptureFixture[str]
) -> None:
    plant = Robot.from_mjcf(CROWDED).plant
    starts = [[0.0, 0.0], [1.0, 0.0]]
    options: dict[str, Any] = {"engine": engine, "threads": threads}
    for _ in range(2):
        with pytest.raises(ModelError, match="MuJoCo cannot step the model: mj_stackAlloc"):
            simulate(plant, held(1.0), starts, duration=0.5, **options)

    # The next run is as ever.
    run = simulate(plant, held(1.0), starts, duration=0.01, **options)
    assert run.valid_until.tolist() == [0.01, 0.01]
    assert capfd.readouterr().err == ""


@pytest.fixture
def press_ctrl_c() -> Iterator[Callable[[float], object]]:
    """Press Ctrl-C after some seconds."""

    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    previous = signal.signal(signal.SIGALRM, interrupt)
    yield partial(signal.setitimer, signal.ITIMER_REAL)
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, previous)


def test_ctrl_c_ends_a_long_run(press_ctrl_c: Callable[[float], object]) -> None:
    """Of minutes, after which the next run is as ever."""
    plant = plant_of("servo", "RK4")
    law = law_of("servo", "lqr")
    starts = np.ones((2, 2))
    options: dict[str, Any] = {"record": False, "threads": 2}
    before = simulate(plant, law, starts, duration=0.1, **options)

    press_ctrl_c(0.2)
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        simulate(plant, law, starts, duration=90_000.0, **options)
    # 0.2 s, and a busy machine.
    assert time.monotonic() - began < 5

    assert_equal(simulate(plant, law, starts, duration=0.1, **options), before)
