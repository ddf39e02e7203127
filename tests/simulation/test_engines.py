"""One law, two engines, one or many simulations: the same numbers, bit for bit."""

from __future__ import annotations

import enum
import os
import signal
import subprocess
import sys
import time
import types
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import cloudpickle
import mujoco
import numba
import numpy as np
import pytest
from shipped import controller_names, find_case

from grosmc_mj.arrays import Array
from grosmc_mj.compilation import array_at, compile_c, fingerprint
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.memory import Memory
from grosmc_mj.errors import SetupError
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.jitable import jitable
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant
from grosmc_mj.simulation.disturbances import Disturbance, Pulse, SineFrom
from grosmc_mj.simulation.simulate import Engine, simulate
from grosmc_mj.simulation.trajectory import Trajectory

SYSTEMS = ("servo", "cart_pendulum", "arm")
LAWS = [(system, law) for system in SYSTEMS for law in controller_names(system)]
FIELDS = ("state", "command", "input", "sliding", "weighed", "wrench", "physics", "valid_until")
ENGINES: tuple[Engine, Engine] = ("native", "python")

# An edited parameter of each system, in the model and in the equations.
EDITED = {"servo": ("rotor", "J"), "cart_pendulum": ("pole", "m"), "arm": ("link", "m")}
WRENCHES = {
    "servo": [Disturbance("rotor", (0, 0, 0, 0, -0.7, 0), SineFrom(9.0, 0.05))],
    "cart_pendulum": [
        Disturbance("cart", (2.0, 0, 0, 0, 0, 0), Pulse(0.1, 0.2)),
        Disturbance("pole", (0.3, 0, -0.2, 0, 0.1, 0), SineFrom(7.0)),
    ],
    "arm": [Disturbance("link", (0.05, 0, -0.2, 0, 0.1, 0), SineFrom(20.0, phase=0.3))],
}


@cache
def physics(system: str, integrator: Any = None, timestep: float | None = None) -> MujocoPlant:
    return MujocoPlant.load(system, integrator=integrator, timestep=timestep)


@cache
def controller(system: str, law: str) -> Controller:
    return chapter_controller(law, physics(system).analytic())


def start(system: str) -> tuple[float, ...]:
    return find_case(system, "nominal").x0


def plant_of(system: str, kind: str) -> AnalyticPlant | MujocoPlant:
    """A plant by the variant of its equations, or by the integrator of its model."""
    if kind == "printed" or kind == "corrected":
        return physics(system).analytic(kind)
    return physics(system, kind)


def difference(a: Trajectory, b: Trajectory, fields: tuple[str, ...] = FIELDS) -> float:
    """Largest difference of two trajectories in all that they record."""
    largest = 0.0
    for field in fields:
        x, y = getattr(a, field), getattr(b, field)
        assert (x is None) == (y is None), field
        if x is not None:
            assert np.shape(x) == np.shape(y), field
            largest = max(largest, float(np.abs(x - y).max()))
    assert np.array_equal(a.status, b.status)
    return largest


def assert_engines_agree(plant: Any, ctl: Any, x0: Any, **options: Any) -> None:
    native = simulate(plant, ctl, x0, engine="native", **options)
    python = simulate(plant, ctl, x0, engine="python", **options)
    # Both use one libm in one order of operations: the difference is zero here. Another
    # compiler may contract a product and a sum; 1e-12 is that, after 300 steps.
    assert difference(native, python) <= 1e-12


# The two engines


@pytest.mark.parametrize("disturbed", [False, True], ids=["free", "pushed"])
@pytest.mark.parametrize("stride", [1, 5])
@pytest.mark.parametrize(
    ("system", "law", "kind"),
    [
        (system, law, kind)
        for system, law in LAWS
        for kind in ("printed", "corrected", "RK4", "implicitfast")
        if (system, kind) != ("servo", "printed")  # which is the corrected one
    ],
)
def test_engines_agree_to_rounding(system, law, kind, stride, disturbed):
    assert_engines_agree(
        plant_of(system, kind),
        controller(system, law),
        start(system),
        duration=0.3,
        control_period=stride * 1e-3,
        disturbances=WRENCHES[system] if disturbed else (),
    )


