"""Slotine and Li's law for robots: its regressor by MuJoCo, and an unknown load found."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.references import FourierSeries, fourier_series
from grosmc_mj.control.rivals.adaptive import adaptive
from grosmc_mj.control.task import Task
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.physics.edits import AddedMass
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.robots.dynamics import NominalData, inverse_dynamics
from grosmc_mj.robots.regressor import body_regressor, reference_torques
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.simulate import simulate

# A turning crane whose grip does not move against its slide, on a base that does not move.
CRANE = """<mujoco model="crane"><option timestep="0.001" integrator="RK4"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody>
<body name="base" pos="0.1 0 1"><geom type="box" size="0.1 0.1 0.1" mass="3"/>
<body name="mast"><joint name="turn" axis="0 0 1" damping="0.3" armature="0.2"/>
<geom type="box" size="0.1 0.2 0.05" mass="2" pos="0.05 0 0"/>
<body name="boom" pos="0.2 0 0" euler="0 10 20"><joint name="lift" axis="0 -1 0" stiffness="3"/>
<geom type="capsule" fromto="0 0 0 0.5 0 0.1" size="0.03" mass="1.5"/>
<body name="slide" pos="0.5 0 0.1"><joint name="reach" type="slide" axis="1 0 0" damping="1"/>
<geom type="box" size="0.05 0.02 0.03" pos="0.02 0 0.1" mass="0.9"/>
<body name="grip" pos="0.1 0.05 0" euler="20 30 0"><geom type="sphere" size="0.03" mass="0.2"/>
</body></body></body></body></body></worldbody>
<actuator><motor joint="turn"/><motor joint="lift"/><motor joint="reach"/></actuator></mujoco>"""
N = 3
BODIES = {"grip": "slide", "slide": "slide", "boom": "boom", "mast": "mast"}
MASS, AT = 0.8, (0.05, -0.1, 0.2)


@cache
def crane(timestep: float = 1e-3) -> Robot:
    return Robot.from_mjcf(CRANE, timestep=timestep)


@cache
def task() -> Task:
    sine = np.array([[0.3, 0.1], [0.1, 0.3], [0.05, 0.05]])
    series = FourierSeries(3.0, np.array([0.1, 0.2, 0.1]), 0.3 * sine, sine)
    Q = np.kron(np.eye(N), np.diag([100.0, 0.0]))
    return crane().task(fourier_series(N, 2), series, Q, np.eye(N))


@cache
def law(adaptation: float = 2.0, limit: float = np.inf) -> Controller:
    return adaptive(task(), 5.0, adaptation, limit)


@cache
def loaded(body: str = "grip") -> MujocoPlant:
    return crane().plant.edited(AddedMass(body, MASS, AT))


def added(body: str) -> Array:
    """What a point mass adds to the parameters of the body that moves with this one, (10,)."""
    model = crane().plant.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    here, carrier = data.body(body), data.body(BODIES[body])
    point = here.xpos + here.xmat.reshape(3, 3) @ AT
    r = carrier.xmat.reshape(3, 3).T @ (point - carrier.xpos)
    inertia = MASS * (r @ r * np.eye(3) - np.outer(r, r))
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    return np.array([MASS, *(MASS * r), *(inertia[pair] for pair in pairs)])


def samples(count: int = 6) -> list[tuple[Array, Array, Array]]:
    """States, reference rates and accelerations."""
    random = np.random.default_rng(4)
    return [(random.uniform(-1, 1, 2 * N), *random.normal(0, 3, (2, N))) for _ in range(count)]


def torques_of(plant: MujocoPlant, x: Array, a: Array) -> Array:
    """Inverse dynamics of a whole model, by MuJoCo."""
    data = mujoco.MjData(plant.model)
    data.qpos[:], data.qvel[:], data.qacc[:] = x[:N], x[N:], a
    mujoco.mj_inverse(plant.model, data)
    return data.qfrc_inverse.copy()


def written(function: Any, shape: Any, *arguments: Any) -> Array:
    """Result that a function of the crane's nominal model writes into its last argument."""
    data, result = NominalData(crane().nominal), np.zeros(shape)
    function(data.address, *arguments, result)
    return result


def regressor(body: str) -> Any:
    """(x, r, a) -> Y of a body, (N, 10 + N)."""
    model = crane().nominal
    index = model.body(BODIES[body]).id
    place = (index, int(model.body_rootid[index]), model.nbody)
    return lambda x, r, a: written(body_regressor, (N, 10 + N), x, r, a, place)


# --- the regressor ---


@pytest.mark.parametrize("body", BODIES)
def test_regressor_times_what_a_load_adds_is_the_difference_of_mujocos_inverse_dynamics(
    body: str,
) -> None:
    Y, theta = regressor(body), np.concatenate([added(body), np.zeros(N)])
    for x, _, a in samples():
        more = torques_of(loaded(body), x, a) - torques_of(crane().plant, x, a)
        assert np.abs(more).max() > 1e-3
        # Sums of terms of up to 1e2.
        np.testing.assert_allclose(Y(x, x[N:], a) @ theta, more, rtol=0, atol=1e-12)


def test_reference_torques_at_the_true_rates_are_inverse_dynamics() -> None:
    for x, _, a in samples():
        found = written(reference_torques, N, x, x[N:], a)
        expected = written(inverse_dynamics, N, x, a)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("of", ["robot", "body"])
