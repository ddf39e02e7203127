"""Linear models of MuJoCo's plants against derivatives of the equations."""

from __future__ import annotations

import math

import numpy as np
import pytest

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.linearization import linearize
from grosmc_mj.physics.mujoco_plant import Integrator, MujocoPlant

# Central differences with a step of 6e-6 lose its square, 4e-11, times a third derivative over
# six, and 2e-16/6e-6 = 4e-11 to rounding; both over the largest entry. Measured with edits:
# 6e-12 (servo), 3e-11 (pendulum), 7e-11 (arm).
AGREEMENT = 1e-9
# Extrapolated differences of the equations are good to 1e-12 of the largest entry.
POLE = BodyEdit("pole", mass_scale=4.0, length_scale=4.0)
# The arm is held by the gravity torque m g l cos q = 0.098 cos q; edited, by 2 x 1.25 of it.
EQUILIBRIA = [
    ("servo", (), [0.0, 0.0], 0.0),
    ("servo", (BodyEdit("rotor", mass_scale=3.0),), [1.0, 0.0], 0.0),
    ("cart_pendulum", (), [0.0, 0.0, 0.0, 0.0], 0.0),
    ("cart_pendulum", (), [-3.0, math.pi, 0.0, 0.0], 0.0),
    ("cart_pendulum", (POLE,), [7.0, 0.0, 0.0, 0.0], 0.0),
    ("arm", (), [-math.pi / 2, 0.0], 0.0),
    ("arm", (), [0.5, 0.0], 0.098 * math.cos(0.5)),
    ("arm", (BodyEdit("link", 2.0, 1.25),), [1.2, 0.0], 0.245 * math.cos(1.2)),
]


def largest_error(found: tuple[Array, Array], expected: tuple[Array, Array]) -> float:
    """The largest difference in A or in B over the largest entry of each."""
    return max(
        float(np.abs(a - b).max() / np.abs(b).max()) for a, b in zip(found, expected, strict=True)
    )


@pytest.mark.parametrize(
    ("name", "edits", "x"),
    [
        *((name, edits, x) for name, edits, x, _ in EQUILIBRIA),
        ("two_link_arm", (), [0.6, -1.2, 0.0, 0.0]),
        ("two_link_arm", (), [-2.0, 2.5, 0.0, 0.0]),
        (
            "two_link_arm",
            (BodyEdit("upper", 1.0, 1.05), BodyEdit("payload", 5.0)),
            [1.0, -2.0, 0, 0],
        ),
    ],
)
def test_it_is_the_jacobian_in_symbols(
    name: str, edits: tuple[BodyEdit, ...], x: list[float]
) -> None:
    """Also with several inputs: u is what holds the plant there, f(x) + g(x) u = 0."""
    plant = MujocoPlant.load(name, edits=edits)
    twin, m = plant.analytic(), len(plant.system.inputs)
    drift = twin.derivative(x)
    g = np.reshape(plant.system.equations.input_matrix(np.array(x), twin.parameters), (len(x), m))
    u = -np.linalg.lstsq(g, drift)[0]
    np.testing.assert_allclose(drift + g @ u, 0, atol=1e-12)
    assert largest_error(linearize(plant, x, u), twin.jacobian(x, u)) < AGREEMENT


def test_the_upright_pendulum_is_eq_40_linearized() -> None:
    plant = MujocoPlant.load("cart_pendulum")
    A, B = linearize(plant)
    p = plant.analytic().parameters
    length, a = p.L * (4 / 3 - p.m / (p.M + p.m)), 1 / (p.M + p.m)
    expected = np.zeros((4, 4)), np.zeros((4, 1))
    expected[0][0, 2] = expected[0][1, 3] = 1.0
    expected[0][3, 1], expected[1][3, 0] = p.g / length, a / length
    # The cart is carried by the pole: (M + m) p'' = u + m L theta''.
    expected[0][2] = a * p.m * p.L * expected[0][3]
    expected[1][2] = a + a * p.m * p.L * expected[1][3]
    assert largest_error((A, B), expected) < AGREEMENT


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast"])
def test_integrator_and_timestep_do_not_matter(integrator: Integrator) -> None:
    # The servo has damping, in which three of the integrators are implicit.
    plant = MujocoPlant.load("servo", timestep=0.02, integrator=integrator)
    for found, expected in zip(linearize(plant), linearize(MujocoPlant.load("servo")), strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(
    ("x", "u", "message"),
    [
        ([0.0, 0.0], 0.0, r"cart_pendulum: x has shape \(2,\)"),
        ([0.0, math.nan, 0.0, 0.0], 0.0, "must be finite numbers"),
        (None, math.inf, "u = inf must be finite numbers"),
        (None, 1.0, r"1\.0\] is no equilibrium: x' = \[0\.0, 0\.0, 0\.952\d*, 1\.42"),
        ([0.0, 0.0, 0.2, 0.0], 0.0, "is no equilibrium"),
    ],
)
def test_what_is_no_equilibrium_is_refused(x: object, u: object, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        linearize(MujocoPlant.load("cart_pendulum"), x, u)  # pyright: ignore[reportArgumentType]