@pytest.mark.parametrize("integrator", ["Euler", "implicit"])
def test_engines_agree_under_the_other_integrators(integrator):
    plant, ctl = physics("cart_pendulum", integrator, 2e-3), controller("cart_pendulum", "grosmc")
    options = {"duration": 0.3, "control_period": 6e-3}
    assert_engines_agree(plant, ctl, start("cart_pendulum"), **options)


@pytest.mark.parametrize("kind", ["corrected", "RK4"])
def test_engines_agree_on_a_batch_of_plants_starts_pushes_and_numbers(kind):
    plants, ctls, starts, pushes = batch("cart_pendulum", kind, 4)
    assert_engines_agree(plants, ctls, starts, duration=0.2, disturbances=pushes)


@pytest.mark.parametrize("first", ["RK4", "implicitfast"])
def test_engines_agree_on_a_batch_of_two_integrators(first):
    second = "implicitfast" if first == "RK4" else "RK4"
    plants = [physics("servo", first), physics("servo", second)]
    assert_engines_agree(plants, controller("servo", "grosmc"), start("servo"), duration=0.1)


@dataclass(frozen=True)
class Numbers:
    values: Array


def last_number(t: float, x: Any, memory: Any, p: Any) -> float:
    return p.values[-1]


# As many as the parameters of a plant, or fewer.
@pytest.mark.parametrize(("system", "count"), [("servo", 1), ("cart_pendulum", 3), ("arm", 6)])
def test_native_law_reads_its_own_numbers_however_many(system, count):
    """Each buffer that compiled code gets by address must outlive the call."""
    ctl = Controller("last", last_number, Numbers(1.0 + np.arange(count)))
    run = simulate(physics(system).analytic(), ctl, start(system), duration=3e-3)
    assert set(run.command) == {count}


# Batches


def batch(
    system: str, kind: str, count: int
) -> tuple[list[Any], list[Controller], Array, list[list[Disturbance]]]:
    """Simulations that differ in plant, controller, start and disturbances."""
    body, name = EDITED[system]
    scales = 1 + 0.1 * np.arange(count)
    twin, ctl, plants = physics(system), controller(system, "grosmc"), []
    for scale in scales.tolist():
        if kind == "corrected":
            p = twin.analytic().parameters
            p = replace(p, **{name: scale * getattr(p, name)})
            plants.append(replace(twin.analytic(), parameters=p))
        else:
            plants.append(physics(system, kind).edited(BodyEdit(body, scale, scale)))
    gains = [replace(ctl.parameters, K=k * ctl.parameters.K) for k in scales]
    ctls = [replace(ctl, parameters=p) for p in gains]
    starts = np.array(start(system)) + 0.01 * np.arange(count)[:, None]
    pushes: list[list[Disturbance]] = [[], *([WRENCHES[system][-1]] * k for k in range(1, count))]
    return plants, ctls, starts, pushes


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("kind", ["corrected", "RK4", "implicitfast"])
@pytest.mark.parametrize("system", SYSTEMS)
def test_batch_is_its_single_runs_bit_for_bit(system, kind, engine):
    plants, ctls, starts, pushes = batch(system, kind, 3)
    options: dict[str, Any] = {"duration": 0.1, "control_period": 2e-3, "engine": engine}
    together = simulate(plants, ctls, starts, disturbances=pushes, threads=2, **options)
    assert len(together) == 3
    for i in range(3):
        alone = simulate(plants[i], ctls[i], starts[i], disturbances=pushes[i], **options)
        # A batch with any disturbance has a table for each run; a free run has none.
        fields = tuple(field for field in FIELDS if field != "wrench" or pushes[i])
        assert difference(together[i], alone, fields) == 0


