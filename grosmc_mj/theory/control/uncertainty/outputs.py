"""Uncertainty that a law of outputs must withstand, over a region of their errors."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import PlainValidator

from grosmc_mj.ground.arguments import reals
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import GainError
from grosmc_mj.ground.fields import Positive, Reals, checked
from grosmc_mj.ground.refusals import refusal
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.reaching import NominalLaw, Reaching, matrix_vector, nominal_law
from grosmc_mj.theory.control.uncertainty.family import PlantFamily, Scales
from grosmc_mj.theory.plants import Plant

# Points of the grids over which the suprema are taken; both include every corner. The number of
# states is for all axes together.
_SCALES = 5
_STATES = 441
# A step from z = 0 at which the mismatch is linear: its square is below rounding of the gains.
_NEAR = 1e-4


def _region(value: Any) -> tuple[float, ...]:
    """Bounds of the error state."""
    bounds = reals(value)
    if bounds.ndim != 1 or not np.all((bounds > 0) & (bounds < math.inf)):
        raise refusal("finite and positive bounds")
    return tuple(bounds.tolist())


def _wrench(value: Any) -> tuple[float, ...]:
    """Magnitudes of disturbance components."""
    magnitudes = Reals((None,))(value)
    return tuple(magnitudes.tolist())


Region = Annotated[tuple[float, ...], PlainValidator(_region)]
Wrench = Annotated[tuple[float, ...], PlainValidator(_wrench)]


@checked()
class Uncertainty(PlantFamily):
    """Uncertainty that a switching law of outputs must withstand.

    Its gains hold over a grid of the scales and of the region, with all their corners, and over
    all directions next to z = 0.

    Attributes:
        scales: Range of the true value of a parameter over its nominal one, by its name.
        wrench: Largest magnitude of each disturbance component, [force, torque] in N and N m
            of each body of the system.
        region: Largest |z1|, |z2| ... of the error state.
        reaching_rate: The eta of eqs. (14) and (39) that the true plant shall keep: the rate of
            |s|, in the unit of s per second.
    """

    scales: Scales
    wrench: Wrench
    region: Region
    reaching_rate: Positive

    def scales_within(self, low: float, high: float) -> Sequence[float]:
        """Equidistant scales of a range."""
        # As Python's floats, which equations are evaluated in.
        return np.linspace(low, high, _SCALES).tolist()

    def law_at_states(self, law: Controller) -> NominalLaw:
        """The law at z = 0, at a step along each axis next to it, and on a grid of the region.

        Raises:
            GainError: If the uncertainty is one of another system, or the reference moves, for
                which the gains have no room.
        """
        error: Any = law.designed.error
        self._require_fitting(error)

        z = self._error_states(error.size)
        x = np.array([error.place(0.0, state, law.parameters) for state in z])
        return nominal_law(law, [0.0] * len(z), x, z)

    def reaching(
        self, law: Controller, by_model: NominalLaw, member: Plant
    ) -> tuple[Reaching, Array]:
        """Reaching condition by the member's equations; |G d| is the sum over the wrench."""
        error: Any = law.designed.error
        p = law.parameters
        x = by_model.x
        reaching = by_model.reaching(error.error_dynamics(by_model.t, x, p, member))

        disturbed = np.zeros_like(by_model.v_0)
        for component in np.diag(self.wrench):
            if component.any():
                w = np.tile(component, (len(x), 1))
                dz = error.disturbances(x, p, member, w)
                disturbed += np.abs(matrix_vector(by_model.G, dz))
        return reaching, disturbed

    def description(self, plant: Plant) -> str:
        """The declared family, in words."""
        ranges = ", ".join(self._ranges()) or "no variation"
        magnitudes = ", ".join(f"{size:.3g}" for size in self.wrench if size) or "0"
        bounds = ", ".join(f"|z{i}| <= {bound:.3g}" for i, bound in enumerate(self.region, 1))
        return (
            f"{ranges}; wrench up to {magnitudes} N or N m; {bounds}; "
            f"reaching rate {self.reaching_rate:g}"
        )

    def _error_states(self, size: int) -> Array:
        """z = 0, a step along each axis next to it, and the grid of the region, (N, size)."""
        # An odd number of points, so that the axes are in the grid.
        points = round(_STATES ** (1 / size)) // 2 * 2 + 1
        axes = [np.linspace(-bound, bound, points) for bound in self.region]
        grid = [state for state in itertools.product(*axes) if any(state)]
        steps = _NEAR * np.eye(size)
        return np.array([np.zeros(size), *steps, *grid])

    def _require_fitting(self, error: Any) -> None:
        """Refuse an uncertainty of another system, and a reference that moves."""
        name = error.system.name
        _require_count(name, "bounds of the operating region", self.region, error.size)
        _require_count(
            name, "wrench components", self.wrench, len(error.system.symbolic_equations.w)
        )

        if getattr(error.reference, "moves", False):
            raise GainError(
                f"{name}: the reference moves: a bound in |z| cannot cover that; give k and "
                "epsilon instead"
            )


def _require_count(
    name: str,
    noun: str,
    values: Sequence[float],
    count: int,
) -> None:
    """Refuse values of which there must be another number."""
    if len(values) != count:
        raise GainError(f"{name}: the uncertainty has {len(values)} {noun}, must have {count}")
