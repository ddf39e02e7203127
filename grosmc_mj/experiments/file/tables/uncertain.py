"""What a case file may say of numbers that are not known: ranges, distributions, correlations."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, create_model, model_validator

from grosmc_mj.arguments import require_known
from grosmc_mj.errors import shown, unknown_name
from grosmc_mj.experiments.file.tables.parts import LOOP_UNITS, MACHINE_UNITS
from grosmc_mj.experiments.file.tables.table import Metres, Table, Three

# What may be uncertain, by what it belongs to, with the unit of its values; states and the parts of
# a loop have their own, and those of a joint are written without one, as in [[edit]].
QUANTITIES: dict[str, dict[str, str]] = {
    "body": {"mass_scale": "", "length_scale": "", "added_mass": "kg"},
    "joint": {"damping": "", "friction": "", "armature": ""},
    "disturbance": {"amplitude": "", "frequency": "rad/s", "phase": "rad", "onset": "s"},
    "start": {"value": ""},
    "parameter": {"scale": ""},
    **{owner: dict.fromkeys(numbers, "") for owner, numbers in LOOP_UNITS.items()},
    **{owner: dict.fromkeys(numbers, "") for owner, numbers in MACHINE_UNITS.items()},
}
_KINDS = ("uniform", "loguniform", "triangular", "normal", "lognormal")


class DistributionTable(Table):
    """A distribution and its numbers, each with the unit of the quantity.

    Attributes:
        distribution: ``uniform`` and ``loguniform`` from ``least`` to ``most``; ``triangular`` with
            its top at ``mode``; ``normal`` with ``mean`` and ``deviation``; ``lognormal`` with
            ``median`` and ``spread``, the standard deviation of its logarithm. The last two are cut
            off at ``least`` and ``most``, where given.
        least: Smallest value.
        most: Largest value.
        mode: Most likely value.
        mean: Before it is cut off.
        deviation: Standard deviation, before it is cut off.
        median: Before it is cut off.
        spread: A pure number.
    """

    distribution: str
    least: Any = None
    most: Any = None
    mode: Any = None
    mean: Any = None
    deviation: Any = None
    median: Any = None
    spread: Any = None


def _spread(value: Any) -> list[Any] | DistributionTable:
    """A range as it is, a table as a distribution."""
    if isinstance(value, list) and len(value) == 2:
        return value
    if not isinstance(value, dict):
        raise ValueError(  # noqa: TRY004
            f"{shown(value)} must be a range [least, most] or a table such as "
            '{ distribution = "normal", mean = 0.1, deviation = 0.02 }'
        )
    for key in value:
        require_known("key", key, DistributionTable.model_fields, error=ValueError)
    if value.get("distribution") not in _KINDS:
        raise ValueError(unknown_name("distribution", value.get("distribution"), _KINDS))
    return DistributionTable(**value)


# A range, or a table with a distribution and its numbers.
Spread = Annotated[Any, BeforeValidator(_spread)]


_OwnersTable = create_model(
    "_OwnersTable",
    __base__=Table,
    **{name: (Spread, None) for names in QUANTITIES.values() for name in names},  # pyright: ignore[reportArgumentType, reportCallIssue]
    **dict.fromkeys(QUANTITIES, (str | None, None)),  # pyright: ignore[reportArgumentType]
)


class UncertainTable(_OwnersTable):
    """``[[uncertain]]``: a number of plant, disturbance, start, loop or machine not known.

    Its numbers are those of ``QUANTITIES``, for what it is of. Each is a range ``[least, most]``,
    uniform in between, or a table with a ``distribution``. Times of a loop are rounded to whole
    timesteps.

    Attributes:
        body: A body of the model.
        at: Of an added mass: where on the body, in its own frame [m], (3,).
        joint: A joint of the model.
        disturbance: A disturbance of the file, by its label.
        start: A state, by its name.
        parameter: A parameter of an analytic plant of one's own.
        computing: ``true`` for the computer, whose delay, jitter or missed samples are uncertain.
        sensor: The state of a [[sensor]] of the file.
        estimator: The state of an [[estimator]].
        actuator: The input of an [[actuator]].
        transmission: The joint of a [[transmission]].
        lugre: The joint of a [[lugre]].
        stop: The joint of a [[stop]].
        motor: The input of a [[motor]].
        swinging_load: The body of a [[swinging_load]].
        sliding_load: The body of a [[sliding_load]].
        wall: The body of a [[wall]].
        name: What it is called; what it is of and the quantity by default.
        nominal: The value that is no uncertainty, from which the radius is measured: by default
            what the file has without this table, and no disturbance.
    """

    computing: Literal[True] | None = None
    at: Annotated[list[Metres], Three] = [0.0, 0.0, 0.0]
    name: str = ""
    nominal: Any = None

    @model_validator(mode="after")
    def _one_number_of_one_thing(self) -> UncertainTable:
        owners = [name for name in QUANTITIES if getattr(self, name) is not None]
        if len(owners) != 1:
            raise ValueError(f"name one of {', '.join(QUANTITIES)}, not {owners or 'none'}")
        valid = list(QUANTITIES[owners[0]])
        every = {name for names in QUANTITIES.values() for name in names}
        given = sorted(every & self.model_fields_set)
        if idle := [name for name in given if name not in valid]:
            owner = f"{'an' if owners[0][0] in 'ae' else 'a'} {owners[0]}"
            raise ValueError(f"{owner} has no {', '.join(idle)}; valid: {', '.join(valid)}")
        if len(given) != 1:
            raise ValueError(
                f"give one of {', '.join(valid)}, not {', '.join(given) or 'none'}: one "
                "[[uncertain]] is one number"
            )
        if "at" in self.model_fields_set and given != ["added_mass"]:
            raise ValueError("at is where an added_mass is: give it one")
        return self

    @property
    def owner(self) -> str:
        """What it belongs to, a key of ``QUANTITIES``."""
        return next(name for name in QUANTITIES if getattr(self, name) is not None)

    @property
    def of(self) -> str:
        """Name of the body, joint, disturbance, state, input or parameter."""
        return "computing" if self.owner == "computing" else getattr(self, self.owner)

    @property
    def quantity(self) -> str:
        """Which of its numbers is uncertain."""
        return next(name for name in QUANTITIES[self.owner] if getattr(self, name) is not None)

    @property
    def called(self) -> str:
        """Its name."""
        if self.name:
            return self.name
        return self.of if self.owner == "start" else f"{self.of} {self.quantity.replace('_', ' ')}"


class CorrelationTable(Table):
    """``[[correlation]]``: two uncertain numbers that are not independent.

    Attributes:
        between: Their names.
        coefficient: Correlation of the Gaussian copula, from -1 to 1.
    """

    between: Annotated[list[str], Field(min_length=2, max_length=2)]
    coefficient: Annotated[float, Field(gt=-1, lt=1)]
