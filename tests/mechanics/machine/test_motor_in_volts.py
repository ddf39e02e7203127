"""A motor by its datasheet in a case of one's own, under laws whose input is its voltage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cases
import control
import numpy as np
import pytest
from own_files import LEG

from grosmc_mj.experiments.assumptions.robot import audits
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.reading import case_file_of
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import GrosmcError

# The wheel has m r^2 / 2 = 0.01 kg m^2.
ROTOR = """<mujoco model="rotor"><option timestep="0.0001" integrator="RK4"/>
<worldbody><body name="wheel"><joint name="shaft" axis="0 0 1" damping="0.02"/>
<geom type="cylinder" size="0.05 0.01" mass="8"/></body></worldbody>
<actuator><motor name="motor" joint="shaft"/></actuator></mujoco>"""
WHEEL, DAMPING = 0.01, 0.02
K, R, INERTIA = 0.05, 2.0, 5e-6
MOTOR = {
    "input": "motor",
    "constant": f"{K} N m/A",
    "resistance": f"{R} ohm",
    "inertia": f"{INERTIA} kg m^2",
}
VOLTS = {**MOTOR, "law_input": "voltage"}
PERIOD, FILTER = 2e-3, 10e-3
# Gains in V/rad, V/(rad s) and V s/rad.
IN_VOLTS = np.array([30.0, 40.0, 2.0])


def rotor(folder: Path, motor: Any, model: str = ROTOR, **tables: Any) -> Experiment:
    """A case of the rotor with a motor, at rest at 0 rad and to be led to 1 rad."""
    (folder / "rotor.xml").write_text(model, encoding="utf-8")
    run = {"duration": "0.3 s", "timestep": "0.1 ms", "control_period": f"{PERIOD} s"}
    task = {"reference": ["1"], "Q": [4e4, 400], "R": 1}
    return cases.case(
        "rotor.xml", folder=folder, **{"run": run, "task": task} | tables, motor=motor
    )


def pid(gains: Array) -> dict[str, Any]:
    """A PID with a filtered rate, and gains of the input over the angle."""
    kp, ki, kd = gains.tolist()
    return {"law": "pid", "kp": kp, "ki": ki, "kd": kd, "filter": f"{FILTER} s"}


def closed_form(ratio: float, inductance: float, samples: int) -> Array:
    """J q'' = n K i - b q', L i' = V - R i - n K q', with V from the sampled PID of the angle."""
    s: Any = control.tf("s")
    n = abs(ratio)
    J = WHEEL + n**2 * INERTIA
    plant: Any = n * K / (s * ((J * s + DAMPING) * (inductance * s + R) + (n * K) ** 2))
    kp, ki, kd = IN_VOLTS
    law: Any = control.tf([kp, ki * PERIOD - kp], [1, -1], PERIOD)
    law += control.tf([kd, -kd], [FILTER + PERIOD, -FILTER], PERIOD)
    loop = control.feedback(law * control.sample_system(plant, PERIOD, "zoh"), 1)
    return control.step_response(loop, np.arange(samples) * PERIOD).outputs


@pytest.mark.parametrize(
    ("ratio", "law_input", "torque"),
    [(20.0, "torque", K * 20 / R), (-20.0, "torque", K * 20 / R), (20.0, "voltage", 1.0)],
)
def test_gains_in_volts_are_those_of_the_closed_form(
    tmp_path: Path, ratio: float, law_input: str, torque: float
) -> None:
    """As they are where the law's input is the voltage, else times the torque of a volt."""
    motor = MOTOR | {"ratio": ratio, "law_input": law_input}
    case = rotor(tmp_path, motor, controller=pid(IN_VOLTS * torque))
    q = case.run().trajectory.state[::20, 0]
    np.testing.assert_allclose(q, closed_form(ratio, 0.0, len(q)), atol=1e-8)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_positive_voltage_turns_the_joint_by_the_sign_of_the_ratio(
    tmp_path: Path, sign: int
) -> None:
    """Through an inductance, which the closed form has, too."""
    motor = VOLTS | {"ratio": 20.0 * sign, "inductance": "4 mH"}
    case = rotor(tmp_path, motor, controller=pid(IN_VOLTS * sign))
    coarse = case.run().trajectory.state[::20, 0]
    fine = case.changed({"run.timestep": "0.05 ms"}).run().trajectory.state[::40, 0]
    # MuJoCo's current is of first order in the timestep: its error falls by half.
    expected = closed_form(20.0, 4e-3, len(coarse))
    np.testing.assert_allclose(2 * fine - coarse, expected, atol=2e-4)