def test_batches_in_which_only_one_thing_differs():
    """What is given once serves every simulation."""
    plants, ctls, starts, pushes = batch("servo", "RK4", 3)
    base: dict[str, Any] = {
        "plant": plants[0],
        "controller": ctls[0],
        "x0": starts[0],
        "disturbances": pushes[1],
    }
    varied = {"plant": plants, "controller": ctls, "x0": starts, "disturbances": pushes}
    for name, values in varied.items():
        together = simulate(**{**base, name: values}, duration=0.05)
        for i, value in enumerate(values):
            alone = simulate(**{**base, name: value}, duration=0.05)
            assert difference(together[i], alone, ("state", "command", "sliding")) == 0, name


@pytest.mark.parametrize("kind", ["corrected", "RK4"])
@pytest.mark.parametrize("threads", [1, 2, 4])
def test_threads_do_not_matter(kind, threads):
    """64 simulations that share nothing, on any number of threads, again and again."""
    plants, ctls, starts, pushes = batch("servo", kind, 4)
    many: dict[str, Any] = {
        "plant": plants * 16,
        "controller": ctls * 16,
        "x0": np.tile(starts, (16, 1)),
        "disturbances": pushes * 16,
        "duration": 0.1,
    }
    once = simulate(**many, engine="python")
    for _ in range(3):
        assert difference(simulate(**many, threads=threads), once) == 0


@pytest.mark.parametrize("disturbed", [False, True], ids=["free", "pushed"])
def test_long_batch_is_cut_into_pieces_without_a_seam(disturbed):
    """500 simulations of 250 steps exceed the rows that one call records."""
    plant, ctl = physics("cart_pendulum"), controller("cart_pendulum", "grosmc")
    starts = np.array(start("cart_pendulum")) * np.linspace(0.5, 1, 500)[:, None]
    pushes = WRENCHES["cart_pendulum"] if disturbed else []
    options: dict[str, Any] = {"duration": 0.25, "control_period": 3e-3, "disturbances": pushes}
    together = simulate(plant, ctl, starts, **options)
    for i in (0, 250, 499):
        assert difference(together[i], simulate(plant, ctl, starts[i], **options)) == 0


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("disturbed", [False, True], ids=["free", "pushed"])
@pytest.mark.parametrize("kind", ["corrected", "RK4"])
def test_run_without_recording_ends_where_the_recorded_one_does(kind, disturbed, engine):
    plants, ctls, starts, pushes = batch("cart_pendulum", kind, 2)
    run = {
        record: simulate(
            plants,
            ctls,
            starts,
            duration=0.1,
            control_period=3e-3,
            disturbances=pushes if disturbed else (),
            record=record,
            engine=engine,
        )
        for record in (True, False)
    }
    assert run[False].state.shape == (2, 2, 4)
    np.testing.assert_array_equal(run[False].time, [0.0, 0.1])
    for field in ("state", "physics"):
        short, full = getattr(run[False], field), getattr(run[True], field)
        if full is not None:
            np.testing.assert_array_equal(short, full[:, [0, -1]])
    for field in ("command", "sliding", "weighed", "wrench"):
        short, full = getattr(run[False], field), getattr(run[True], field)
        if full is not None:
            np.testing.assert_array_equal(short[:, 0], full[:, -1])


# Sampling


@dataclass
class CountingMemory(Memory):
    """Counts the calls of a law in the signal that every trajectory has."""

    calls: float = 0.0


def count_calls(t: float, x: Any, memory: Any, p: Any) -> float:
    """Answer with the time, record the number of the call."""
    memory.calls += 1.0
    memory.v = memory.calls
    return t


