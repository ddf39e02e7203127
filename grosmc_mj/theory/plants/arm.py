"""The 1-DOF arm of section 4.3: eq. (57)."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import sympy as sp

from grosmc_mj.ground.errors import ModelError
from grosmc_mj.ground.fields import Finite, Range, checked
from grosmc_mj.theory.plants.equations import Equations
from grosmc_mj.theory.plants.parametrization import LinearParametrization
from grosmc_mj.theory.plants.system import (
    Model,
    Signal,
    System,
    Variant,
    require_unmodelled_absent,
    wrench_symbols,
)


@checked(ModelError, label="arm")
class ArmParameters:
    """Numbers of eq. (57), with M(q) = J + m l^2 + M_c (1 + sin q).

    The nominal model has J + m l^2 = 0.04 and M_c = 0.06 kg m^2, which is the chapter's
    M(q) = 0.1 + 0.06 sin q.

    Attributes:
        m: Payload at the end of the link [kg].
        l: Length of the link [m].
        g: Gravity [m/s^2].
        J: Inertia at the joint that no edit of the link changes [kg m^2].
        M_c: Inertia A r^2/2 that the cable reflects to the joint [kg m^2].
        printed: 1 for C(q, q') = 0.03 cos q as printed, 0 for the energy-true
            C = 0.03 cos(q) q'.
    """

    m: Annotated[float, Range(0, unit="kg", above=True)]
    l: Annotated[float, Range(0, unit="m", above=True)]
    g: Annotated[float, Range(0, unit="m/s^2", above=True)]
    J: Annotated[float, Range(0, unit="kg m^2", above=True)]
    M_c: Annotated[float, Range(0, unit="kg m^2")]
    printed: Finite = 0.0

    @classmethod
    def from_model(cls, model: Model, variant: Variant) -> ArmParameters:
        """Read m, l, g, J and M_c back from a compiled model.

        Raises:
            ModelError: If the payload is not on the link's x axis, the drum is not above the
                joint at the eyelet's radius, or the model has what eq. (57) has no term for.
        """
        require_unmodelled_absent("arm", model, ("joint",), "torque")
        link = model.body("link")
        hub = model.body("hub")
        eyelet = model.site("eyelet").pos
        drum = model.site("drum").pos - hub.pos
        r = float(eyelet[0])
        if np.any(link.ipos[1:]) or np.any(link.pos):
            raise ModelError("arm: the payload must lie on the x axis of a link at the joint")
        if np.any(eyelet[1:]) or not np.allclose(drum, [0, 0, r], rtol=0, atol=1e-12):
            raise ModelError(
                f"arm: the eyelet {eyelet} and the drum {drum} must be at the same radius, one "
                "along the link and one above the joint, or M(q) is not 0.1 + 0.06 sin q"
            )

        armature = model.dof_armature[model.joint("joint").dofadr[0]]
        cable = model.tendon("cable").id
        return cls(
            m=float(link.mass[0]),
            l=float(link.ipos[0]),
            g=float(-model.opt.gravity[2]),
            J=float(armature + hub.inertia[1] + link.inertia[1]),
            M_c=float(model.tendon_armature[cable]) * r * r / 2,
            printed=float(variant == "printed"),
        )


def _dynamics() -> tuple[Equations, LinearParametrization]:
    """Eq. (57), x = [q, q'] with q = 0 horizontal, solved for the acceleration and in torques."""
    q, rate, r, a, m, l, g, J, M_c, printed = sp.symbols("q rate r a m l g J M_c printed")
    s = sp.sin(q)
    c = sp.cos(q)
    M = J + m * l**2 + M_c * (1 + s)
    # C over M_c: M'(q)/2 as printed; energy needs M'(q) q'/2.
    C = c / 2 * (printed + (1 - printed) * rate)

    # The joint is along -y, and the payload at (l cos q, l sin q) from it in the x-z plane; the
    # hub's centre of mass is on the axis. The chapter's d(t) is minus a torque about the joint.
    w = wrench_symbols("hub", "link")
    about = l * (c * w[8] - s * w[6]) - w[4] - w[10]

    equations = Equations(
        x=(q, rate),
        f=(rate, -(M_c * C * rate + m * g * l * c) / M),
        g=(0, 1 / M),
        h=(q,),
        w=w,
        d=(0, about / M),
        # The eyelet has reached the drum: the cable has length zero.
        breaks_down=sp.Or(q >= sp.pi / 2, q <= -3 * sp.pi / 2),
        # Wherever the plant is regular, since 1/M(q) > 0.
        region=sp.And(q < sp.pi / 2, q > -3 * sp.pi / 2),
    )

    # The inertia J + m l^2 + M_c, the sine's M_c, gravity's m g l and a load.
    parametrization = LinearParametrization(
        x=(q, rate),
        r=(r,),
        a=(a,),
        Y=((a, s * a + C * r, c, 1),),
        theta=(J + m * l**2 + M_c, M_c, m * g * l, 0),
    )
    return equations, parametrization


_EQUATIONS, _PARAMETRIZATION = _dynamics()
ARM = System(
    name="arm",
    title="1-DOF arm",
    states=(Signal("joint angle", "q", "rad"), Signal("joint rate", "q̇", "rad/s")),
    inputs=(Signal("torque", "τ", "N m"),),
    equations=_EQUATIONS,
    region="q < pi/2",
    singularity="q >= pi/2, where the cable has length zero",
    joints=("joint",),
    actuators=("torque",),
    bodies=("hub", "link"),
    variants=("printed", "corrected"),
    read_parameters=ArmParameters.from_model,
    uncertain_body="link",
    position_bound=1.5,  # rad; off the singularity at pi/2
    parametrization=_PARAMETRIZATION,
)