def test_the_inputs_limits_are_those_of_the_model_and_the_supply_in_volts(tmp_path: Path) -> None:
    limited = ROTOR.replace("<motor", '<motor ctrlrange="-40 30"')
    case = rotor(tmp_path, VOLTS | {"ratio": -20.0, "efficiency": 0.8, "voltage": "80 V"}, limited)
    (signal,) = case.nominal.system.inputs
    assert signal.unit == "V"
    # -40 to 30 N m, with -0.4 N m for 1 V at rest.
    np.testing.assert_allclose(case.nominal.plant.input_limits[:, 0], [-75, 100])
    np.testing.assert_allclose(case.input_limits(case.plant("physics"))[:, 0], [-75, 80])


def leg(folder: Path, *motors: dict[str, Any], **tables: Any) -> Experiment:
    """A leg with a motor on each joint, whose laws know that of the hip by its voltage."""
    model = LEG.replace("<position", "<motor").replace('kp="50"', "")
    model = model.replace('gear="10"', 'gear="10" ctrlrange="-6 6"')
    (folder / "leg.xml").write_text(model, encoding="utf-8")
    return cases.case(
        "leg.xml",
        folder=folder,
        run={"duration": "0.2 s", "timestep": "0.5 ms", "start": {"hip": "-60 deg"}},
        task={"Q": {"hip": 400, "knee": 400}, "R": 1, "reference": {"hip": "0.3", "knee": "-0.5"}},
        motor=list(motors),
        **tables,
    )


HIP = {
    "input": "hip",
    "constant": "0.03 N m/A",
    "resistance": "0.7 ohm",
    "ratio": -60.0,
    "efficiency": 0.7,
    "inertia": "8e-6 kg m^2",
    "law_input": "voltage",
}


@pytest.mark.parametrize("added", [True, False])
def test_the_computed_voltage_gives_each_joint_the_acceleration_of_the_design(
    tmp_path: Path, *, added: bool
) -> None:
    """The law knows the torque of a volt, the back-EMF and the rotor's inertia.

    They are beside the model's own damping and armature, or a part of them.
    """
    drive = {"joint": "hip", "damping": "4 N m s/rad", "armature": "0.2 kg m^2", "known": True}
    case = leg(tmp_path, HIP | {"added": added}, edit=drive, controller={"law": "lqr"})
    run = case.run().trajectory
    true = case.plant("physics")
    for x, u in zip(run.state[:-1:40], run.input[::40], strict=True):
        error = x[:2] - [0.3, -0.5]
        wanted = -np.sqrt(400) * error - np.sqrt(2 * np.sqrt(400)) * x[2:]
        np.testing.assert_allclose(true.derivative(x, u)[2:], wanted, rtol=1e-9)


def test_laws_know_the_motor_of_the_file_whatever_the_true_one_has(tmp_path: Path) -> None:
    case = leg(tmp_path, HIP)
    other = case.changed({"motor.hip.constant": "0.024 N m/A"})
    assert other.law("physics", "lqr") is case.law("physics", "lqr")
    written = case_file_of(other.file.content, other.path)
    gears = [
        experiment.law("physics", "lqr").parameters.plant.gear
        for experiment in (case, Experiment.of_file(written, other.path))
    ]
    np.testing.assert_allclose(gears, 2 * [[-0.7 * 0.03 * 60 / 0.7, 1]])


@pytest.mark.parametrize("added", [True, False])
def test_a_known_motor_is_what_laws_take_for_the_true_one(tmp_path: Path, *, added: bool) -> None:
    """Of a motor that is a part of the model's numbers they know no back-EMF twice."""
    known = {key: HIP[key] for key in ("input", "resistance", "ratio", "efficiency")}
    known["constant"] = "0.024 N m/A"
    drive = {"joint": "hip", "damping": "4 N m s/rad", "armature": "0.2 kg m^2", "known": True}
    case = leg(tmp_path, HIP | {"added": added}, edit=drive, known_motor=known)
    bodies = case.law("physics", "lqr").parameters.plant
    assert bodies.gear[0] == pytest.approx(-0.7 * 0.024 * 60 / 0.7)
    assert bodies.damping[0] == pytest.approx(4 + added * 0.7 * (0.024 * 60) ** 2 / 0.7)