def seen_position(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.v = x[0]
    return 1.0


@dataclass(frozen=True)
class Nothing:
    nothing: float = 0.0


@pytest.mark.parametrize("engine", ENGINES)
# 9 k timesteps of 1 ms and k periods of 9 ms differ in binary.
@pytest.mark.parametrize("stride", [1, 9])
@pytest.mark.parametrize("kind", ["corrected", "RK4", "implicitfast"])
def test_law_runs_once_a_control_period_at_exactly_k_times_T(kind, stride, engine):
    """Also under RK4, whose four stages all ask for control."""
    plant, T = plant_of("servo", kind), stride * 1e-3
    ctl = Controller("count", count_calls, Nothing(), CountingMemory)
    run = simulate(plant, ctl, start("servo"), duration=0.5, control_period=T, engine=engine)
    k = np.arange(500) // stride
    np.testing.assert_array_equal(run.weighed, k + 1)
    np.testing.assert_array_equal(run.command, k * T)
    np.testing.assert_array_equal(run.time, np.arange(501) * 1e-3)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("kind", ["corrected", "RK4", "implicitfast"])
def test_law_sees_the_state_at_its_sampling_instant(kind, engine):
    """Not that of a later stage of RK4, which belongs to another time."""
    plant, ctl = plant_of("servo", kind), Controller("see", seen_position, Nothing())
    run = simulate(plant, ctl, [0.3, 1.0], duration=0.1, control_period=5e-3, engine=engine)
    samples = np.arange(100) // 5 * 5
    np.testing.assert_array_equal(run.weighed, run.state[samples, 0])


# Replay


@pytest.mark.parametrize("system", SYSTEMS)
def test_physics_state_replays_the_run(system):
    """mj_setState gives back x at every instant, and one mj_step from there the next."""
    body, _ = EDITED[system]
    plant = physics(system).edited(BodyEdit(body, 1.5, 1.2))
    options: dict[str, Any] = {"disturbances": WRENCHES[system], "control_period": 2e-3}
    run = simulate(plant, controller(system, "grosmc"), start(system), duration=0.1, **options)
    assert run.physics is not None
    assert run.wrench is not None
    model, full = plant.model, mujoco.mjtState.mjSTATE_FULLPHYSICS
    data = mujoco.MjData(model)
    bodies = [model.body(name).id for name in plant.system.bodies]
    for i in range(100):
        mujoco.mj_setState(model, data, run.physics[i], full)
        np.testing.assert_array_equal(np.concatenate([data.qpos, data.qvel]), run.state[i])
        assert data.time == pytest.approx(run.time[i], rel=1e-12)  # MuJoCo adds up the steps
        data.ctrl[0] = run.input[i]
        data.xfrc_applied[bodies] = run.wrench[i].reshape(-1, 6)
        mujoco.mj_step(model, data)
        np.testing.assert_array_equal(np.concatenate([data.qpos, data.qvel]), run.state[i + 1])


@pytest.mark.parametrize("integrator", ["RK4", "implicitfast"])
@pytest.mark.parametrize("system", SYSTEMS)
def test_a_run_is_a_plain_loop_of_mj_step_under_the_held_input(system, integrator):
    """From the start on, with the plant's own model, as drawn."""
    body, _ = EDITED[system]
    plant = physics(system, integrator).edited(BodyEdit(body, 1.5, 1.2))
    options: dict[str, Any] = {"disturbances": WRENCHES[system], "control_period": 3e-3}
    run = simulate(plant, controller(system, "grosmc"), start(system), duration=0.5, **options)
    assert run.wrench is not None
    model, n = plant.model, plant.system.degrees_of_freedom
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = run.state[0, :n], run.state[0, n:]
    bodies, found = [model.body(name).id for name in plant.system.bodies], [run.state[0]]
    for i in range(500):
        data.ctrl[0] = run.command[i]
        data.xfrc_applied[bodies] = run.wrench[i].reshape(-1, 6)
        mujoco.mj_step(model, data)
        found.append(np.concatenate([data.qpos, data.qvel]))
    np.testing.assert_array_equal(run.state, found)
    # One input for each control period: the law is asked at its start only.
    np.testing.assert_array_equal(run.command, np.repeat(run.command[::3], 3)[:500])


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
@pytest.mark.parametrize("kind", ["corrected", "RK4"])
def test_ctrl_c_ends_a_long_run(kind, threads):
    """Of minutes, after which the next run is as ever."""
    plant, ctl, x0 = plant_of("servo", kind), controller("servo", "lqr"), start("servo")
    options: dict[str, Any] = {"record": False, "threads": threads}

    def press(*_: Any) -> None:
        raise KeyboardInterrupt

    before = simulate(plant, ctl, [x0, x0], duration=0.1, **options)
    was = signal.signal(signal.SIGALRM, press)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.5)
        began = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            simulate(plant, ctl, [x0, x0], duration=90_000.0, **options)
        # 0.2 s, and a busy machine.
        assert time.monotonic() - began < 5
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, was)
    assert difference(simulate(plant, ctl, [x0, x0], duration=0.1, **options), before) == 0


