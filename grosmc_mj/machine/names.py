"""What parts of a machine are called in a model."""

from __future__ import annotations

import mujoco


def motor_joint(joint: str) -> str:
    """The coordinate, and the body, of a motor behind a transmission."""
    return f"{joint} motor"


def transmission_of(joint: str) -> str:
    """The tendon between them."""
    return f"{joint} transmission"


def driven_joint(spec: mujoco.MjSpec, name: str) -> str:
    """The joint that is driven through a motor's own coordinate, or a joint itself."""
    tendons = {tendon.name for tendon in spec.tendons}
    behind = {
        motor_joint(joint.name): joint.name
        for joint in spec.joints
        if transmission_of(joint.name) in tendons
    }
    return behind.get(name, name)
