"""Linear models of MuJoCo models by differences, against the equations of a mass by hand."""

from __future__ import annotations

import numpy as np

from grosmc_mj.mechanics.physics.edits import JointEdit
from grosmc_mj.mechanics.physics.linearization import differences
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant


def test_differences_of_a_damped_rotor_are_its_equations() -> None:
    """J w' = -b w + c u with J = 0.0577 kg m^2, b = 0.1 N m s/rad and c = 0.667 N m/A."""
    servo = MujocoPlant.load("servo", edits=(JointEdit("shaft", damping=0.1),))
    A, B = differences(servo, np.array([0.3, 2.0]), np.array([0.5]))
    np.testing.assert_allclose(A, [[0, 1], [0, -0.1 / 0.0577]], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(B, [[0], [0.667 / 0.0577]], rtol=1e-6, atol=1e-9)