# Somebody else's callback


@pytest.fixture
def foreign_callback() -> Iterator[Callable[[Any, Any], None]]:
    """Somebody else's control callback, in place."""

    def callback(model: Any, data: Any) -> None:
        data.ctrl[:] = 5.0

    physics("servo").model  # noqa: B018  compiled before: MuJoCo calls back while it compiles
    mujoco.set_mjcb_control(callback)
    yield callback
    mujoco.set_mjcb_control(None)


def test_native_run_refuses_to_silence_a_foreign_callback(foreign_callback):
    with pytest.raises(SetupError, match="already installed"):
        simulate(physics("servo"), controller("servo", "lqr"), start("servo"), duration=0.01)
    assert mujoco.get_mjcb_control() is foreign_callback


def test_foreign_callback_does_not_steer_the_python_engine(foreign_callback):
    """The message of the native engine recommends this engine for that case."""
    run = {"x0": start("servo"), "duration": 0.01}
    plant, ctl = physics("servo"), controller("servo", "lqr")
    try:
        steered = simulate(plant, ctl, engine="python", **run).state
    except SetupError:
        return  # refusing is as good
    mujoco.set_mjcb_control(None)
    np.testing.assert_array_equal(steered, simulate(plant, ctl, engine="python", **run).state)


def test_runs_on_several_threads_do_not_meet():
    cases: list[tuple[str, Engine]] = [(s, e) for s in SYSTEMS for e in ENGINES] * 2

    def run(case: tuple[str, Engine]) -> Trajectory:
        system, engine = case
        ctl = controller(system, "grosmc")
        return simulate(physics(system), ctl, start(system), duration=0.2, engine=engine)

    expected = [run(case) for case in cases]
    with ThreadPoolExecutor(len(cases)) as pool:
        for case, one, other in zip(cases, pool.map(run, cases), expected, strict=True):
            assert difference(one, other) == 0, case


# The compile cache


def law_with(helper: Callable[[float], float]) -> Callable[..., float]:
    def law(t: float, x: Any, memory: Any, p: Any) -> float:
        return helper(x[0] + 1.0)

    return law


def helper_with(k: float) -> Callable[[float], float]:
    @jitable
    def helper(x: float) -> float:
        return k * x

    return helper


def other_helper(k: float) -> Callable[[float], float]:
    @jitable
    def helper(x: float) -> float:
        return k + x

    return helper


def test_fingerprint_follows_the_functions_that_a_law_calls():
    same = [fingerprint(law_with(helper_with(2.0))) for _ in range(2)]
    assert same[0] == same[1]
    changed = {fingerprint(law_with(f(k))) for f in (helper_with, other_helper) for k in (2.0, 3.0)}
    assert len(changed) == 4


def test_law_is_compiled_anew_when_a_function_that_it_calls_changes():
    plant = physics("servo").analytic()
    for k in (2.0, 3.0):
        for make, expected in ((helper_with, k), (other_helper, k + 1)):
            ctl = Controller("helped", law_with(make(k)), Nothing())
            assert simulate(plant, ctl, [0, 0], duration=1e-3).command[0] == expected


def test_a_new_law_is_compiled_alone_and_once_for_equations_and_mujoco(tmp_path, monkeypatch):
    plants = [physics("servo"), physics("servo").analytic()]
    for k in (5.0, 6.0):
        ctl = Controller("alone", law_with(helper_with(k)), Nothing())
        for plant in plants:
            assert simulate(plant, ctl, [0, 0], duration=1e-3).command[0] == k
        # The second time, after all that they share.
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    (entry,) = tmp_path.rglob("*.nbi")
    assert entry.name.startswith("sample-")


