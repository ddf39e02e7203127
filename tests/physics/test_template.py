"""Edits written into a compiled model: the same model as a compiler makes, or none."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grosmc_mj.errors import ModelError
from grosmc_mj.physics.edits import AddedMass, BodyEdit, Edit, InputEdit, JointEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SYSTEMS
from grosmc_mj.simulation.steppers import Steppers

NAMES = [name for name in SYSTEMS if name in ("servo", "cart_pendulum", "arm", "two_link_arm")]
SCALES = st.floats(0.1, 10.0)


def differences(one: mujoco.MjModel, other: mujoco.MjModel) -> list[str]:
    """Names of the arrays in which two models differ."""
    found = []
    for name in dir(one):
        a = getattr(one, name) if not name.startswith("_") else None
        if isinstance(a, np.ndarray) and not np.array_equal(
            a, getattr(other, name), equal_nan=a.dtype.kind == "f"
        ):
            found.append(name)
    return found


def numbers(plant: MujocoPlant) -> Any:
    """What its equations are made with, or why it has none."""
    try:
        return plant.analytic().parameters
    except ModelError as error:
        return str(error)


@st.composite
def families(draw: Any) -> list[MujocoPlant]:
    """Plants of one system, edited at random."""
    nominal = MujocoPlant.load(draw(st.sampled_from(NAMES)))
    model = nominal.model
    bodies = [model.body(i).name for i in range(1, model.nbody) if model.body_mass[i] > 0]
    inputs = [model.actuator(i).name for i in range(model.nu)]
    plants = []
    for _ in range(draw(st.integers(2, 4))):
        edits: list[Edit] = [
            BodyEdit(name, draw(SCALES), draw(SCALES))
            for name in draw(st.lists(st.sampled_from(bodies), unique=True))
        ]
        if draw(st.booleans()):
            edits.append(InputEdit(inputs[0], draw(SCALES)))
        plants.append(nominal.edited(*edits))
    return plants


def as_run(plants: list[MujocoPlant]) -> Iterator[mujoco.MjModel]:
    """What one thread's runs of these plants compute with, one after the other."""
    steppers = Steppers(1e-3)
    return (steppers.of(plant).model for plant in plants)


@settings(max_examples=40)
@given(families())
def test_a_written_model_is_the_compiled_one_bit_for_bit(plants: list[MujocoPlant]) -> None:
    """Whatever has been written into it before."""
    plants = [*plants, plants[0]]
    for plant, model in zip(plants, as_run(plants), strict=True):
        compiled = plant.edited(*plant.edits).undrawn_model
        assert differences(model, compiled) == []
        # Read before anything is compiled, and afterwards.
        again = plant.edited(*plant.edits)
        before = numbers(again)
        assert again.undrawn_model is not None
        assert numbers(again) == before
        written = plant.template.written(plant.edits)
        assert written is not None
        assert differences(written, compiled) == []


def test_a_family_is_compiled_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its runs share one mjModel and one mjData."""
    nominal = MujocoPlant.load("cart_pendulum")
    assert nominal.template is nominal.edited().template
    plants = [nominal.edited(BodyEdit("pole", scale, scale)) for scale in (0.5, 1.5, 2.0)]
    monkeypatch.setattr(MujocoPlant, "_compiled", lambda *_: pytest.fail("compiled"))
    steppers, used = Steppers(1e-3), set[int]()
    for plant, mass in zip(plants, (0.1, 0.3, 0.4), strict=True):
        stepper = steppers.of(plant)
        assert stepper.model.body("pole").mass[0] == pytest.approx(mass, rel=1e-12)
        used.add(stepper.data._address)
    assert len(used) == 1


PLAIN = MujocoPlant.load("cart_pendulum")


def with_a_massless_body() -> MujocoPlant:
    """The pendulum with a body that weighs nothing."""
    spec = PLAIN.spec.copy()
    spec.body("pole").add_body(name="mount")
    return MujocoPlant(PLAIN.system, spec)


def with_a_geom_that_is_sensed() -> MujocoPlant:
    """The pendulum with a sensor of its rod, which so is no mere look."""
    spec = PLAIN.spec.copy()
    spec.add_sensor(
        name="seen", type=mujoco.mjtSensor.mjSENS_FRAMEPOS,
        objtype=mujoco.mjtObj.mjOBJ_GEOM, objname="rod",
    )  # fmt: skip
    return MujocoPlant(PLAIN.system, spec)


MASSLESS, SENSED = with_a_massless_body(), with_a_geom_that_is_sensed()


@pytest.mark.parametrize(
    ("plant", "edits"),
    [
        (SENSED, (BodyEdit("pole", 1.0, 2.0),)),
        (PLAIN, (JointEdit("hinge", damping=1.0),)),
        (PLAIN, (AddedMass("pole", 0.1),)),
        (PLAIN, (BodyEdit("pole", 2.0), BodyEdit("pole", 3.0))),
        (PLAIN, (BodyEdit("nobody", 2.0),)),
        (MASSLESS, (BodyEdit("mount", 2.0),)),
        (PLAIN, (InputEdit("nothing", 2.0),)),
        (PLAIN, (BodyEdit("pole", 1e-300),)),
        (PLAIN, (BodyEdit("pole", 1e200, 1e200),)),
    ],
    ids=lambda value: None if isinstance(value, MujocoPlant) else str(value[0]),
)
def test_what_only_a_compiler_can_tell_is_left_to_it(
    plant: MujocoPlant, edits: tuple[Edit, ...]
) -> None:
    template = plant.template
    assert template.changes(edits) is None
    assert template.written(edits) is None


@pytest.mark.parametrize("numbers", [{"frictionloss": 0.1}, {"range": [-1.0, 1.0]}], ids=str)
def test_a_model_with_constraints_is_compiled(numbers: dict[str, Any]) -> None:
    """They are solved by a mean inertia that a compiler alone computes."""
    spec = PLAIN.spec.copy()
    joint = spec.joints[1]
    for name, value in numbers.items():
        setattr(joint, name, value)
    joint.limited = int("range" in numbers)
    plant = MujocoPlant(PLAIN.system, spec)
    assert plant.template.changes((BodyEdit("pole", 2.0),)) is None
