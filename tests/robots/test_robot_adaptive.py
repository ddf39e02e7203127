"""Slotine and Li's law for robots: its regressor by MuJoCo, and an unknown load."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from mjcf import TREE

from grosmc_mj.arrays import Array
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

N = 3
# The joints' limits are not what is tested.
UNLIMITED = TREE.replace(' ctrlrange="-1 0.5"', "").replace(' forcerange="-30 30"', "")
# The bodies that the others move with.
CARRIERS = {"tool": "boom", "tray": "tray"}
MASS, AT = 0.8, (0.05, -0.1, 0.2)


@cache
def tree(timestep: float = 1e-3) -> Robot:
    return Robot.from_mjcf(UNLIMITED, timestep=timestep, integrator="RK4")


@cache
def task() -> Task:
    sine = np.array([[0.3], [0.1], [0.05]])
    series = FourierSeries(3.0, np.array([0.1, 0.2, 0.1]), 0.3 * sine, sine)
    Q = np.kron(np.eye(N), np.diag([100.0, 0.0]))
    return tree().task(fourier_series(N, 1), series, Q, np.eye(N))


def loaded(body: str, timestep: float = 1e-3) -> MujocoPlant:
    return tree(timestep).plant.edited(AddedMass(body, MASS, AT))


def added(body: str) -> Array:
    """What a point mass adds to the parameters of the body that moves with this one, (10,)."""
    model = tree().plant.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    here, carrier = data.body(body), data.body(CARRIERS[body])
    point = here.xpos + here.xmat.reshape(3, 3) @ AT
    r = carrier.xmat.reshape(3, 3).T @ (point - carrier.xpos)
    inertia = MASS * (r @ r * np.eye(3) - np.outer(r, r))
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    return np.array([MASS, *(MASS * r), *(inertia[pair] for pair in pairs)])


def written(function: Any, shape: Any, *arguments: Any) -> Array:
    """Result that a function of the nominal model writes into its last argument."""
    data, result = NominalData(tree().nominal), np.zeros(shape)
    function(data.address, *arguments, result)
    return result


@pytest.mark.parametrize("body", CARRIERS)
def test_regressor_times_what_a_load_adds_is_the_difference_of_mujocos_inverse_dynamics(
    body: str,
) -> None:
    model = tree().nominal
    index = model.body(CARRIERS[body]).id
    place = (index, int(model.body_rootid[index]), model.nbody)
    random = np.random.default_rng(4)
    for x, a in zip(random.uniform(-1, 1, (3, 2 * N)), random.normal(0, 3, (3, N)), strict=True):
        inverse = []
        for plant in (tree().plant, loaded(body)):
            data = mujoco.MjData(plant.model)
            data.qpos[:], data.qvel[:], data.qacc[:] = x[:N], x[N:], a
            mujoco.mj_inverse(plant.model, data)
            inverse.append(data.qfrc_inverse.copy())
        nominal, more = inverse[0], inverse[1] - inverse[0]
        assert np.abs(more).max() > 1e-3
        # Sums of terms of up to 1e2.
        close: dict[str, Any] = {"rtol": 0, "atol": 1e-12}
        Y = written(body_regressor, (N, 10 + N), x, x[N:], a, place)
        np.testing.assert_allclose(Y @ [*added(body), *np.zeros(N)], more, **close)
        np.testing.assert_array_equal(Y[:, 10:], np.eye(N))
        for torques in (
            written(reference_torques, N, x, x[N:], a), written(inverse_dynamics, N, x, a),
        ):  # fmt: skip
            np.testing.assert_allclose(torques, nominal, **close)


def test_lyapunov_function_falls_as_s_K_D_s() -> None:
    """V' = -s'K_D s, to the first order in the period, with V of the loaded robot.

    The load lies on the tray, a constant torque is on every joint that the law does not know.
    """
    period = 1e-4
    control, plant = adaptive(task(), 5.0, 0.2).sampled(period), loaded("tray", period)
    # A torque about the base's own axis is one on its joint alone.
    pushes = [Disturbance("base", (0.0, 0.0, 0.0, 0.0, 0.0, 0.5))]
    theta = np.array([*added("tray"), -0.5, 0.0, 0.0])
    reference = np.array(task().outputs.reference(0.0, task().reference))
    start = np.append(reference[::3] + 0.1, np.zeros(N))
    run = simulate(plant, control, start, duration=0.5, disturbances=pushes)
    s, off = run.memory["composite"], np.roll(run.memory["theta"], 1, axis=0)
    off[0] = 0.0
    model, M, data = plant.model, np.zeros((N, N)), mujoco.MjData(plant.model)
    V = np.sum((off - theta) ** 2, axis=1) / (2 * control.parameters.adaptation)
    for k in range(len(V)):
        data.qpos[:] = run.state[k, :N]
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, M)
        V[k] += s[k] @ M @ s[k] / 2
    fall = np.einsum("ki,ij,kj->k", s, control.parameters.damping, s)
    assert V[-1] < 0.9 * V[0]
    np.testing.assert_allclose(np.diff(V) / period, -fall[:-1], atol=0.02 * fall.max())


def test_estimates_hold_while_an_input_is_beyond_its_limit() -> None:
    start, law = np.array([0.5, 0.5, 0.0, 0.0, 0.0, 0.0]), adaptive(task(), 5.0, 2.0, 1e-3)
    assert not simulate(loaded("tray"), law, start, duration=0.02).memory["theta"].any()


FILE = """
[plant]
model = "tree.xml"
[run]
start = { turn = "0.2 rad" }
duration = "0.1 s"
[task]
Q = [100, 0, 100, 0, 100, 0]
R = 1
reference = ["0.1*sin(t)", "0.2", "0.1"]
"""


def experiment(folder: Path, *numbers: str) -> Experiment:
    """Laws that differ in a number, or have one more."""
    law = '[[controller]]\nname = "{}"\nlaw = "adaptive"\nfrequency = 5\nadaptation = 5\n{}\n'
    laws = "".join(law.format(i, number) for i, number in enumerate(numbers))
    (folder / "tree.xml").write_text(UNLIMITED, encoding="utf-8")
    (folder / "mine.toml").write_text(FILE + laws, encoding="utf-8")
    return Experiment.load(folder / "mine.toml")


def test_a_file_may_name_the_body(tmp_path: Path) -> None:
    """One that does not move against the other is the same choice; the default is the last."""
    case = experiment(tmp_path, "", 'body = "tray"', 'body = "tool"', 'body = "boom"')
    default, tray, tool, boom = (case.law("physics", name).law for name in case.controllers)
    assert default is tray
    assert default is not tool is boom
    for numbers, words in (
        ('body = "tol"', "unknown body 'tol': did you mean 'tool'"),
        ('body = "stand"', "unknown body 'stand'"),
        ("body = 3", "body = 3 must be a name"),
        ("limit = -1", "limit = -1 must be positive"),
    ):
        with pytest.raises(ArgumentError, match=words):
            experiment(tmp_path, numbers)
