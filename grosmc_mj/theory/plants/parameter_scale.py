"""Factor on a parameter of a plant as equations."""

from __future__ import annotations

from typing import Annotated

from grosmc_mj.ground.fields import Name, Range, checked


@checked()
class ParameterScale:
    """Factor on a parameter of the true plant, which the laws do not know.

    Attributes:
        parameter: A parameter of a user's own analytic plant.
        scale: Factor on the parameter.
    """

    parameter: Name
    scale: Annotated[float, Range()]

    @property
    def of(self) -> str:
        """Name of the parameter."""
        return self.parameter