def test_law_that_has_travelled_is_compiled_where_it_arrives(tmp_path, monkeypatch):
    """By value, as laws of one's own do that no module has."""
    plant, law = physics("servo").analytic(), by_array(2.0)
    for folder in ("here", "there"):
        # Where nothing is compiled yet.
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / folder))
        ctl = Controller("travelled", law, Nothing())
        assert simulate(plant, ctl, [0, 0], duration=1e-3).command[0] == 2.0
        law = cloudpickle.loads(cloudpickle.dumps(law))


def by_array(k: float) -> Callable[..., float]:
    gains = np.array([k, 1.0])

    def law(t: float, x: Any, memory: Any, p: Any) -> float:
        return gains[0]

    return law


def by_numpy_number(k: float) -> Callable[..., float]:
    gain = np.int64(k)

    def law(t: float, x: Any, memory: Any, p: Any) -> float:
        return 1.0 * gain

    return law


def by_default(k: float) -> Callable[..., float]:
    def law(t: float, x: Any, memory: Any, p: Any, gain: float = k) -> float:
        return gain

    return law


def by_compiled_helper(k: float) -> Callable[..., float]:
    @numba.njit
    def helper(x: float) -> float:
        return k * x

    return law_with(helper)


def by_module_constant(k: float) -> Callable[..., float]:
    module: Any = types.ModuleType("gains")
    module.k = k

    def law(t: float, x: Any, memory: Any, p: Any) -> float:
        return module.k * 1.0

    return law


def by_module_function(k: float) -> Callable[..., float]:
    module: Any = types.ModuleType("helpers")
    module.helper = helper_with(k)

    def law(t: float, x: Any, memory: Any, p: Any) -> float:
        return module.helper(1.0)

    return law


class Level(enum.Enum):
    LOW = 3.0
    HIGH = 7.0


def by_enumeration(k: float) -> Callable[..., float]:
    level = Level(k)

    def law(t: float, x: Any, memory: Any, p: Any) -> float:
        return level.value * 1.0

    return law


@pytest.mark.parametrize(
    "make",
    [
        by_array,
        by_numpy_number,
        by_default,
        by_compiled_helper,
        by_module_constant,
        by_module_function,
        by_enumeration,
    ],
)
def test_fingerprint_follows_every_number_that_numba_freezes(make):
    """Otherwise a changed law runs the old machine code from the disk, without a word."""
    assert fingerprint(make(3.0)) == fingerprint(make(3.0))
    assert fingerprint(make(3.0)) != fingerprint(make(7.0))


