"""A robot from its MJCF alone: MuJoCo's own dynamics as the nominal model of the laws."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import mujoco
from numpy.typing import ArrayLike

from grosmc_mj.ground.errors import ModelError, name_list
from grosmc_mj.mechanics.machine.voltage_input import VoltageInput, in_volts
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.mechanics.physics.files import body_names, compile_spec, joint_names, of_file
from grosmc_mj.mechanics.physics.hooks import warnings_ignored
from grosmc_mj.mechanics.physics.mujoco_plant import Integrator, MujocoPlant
from grosmc_mj.mechanics.robots.actuators import joint_unit
from grosmc_mj.mechanics.robots.coordinates import RobotCoordinates
from grosmc_mj.mechanics.robots.links import rigid_bodies
from grosmc_mj.mechanics.robots.model import robot_specs
from grosmc_mj.mechanics.robots.nominal import nominal_model
from grosmc_mj.mechanics.robots.rigid_bodies import RigidBodies
from grosmc_mj.theory.control.references import ReferenceFunction
from grosmc_mj.theory.control.task import Task
from grosmc_mj.theory.plants import AnalyticPlant, Signal, System

_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


@dataclass(frozen=True, eq=False)
class Robot:
    """A tree of n hinges and slides, all or some of which have an input of their own.

    Serial arms are such trees; branches do no harm, loops are refused. One with fewer torques than
    joints is underactuated: its laws are designed for its linearization, with a ``state_task``.

    Attributes:
        plant: The nominal robot in MuJoCo; ``plant.changed(...)`` makes the true one. The state
            is q, then q'; the inputs are torques at the driven joints, or voltages of their motors,
            in the order of the joints.
        notes: Changes of the model that was read and their reasons, in sentences.
        built: The robot as it is built, with effects that laws do not know of: lags, delays and
            couplings of joints; ``plant`` itself without such effects.
        gears: Of each motor of the model that was read, the torque for a command of 1; none of an
            input in volts.
        voltages: Inputs in volts, by the motors that laws know.
    """

    plant: MujocoPlant
    notes: tuple[str, ...]
    built: MujocoPlant
    gears: tuple[tuple[str, float], ...] = ()
    voltages: tuple[VoltageInput, ...] = ()

    @classmethod
    def from_mjcf(
        cls,
        model: Any,
        joints: Iterable[str] | None = None,
        actuators: Iterable[str] | None = None,
        timestep: float | None = None,
        integrator: Integrator | None = None,
    ) -> Robot:
        """Read a robot.

        Motors on joints are taken with their gear and limits; servos are replaced by torque control
        within their force range. Lags, delays and coupled joints are the plant's, see ``built``,
        and no law's. Anything else that drives a joint, or closes a loop, is refused.

        Args:
            model: A path, XML text, an MjSpec, or an MJCF element of dm_control.
            joints: The joints to move, in any order; all others are locked where the model has
                them. All by default.
            actuators: The actuators to use; all others are left out. All by default.
            timestep: Physics timestep [s]; None for the model's own.
            integrator: MuJoCo's integrator; None for the model's own.

        Raises:
            ModelError: If the model is no such robot, with the reason and what to do.
        """
        with warnings_ignored(), of_file(model):
            spec, built, notes, gears = robot_specs(model, joints, actuators)
        plant = MujocoPlant(_system(spec), spec, (), timestep, integrator)
        built_plant = plant if built is None else replace(plant, spec=built)
        return cls(plant, tuple(notes), built_plant, tuple(gears.items()))

    def with_known(self, edits: Iterable[Edit], voltages: Sequence[VoltageInput] = ()) -> Robot:
        """Return the robot with edits that its laws know, and with voltages of motors as inputs.

        Raises:
            ModelError: If the model cannot have an edit, or the input is no motor's.
        """
        for voltage in voltages:
            self._require_motor(voltage.input)
        system = in_volts(self.plant.system, voltages)
        every = (*edits, *voltages)
        plant = replace(self.plant, system=system).changed(*every, known=True)
        built = plant
        if self.built is not self.plant:
            built = replace(self.built, system=system).changed(*every, known=True)
        named = [voltage.input for voltage in voltages]
        gears = tuple(item for item in self.gears if item[0] not in named)
        # Notes on an input in volts speak of its torque.
        of_named = tuple(f"actuator {name!r}: " for name in named)
        notes = [note for note in self.notes if not note.startswith(of_named)]
        notes += [
            f"{own}its input is the voltage of its motor; its gear is in its limits"
            for own in of_named
        ]
        return replace(
            self,
            plant=plant,
            notes=tuple(notes),
            built=built,
            gears=gears,
            voltages=tuple(voltages),
        )

    def _require_motor(self, name: str) -> None:
        """Refuse a voltage for a servo, or for a motor with a negative gear in the MJCF.

        Raises:
            ModelError: With the remedy.
        """
        gears = dict(self.gears)
        if name not in gears:
            raise ModelError(
                f"motor of {name!r}: law_input = 'voltage' needs a <motor> in the MJCF: its "
                "actuator is a servo, with a loop of its own"
            )
        if gears[name] < 0:
            raise ModelError(
                f"motor of {name!r}: its gear in the MJCF is {gears[name]:g}; with law_input = "
                "'voltage' its ratio alone says which way a positive voltage turns the joint: make "
                "the gear positive, and the ratio negative if it turns it backwards"
            )

    @property
    def joints(self) -> int:
        """n, the number of joints."""
        return self.plant.system.degrees_of_freedom

    @property
    def underactuated(self) -> bool:
        """True if a joint has no torque of its own."""
        return len(self.plant.system.inputs) < self.joints

    @cached_property
    def nominal(self) -> mujoco.MjModel:
        """The dynamics that the laws know, as a model in MuJoCo."""
        return nominal_model(self.plant.spec)

    @cached_property
    def bodies(self) -> RigidBodies:
        """The dynamics that the laws know, as their numbers."""
        return rigid_bodies(self.nominal)

    @property
    def undriven(self) -> str:
        """Joints without a torque of their own, in words; empty for none."""
        system = self.plant.system
        if not self.underactuated:
            return ""
        joints = name_list(system.joints[index] for index in system.controlled)
        return f"no actuator drives {joints} ({len(system.inputs)} for {self.joints} joints)"

    def task(
        self,
        reference: ReferenceFunction,
        parameters: Any,
        Q: ArrayLike,
        R: ArrayLike,
    ) -> Task:
        """Task that ``tracking_grosmc`` and ``computed_torque_pd`` design for.

        Args:
            reference: y_r(t) of every joint with two derivatives, joint by joint.
            parameters: Its parameters.
            Q: Weight of z = [e_1, e_1', e_2, ...], (2 n, 2 n).
            R: Weight of v, the accelerations, (n, n) or a number.

        Raises:
            ModelError: If it is underactuated.
        """
        system = self.plant.system
        if self.underactuated:
            raise ModelError(
                f"{system.name} has {len(system.inputs)} torques for {self.joints} joints, so its "
                "joints cannot all be led: take a state_task"
            )
        nominal = AnalyticPlant(system, self.bodies)
        return Task(nominal, self.coordinates(reference), parameters, Q, R)

    def coordinates(self, reference: ReferenceFunction) -> RobotCoordinates:
        """Errors of all joints from a reference."""
        return _coordinates(self, reference)


# Made once for a reference, so that its laws are compiled once.
@cache
def _coordinates(robot: Robot, reference: ReferenceFunction) -> RobotCoordinates:
    """Errors of all joints from a reference."""
    return RobotCoordinates(robot.plant.system, reference, model=robot.nominal)


def _system(spec: mujoco.MjSpec) -> System:
    """Read names and signals of a robot from its model."""
    model = compile_spec(spec)
    name = spec.modelname or "robot"
    joints = joint_names(model)
    actuators = tuple(model.actuator(i).name for i in range(model.nu))
    # Index of the joint of each actuator.
    driven = tuple(int(row[0]) for row in model.actuator_trnid)
    undriven = tuple(i for i in range(model.njnt) if i not in driven)

    positions: list[Signal] = []
    rates: list[Signal] = []
    for index, joint in enumerate(joints):
        number = _subscript(index + 1)
        unit = "m" if joint_unit(model, index) == "N" else "rad"
        positions.append(Signal(joint, f"q{number}", unit))
        rates.append(Signal(f"{joint} rate", f"q̇{number}", f"{unit}/s"))

    inputs: list[Signal] = []
    for actuator, index in zip(actuators, driven, strict=True):
        inputs.append(Signal(actuator, f"τ{_subscript(index + 1)}", joint_unit(model, index)))

    return System(
        name=name,
        title=name,
        states=(*positions, *rates),
        inputs=tuple(inputs),
        equations=None,
        # A law has to hold the joints without an actuator through the others.
        controlled=undriven or driven,
        joints=joints,
        actuators=actuators,
        bodies=body_names(model),
    )


def _subscript(number: int) -> str:
    """A number in subscript digits."""
    return str(number).translate(_SUBSCRIPTS)
