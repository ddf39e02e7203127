"""What every table of a case file is made of: numbers with units, and no keys but its own."""

from __future__ import annotations

from functools import partial
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from grosmc_mj.experiments.file.units import number_in

Seconds = Annotated[float, BeforeValidator(partial(number_in, unit="s"))]
Kilograms = Annotated[float, BeforeValidator(partial(number_in, unit="kg"))]
Metres = Annotated[float, BeforeValidator(partial(number_in, unit="m"))]
Newtons = Annotated[float, BeforeValidator(partial(number_in, unit="N"))]
NewtonMetres = Annotated[float, BeforeValidator(partial(number_in, unit="N m"))]
Radians = Annotated[float, BeforeValidator(partial(number_in, unit="rad"))]
RadiansPerSecond = Annotated[float, BeforeValidator(partial(number_in, unit="rad/s"))]
Three = Field(min_length=3, max_length=3)


class Table(BaseModel):
    """A table of a case file: no other keys, no conversions between types."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