def test_fingerprint_is_the_same_in_another_process():
    """Or nothing would ever be found in the cache on disk."""
    program = """
from grosmc_mj.compilation import compile_c, fingerprint
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.experiments.catalogue import chapter_controller
plant = MujocoPlant.load("arm").analytic()
print(*(fingerprint(chapter_controller(name, plant).law) for name in ("lqr", "grosmc")))
"""
    root = Path(__file__).resolve().parents[2]
    printed = subprocess.run(
        [sys.executable, "-c", program],
        cwd=root,
        env={**os.environ, "PYTHONHASHSEED": "1", "PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    here = [fingerprint(controller("arm", law).law) for law in ("lqr", "grosmc")]
    assert printed == here
    assert here[0] != here[1]


COMPILE_SLOWLY = """
import sys, time
import numba, numpy as np
from numba.core.caching import IndexDataCacheFile as Cache
from grosmc_mj.compilation import array_at, compile_c

def slow(method, seconds):
    return lambda *arguments: (time.sleep(seconds), method(*arguments))[1]

k, before_index, before_data = map(float, sys.argv[1:])
Cache._save_index = slow(Cache._save_index, before_index)
Cache._save_data = slow(Cache._save_data, before_data)

def storing(k):
    def store(address):
        array_at(address, (1,), np.float64)[0] = k
    return store

result = np.zeros(1)
compile_c(storing(k), numba.types.voidptr).ctypes(result.ctypes.data)
print(result[0])
"""


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
@pytest.mark.parametrize("content", [b"", b"cut", b"\x80\x05cos\nsystem\n"])
def test_a_damaged_entry_of_the_cache_is_compiled_again(kind, content, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))

    def compiled() -> float:
        # What a law returns, compiled anew or taken from the disk.
        function = compile_c(store_seven, numba.types.voidptr)
        found = np.zeros(1)
        function.ctypes(found.ctypes.data)
        return found[0]

    assert compiled() == 7.0
    (entry,) = tmp_path.rglob(f"*.{kind}")
    whole = entry.read_bytes()
    entry.write_bytes(content or whole[: len(whole) // 2])
    assert compiled() == 7.0
    (entry,) = tmp_path.rglob(f"*.{kind}")
    # It is whole: the next one reads it, and writes none.
    written = entry.stat().st_mtime_ns, entry.read_bytes()
    assert compiled() == 7.0
    assert (entry.stat().st_mtime_ns, entry.read_bytes()) == written


def store_seven(address: Any) -> None:
    array_at(address, (1,), np.float64)[0] = 7.0


@pytest.mark.slow
def test_processes_that_compile_at_once_do_not_swap_their_laws(tmp_path):
    """Both have read the index before either writes it, as parallel tests do on a cold cache.

    The first writes its code last and the second its index entry: the entry then leads to the
    other's code.
    """
    root = Path(__file__).resolve().parents[2]
    env = {**os.environ, "PYTHONPATH": str(root), "NUMBA_CACHE_DIR": str(tmp_path)}

    def start_with(*numbers: float) -> subprocess.Popen[str]:
        command = [sys.executable, "-c", COMPILE_SLOWLY, *map(str, numbers)]
        return subprocess.Popen(command, cwd=tmp_path, env=env, stdout=subprocess.PIPE, text=True)

    for process in (start_with(1.0, 1.0, 1.0), start_with(2.0, 1.5, 0.0)):
        process.communicate(timeout=120)
    for k in (1.0, 2.0):
        printed, _ = start_with(k, 0.0, 0.0).communicate(timeout=120)
        assert float(printed) == k


COMPILE_NAMESAKES = """
import math, sys
import numba, numpy as np
from grosmc_mj.compilation import array_at, compile_c

def law_of(k):
    # Too long to be inlined: it is called by its name.
    @numba.njit
    def long(x):
        SINES
        return k + 0.0 * x

    @numba.njit
    def recursive(x):
        return k if x < 1.0 else recursive(x - 1.0)

    inner = INNER

    def control(address):
        result = array_at(address, (1,), np.float64)
        result[0] = inner(result[0] + inner(result[0]))

    return control

for k in sys.argv[1:]:
    function, result = compile_c(law_of(float(k)), numba.types.voidptr), np.ones(1)
    function.ctypes(result.ctypes.data)
    print(result[0])
""".replace("SINES", "; ".join(200 * ["x = math.sin(x) * x"]))


@pytest.mark.slow
@pytest.mark.parametrize("inner", ["long", "recursive"])
def test_laws_of_one_name_that_two_processes_compiled_stay_apart(inner, tmp_path):
    """numba numbers the functions of every process from 1 and links them by these names.

    What calls itself does so by an address of its process, and cannot be loaded by another.
    """
    root = Path(__file__).resolve().parents[2]
    env = {**os.environ, "PYTHONPATH": str(root), "NUMBA_CACHE_DIR": str(tmp_path)}
    for numbers in ("1",), ("2",), ("1", "2"):
        command = [sys.executable, "-c", COMPILE_NAMESAKES.replace("INNER", inner), *numbers]
        printed = subprocess.check_output(command, cwd=tmp_path, env=env, text=True)
        assert [float(number) for number in printed.split()] == [float(k) for k in numbers]
