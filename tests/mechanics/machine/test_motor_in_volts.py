"""A motor by its datasheet in a case of one's own, under a law whose gains are in volts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cases
import control
import numpy as np
import pytest

# The wheel has m r^2 / 2 = 0.01 kg m^2.
ROTOR = """<mujoco model="rotor"><option timestep="0.0001" integrator="RK4"/>
<worldbody><body name="wheel"><joint name="shaft" axis="0 0 1" damping="0.02"/>
<geom type="cylinder" size="0.05 0.01" mass="8"/></body></worldbody>
<actuator><motor name="motor" joint="shaft"/></actuator></mujoco>"""
WHEEL, DAMPING = 0.01, 0.02
PERIOD, FILTER = 2e-3, 10e-3
# Gains in V/rad, V/(rad s) and V s/rad.
IN_VOLTS = (30.0, 40.0, 2.0)


@pytest.mark.parametrize(("ratio", "inductance"), [(20.0, 0.0), (-20.0, 4e-3)])
def test_gains_in_volts_times_the_torque_of_a_volt_are_those_of_the_closed_form(
    tmp_path: Path, ratio: float, inductance: float
) -> None:
    """J q'' = n K i - b q', L i' = V - R i - n K q', with V from a sampled PID of the angle."""
    K, R, rotor = 0.05, 2.0, 5e-6
    kp, ki, kd = (gain * K * abs(ratio) / R for gain in IN_VOLTS)
    (tmp_path / "rotor.xml").write_text(ROTOR, encoding="utf-8")
    motor = {
        "constant": f"{K} N m/A",
        "resistance": f"{R} ohm",
        "inductance": f"{inductance} H",
        "inertia": f"{rotor} kg m^2",
    }
    case = cases.case(
        "rotor.xml",
        folder=tmp_path,
        run={"duration": "0.3 s", "timestep": "0.1 ms", "control_period": f"{PERIOD} s"},
        motor={"input": "motor", "ratio": ratio, **motor},
        task={"reference": ["1"]},
        controller={"law": "pid", "kp": kp, "ki": ki, "kd": kd, "filter": f"{FILTER} s"},
    )
    coarse = case.run().trajectory.state[::20, 0]
    fine = case.changed({"run.timestep": "0.05 ms"}).run().trajectory.state[::40, 0]

    s: Any = control.tf("s")
    n = abs(ratio)
    J = WHEEL + n**2 * rotor
    plant: Any = n * K / (s * ((J * s + DAMPING) * (inductance * s + R) + (n * K) ** 2))
    kp, ki, kd = IN_VOLTS
    law: Any = control.tf([kp, ki * PERIOD - kp], [1, -1], PERIOD)
    law += control.tf([kd, -kd], [FILTER + PERIOD, -FILTER], PERIOD)
    loop = control.feedback(law * control.sample_system(plant, PERIOD, "zoh"), 1)
    expected = control.step_response(loop, np.arange(len(coarse)) * PERIOD).outputs
    # MuJoCo's current is of first order in the timestep: its error falls by half.
    np.testing.assert_allclose(2 * fine - coarse, expected, atol=2e-4)
