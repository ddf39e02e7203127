"""What every table of a case file is made of: numbers with units, and no keys but its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from grosmc_mj.errors import Mistakes
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


def numbers_of(
    table: Table, names: Iterable[str], unit_of: Callable[[str], str]
) -> dict[str, float]:
    """The numbers that a table gives.

    Args:
        table: With a value, or None, for each name.
        names: Of the numbers.
        unit_of: The unit of a number, by its name.

    Raises:
        ArgumentError: All that do not fit.
    """
    found, mistakes = {}, Mistakes()
    for name in names:
        if (value := getattr(table, name)) is None:
            continue
        with mistakes.gathered():
            unit = unit_of(name)
            with mistakes.gathered(f"{name}: "):
                found[name] = number_in(value, unit)
    mistakes.refuse()
    return found
