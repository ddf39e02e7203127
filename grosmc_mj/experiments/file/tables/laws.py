"""What a case file may say of its laws and of what they are designed for."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field

from grosmc_mj.errors import shown
from grosmc_mj.experiments.file.tables.table import Table


def _weight(value: Any) -> Any:
    """A number, a diagonal or the rows of a matrix, of numbers."""
    rows = value if isinstance(value, list) else [value]
    entries = [each for row in rows for each in (row if isinstance(row, list) else [row])]
    if any(isinstance(each, bool) or not isinstance(each, (int, float)) for each in entries):
        raise ValueError(f"{shown(value)} must be a number, a list of numbers or a list of rows")
    return value


Weight = Annotated[Any, BeforeValidator(_weight)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class OutputsTable(Table):
    """``outputs`` of ``[task]``: what of the plant is regulated.

    Attributes:
        of: ``plant`` for the plant's own outputs, a name such as ``tip`` where the package has
            further ones, or ``module:name`` of a function that returns expressions in the states.
        guess: A state near which the outputs determine the states, by name; it matters where
            several states have the same outputs.
        unit: Unit of outputs that are no states.
    """

    of: str = "plant"
    guess: dict[str, Any] = {}
    unit: str = ""


class TaskTable(Table):
    """``[task]``: what the laws are designed for; the package's systems have theirs.

    Attributes:
        name: What results call the laws of this task together; the system's name by default.
        outputs: What is regulated.
        reference: y_r(t) of each output, a formula in t in seconds, in the output's unit; or one
            ``module:name`` of a reference with its parameters.
        sign: 1 for the error y - y_r, -1 for y_r - y.
        Q: Weight of the error state, a matrix or its diagonal.
        R: Weight of the input, a number, a matrix or its diagonal.
        region: Where the premises are looked at: bounds of |z1|, |z2| ..., each in its unit; what
            the gains are declared for, or what the run spans, by default.
        slope: L of the super-twisting law, in the unit of s per second squared.
    """

    name: str = ""
    outputs: OutputsTable = OutputsTable()
    reference: list[str] | None = None
    sign: Literal[1, -1] = 1
    Q: Weight = None
    R: Weight = None
    region: list[Positive] | None = None
    slope: Positive | None = None


class LawTable(Table):
    """``[laws.NAME]``: a law with numbers, which a ``[[controller]]`` may name.

    Its numbers stand beside these keys.

    Attributes:
        law: A law by its name, or ``module:name`` of a law, of a function that makes a controller
            of the nominal plant, or of a controller.
        switching: Switching law of a sliding mode law.
        surface: ``printed`` or ``discrete``.
        memory: What a law of the user's own remembers, by names, as a run begins: numbers and
            lists of them.
        predict: Whether the law knows the dead time of its loop, and is told the state at the
            instant when its output arrives.
    """

    model_config = ConfigDict(extra="allow", frozen=True, strict=True)

    law: str
    switching: str = "sign"
    surface: Literal["printed", "discrete"] = "printed"
    memory: dict[str, Any] = {}
    predict: bool | None = None

    @property
    def numbers(self) -> dict[str, Any]:
        """The law's numbers."""
        return dict(self.model_extra or {})


class ControllerTable(LawTable):
    """``[[controller]]``: a law that is run, with what it has other than its ``[laws.NAME]``.

    Attributes:
        name: What it is called; its law by default.
    """

    name: str | None = None

    @property
    def called(self) -> str:
        """Its name."""
        return self.name or self.law.split(":")[-1]