def test_a_log_has_the_voltage_itself(tmp_path: Path) -> None:
    """The command of the MJCF's motor, with its gear of 10, is no torque any more."""
    assert dict(leg(tmp_path).nominal.gears) == {"hip": 10.0, "knee": 1.0}
    assert dict(leg(tmp_path, HIP).nominal.gears) == {"knee": 1.0}


def test_the_reference_takes_the_same_share_of_a_limit_in_volts_as_in_torque(
    tmp_path: Path,
) -> None:
    """At rest, where no back-EMF acts, and without a rotor, which laws of torques do not know."""
    margins = []
    for law_input in ("torque", "voltage"):
        motor = HIP | {"inertia": "0 kg m^2", "law_input": law_input}
        case = leg(tmp_path, motor, controller={"law": "grosmc", "k": 5, "epsilon": 2})
        (audit,) = audits([case.run()])
        (headroom,) = [item for item in audit.premises if item.name == "input headroom"]
        assert headroom.along is not None
        margins.append(headroom.along.margin)
    assert 0.2 < margins[0] < 0.9
    assert margins[0] == pytest.approx(margins[1], rel=1e-9)


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "a current loop": (
        {"motor": [VOLTS | {"bandwidth": "500 rad/s"}]},
        "law_input = 'voltage' is for a voltage amplifier: leave bandwidth out",
    ),
    "another law_input": (
        {"motor": [VOLTS | {"law_input": "volts"}]},
        "unknown law_input 'volts': did you mean 'voltage'",
    ),
    "a gear beside it": (
        {"motor": [VOLTS], "edit": {"input": "motor", "gear": 2}},
        "takes the place of its gear: edit constant, resistance or ratio",
    ),
    "a known gear beside it": (
        {"motor": [VOLTS], "edit": {"input": "motor", "gear": 2, "known": True}},
        "takes the place of its gear: leave out the edit",
    ),
    "a known motor without it": (
        {"motor": [MOTOR], "known_motor": MOTOR},
        "known_motor of 'motor': no [[motor]] of that input has law_input = 'voltage'",
    ),
    "two known motors": (
        {"motor": [VOLTS], "known_motor": [MOTOR, MOTOR]},
        "known_motor of 'motor': there are two: give one",
    ),
    "a number that no law knows": (
        {"motor": [VOLTS], "known_motor": MOTOR | {"inductance": "1 mH"}},
        "laws know no inductance: give constant, resistance, ratio, efficiency, inertia alone",
    ),
    "a wrong known number": (
        {"motor": [VOLTS], "known_motor": MOTOR | {"constant": "-1 N m/A"}},
        "known_motor of 'motor': ",
    ),
    "a wrong motor beside a known one": (
        {"motor": [VOLTS | {"constant": "-1 N m/A"}], "known_motor": MOTOR},
        "motor 1: motor of 'motor': constant = -1",
    ),
    "two motors": ({"motor": [VOLTS, VOLTS]}, "has two of the kind"),
}


@pytest.mark.parametrize(("tables", "words"), REFUSED.values(), ids=REFUSED)
def test_a_motor_in_volts_is_refused_with(
    tmp_path: Path, tables: dict[str, Any], words: str
) -> None:
    with pytest.raises(GrosmcError) as refused:
        rotor(tmp_path, **tables).run()
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("actuator", "words"),
    [
        ('<position kp="3"', "needs a <motor> in the MJCF: its actuator is a servo"),
        ('<motor gear="-2"', "make the gear positive, and the ratio negative"),
    ],
)
def test_an_actuator_without_a_voltage_is_refused(
    tmp_path: Path, actuator: str, words: str
) -> None:
    with pytest.raises(GrosmcError, match=words):
        rotor(tmp_path, VOLTS, ROTOR.replace("<motor", actuator))


def test_equations_have_an_input_of_their_own() -> None:
    with pytest.raises(GrosmcError, match="is for an MJCF of your own"):
        cases.case("servo", motor=VOLTS | {"input": "current"})