def test_inertia_s_rate_less_twice_coriolis_is_skew_symmetric(of: str) -> None:
    """s'(M' - 2 C)s = 0 for every s, on which V' = -s'K_D s rests; M' by central differences."""
    Y, step = regressor("grip"), 1e-5
    theta = np.concatenate([added("grip"), np.zeros(N)])

    def torques(x: Array, r: Array, a: Array) -> Array:
        if of == "body":
            return Y(x, r, a) @ theta
        return written(reference_torques, N, x, r, a)

    for x, s, _ in samples():
        zero, rest = np.zeros(N), np.r_[x[:N], np.zeros(N)]
        coriolis = torques(x, s, zero) - torques(x, zero, zero)

        def inertia(q: Array, s: Array = s) -> Array:
            at = np.r_[q, np.zeros(N)]
            return torques(at, np.zeros(N), s) - torques(at, np.zeros(N), np.zeros(N))

        moved = inertia(x[:N] + step * x[N:]) - inertia(x[:N] - step * x[N:])
        assert abs(s @ coriolis) > 1e-3
        # The third derivative along the motion times step^2, and rounding of 1e-16 over step.
        assert s @ moved / (2 * step) == pytest.approx(2 * s @ coriolis, abs=1e-7)
        assert rest.any()


# --- runs ---


def errors(found: Any, controller: Controller) -> Array:
    """Errors of the joints, (samples, N)."""
    coordinates = controller.coordinates
    return coordinates.along(found.time, found.state, controller.parameters)[:, ::2]


def test_lyapunov_function_falls_as_s_K_D_s() -> None:
    """V' = -s'K_D s, to the first order in the period, with V of the loaded crane.

    The load hangs at the grip, a constant torque is on every joint that the law does not know.
    """
    period = 1e-4
    controller = law(0.2).sampled(period)
    pushes = [Disturbance("mast", (0.0, 0.0, 0.0, 0.0, 0.0, 0.5))]
    start = np.r_[np.array(task().outputs.reference(0.0, task().reference))[::3] + 0.1, np.zeros(N)]
    plant = crane(period).plant.edited(AddedMass("grip", MASS, AT))
    found = simulate(plant, controller, start, duration=0.5, disturbances=pushes)
    # A torque about the mast's own axis is one on its joint alone.
    push = np.array([-0.5, 0.0, 0.0])
    theta = np.concatenate([added("grip"), push])
    s, count = found.memory["composite"], len(found.memory["theta"])
    off = np.vstack([np.zeros_like(theta), found.memory["theta"][:-1]]) - theta
    model, M = plant.model, np.zeros((N, N))
    data, V = mujoco.MjData(model), np.sum(off**2, axis=1) / (2 * controller.parameters.adaptation)
    for k in range(count):
        data.qpos[:] = found.state[k, :N]
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, M)
        V[k] += s[k] @ M @ s[k] / 2
    fall = np.einsum("ki,ij,kj->k", s, controller.parameters.damping, s)
    slope = np.diff(V) / period
    assert V[-1] < 0.9 * V[0]
    np.testing.assert_allclose(slope, -fall[:-1], atol=0.02 * fall.max())


@pytest.mark.slow
def test_both_engines_and_a_batch_run_the_same_law() -> None:
    start = np.array([0.2, 0.1, 0.0, 0.0, 0.0, 0.0])
    plants = [crane().plant.edited(AddedMass("grip", mass, AT)) for mass in (0.1, MASS)]
    batch = simulate(plants, law(), np.tile(start, (2, 1)), duration=0.3)
    for plant, expected in zip(plants, batch.state, strict=True):
        for engine in ("native", "python"):
            alone = simulate(plant, law(), start, duration=0.3, engine=engine)
            np.testing.assert_array_equal(alone.state, expected)
    assert np.abs(batch.state[0, -1] - batch.state[1, -1]).max() > 1e-3


def test_estimates_hold_while_an_input_is_beyond_its_limit() -> None:
    start = np.array([0.5, 0.5, 0.0, 0.0, 0.0, 0.0])
    found = simulate(loaded(), law(limit=1e-3), start, duration=0.05)
    assert not found.memory["theta"].any()


# --- files ---

FILE = """
[plant]
model = "crane.xml"
[run]
start = {{ turn = "0.2 rad" }}
duration = "0.1 s"
[task]
Q = [100, 0, 100, 0, 100, 0]
R = 1
reference = ["0.1*sin(t)", "0.2", "0.1"]
{more}
[[controller]]
law = "adaptive"
frequency = 5
adaptation = 5
{numbers}
[[requirement]]
settles_within = "1 s"
"""


def experiment(folder: Path, numbers: str = "", more: str = "") -> Experiment:
    (folder / "crane.xml").write_text(CRANE, encoding="utf-8")
    (folder / "mine.toml").write_text(FILE.format(numbers=numbers, more=more), encoding="utf-8")
    return Experiment.load(folder / "mine.toml")


def test_a_file_may_name_the_body(tmp_path: Path) -> None:
    """One that does not move against the default's is the same choice, another one is not."""
    more = '[[edit]]\nbody = "grip"\nadded_mass = "1 kg"\n'
    named = ("", 'body = "grip"', 'body = "boom"')
    ends = [experiment(tmp_path, each, more).run().trajectory.state[-1] for each in named]
    np.testing.assert_array_equal(ends[0], ends[1])
    assert np.abs(ends[0] - ends[2]).max() > 1e-9


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ('body = "gripp"', "unknown body 'gripp': did you mean 'grip'"),
        ('body = "base"', "unknown body 'base'"),
        ("body = 3", "body = 3 must be a name"),
        ("limit = -1", "limit = -1 must be positive"),
    ],
)
def test_what_is_wrong_is_told_in_one_line(tmp_path: Path, numbers: str, said: str) -> None:
    with pytest.raises(ArgumentError) as refused:
        experiment(tmp_path, numbers)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


# --- the Jaco arm ---
