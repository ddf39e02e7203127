"""Joints that a robot's model couples by equality constraints: the plant's, and no law's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import mujoco

from grosmc_mj.errors import ModelError


class Coupling(NamedTuple):
    """A constraint between two joints, or on one.

    Attributes:
        joints: Names of the joints that it is of.
    """

    joints: tuple[str, ...]

    def __str__(self) -> str:
        names = " and ".join(map(repr, self.joints))
        what = f"couples the joints {names}" if len(self.joints) > 1 else f"holds the joint {names}"
        return f"the plant {what} (equality), which no law knows: laws move each on its own"

    def require_driven(self, idle: Sequence[str]) -> None:
        """Refuse a joint that is moved by its coupling alone: without that it is another robot.

        Args:
            idle: Names of the joints that no actuator drives.

        Raises:
            ModelError: If it has one of them.
        """
        for name in self.joints:
            if name in idle:
                raise ModelError(
                    f"joint {name!r} is coupled (equality) and no actuator drives it: leave it out "
                    "of joints=..., which locks it, or give it an actuator"
                )


def kept_couplings(spec: mujoco.MjSpec, said: list[str]) -> tuple[Coupling, ...]:
    """The couplings of a model's joints; those that are off, or of joints that are not there, go.

    Args:
        spec: The model; what is left out is removed from it.
        said: What differs from the model as it was given; more is added.

    Raises:
        ModelError: If a constraint is none between joints.
    """
    joints, found = {joint.name for joint in spec.joints}, list[Coupling]()
    for equality in spec.equalities:
        kind = mujoco.mjtEq(equality.type).name.removeprefix("mjEQ_").lower()
        names = tuple(name for name in (equality.name1, equality.name2) if name)
        if not equality.active:
            spec.delete(equality)
        elif equality.type != mujoco.mjtEq.mjEQ_JOINT:
            raise ModelError(
                f"the model has equality constraints ({kind}): they close loops, and its torques "
                "are no function of q, q' and q'' alone; remove them, or couple joints"
            )
        elif set(names) <= joints:
            found.append(Coupling(names))
        else:
            spec.delete(equality)
            left = ", ".join(sorted({*names} - joints))
            said.append(f"left out: the coupling (equality) with {left}")
    return tuple(found)
