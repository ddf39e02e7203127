"""What a claim is, and what is found about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Literal, NamedTuple

from grosmc_mj.arrays import Array
from grosmc_mj.errors import GrosmcError
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.runs import PlantName


class Verdict(Enum):
    """What the measurement says of a claim."""

    SUPPORTED = "supported"
    REFUTED = "refuted"
    INCONCLUSIVE = "inconclusive"


class NeedsSlidingModeError(GrosmcError):
    """A measurement that asks a controller for what only a sliding mode law has."""


class Measured(NamedTuple):
    """What was measured.

    Attributes:
        value: In the claim's unit; None if there is none to give.
        note: What to know about it, for instance why there is none.
        broken: Whether a run that it rests on ended early.
    """

    value: float | None
    note: str = ""
    broken: bool = False


class Curve(NamedTuple):
    """A line of a claim's figure.

    Attributes:
        label: In the legend.
        x: Abscissae.
        y: Ordinates.
        controller: Whose colour it has; empty for the optimum's.
    """

    label: str
    x: Array
    y: Array
    controller: str = ""


class Drawing(NamedTuple):
    """A claim's figure: curves with what their axes mean."""

    x_label: str
    y_label: str
    curves: Sequence[Curve]


@dataclass(frozen=True)
class Claim:
    """One statement of the chapter, and how it is judged.

    Attributes:
        id: Name on the command line, in JSON and in the system's file.
        system: System that it is about.
        statement: The chapter's words, in short and paraphrased.
        source: Section, figure and equation.
        criterion: What is measured and what it must be.
        why: Why this threshold.
        measure: The measurement, on one plant.
        sense: Whether the value must be at most or at least the threshold.
        threshold: In ``unit``.
        unit: Of value and threshold.
        verdicts: What is expected on each plant that it can be asked of; the last one decides.
        reason: Why that is expected.
        untested: What the measurement leaves open.
        defect: Whether the statement is a suspected misprint or gap of the chapter.
        exact: Whether no time step enters, so that there is nothing to refine.
        premise: Says which premise failed, or nothing.
        equation: The equation at stake, in LaTeX.
        drawing: The figure that shows it.
    """

    id: str
    system: str
    statement: str
    source: str
    criterion: str
    why: str
    measure: Callable[[Laboratory, PlantName], Measured]
    sense: Literal["at most", "at least"]
    threshold: float
    unit: str
    verdicts: Mapping[PlantName, Verdict]
    reason: str
    untested: str
    defect: bool = False
    exact: bool = False
    premise: Callable[[Laboratory], str] | None = None
    equation: str = ""
    drawing: Callable[[Laboratory], Drawing] | None = None

    @property
    def plants(self) -> tuple[PlantName, ...]:
        """Plants that it can be asked of; the last one decides."""
        return tuple(self.verdicts)

    def holds(self, measured: Measured) -> bool:
        """Whether a measurement meets the criterion; one without a value doesn't."""
        if measured.value is None:
            return False
        if self.sense == "at most":
            return measured.value <= self.threshold
        return measured.value >= self.threshold


@dataclass(frozen=True)
class PlantFinding:
    """What was found on one plant.

    Attributes:
        measured: At the settings asked for.
        refined: At half the timestep and control period; None for an exact claim.
        verdict: What both together say.
    """

    measured: Measured
    refined: Measured | None
    verdict: Verdict


@dataclass(frozen=True)
class Finding:
    """What was found about a claim.

    Attributes:
        claim: The claim.
        plants: By plant.
        because: The premise that failed where the claim did, if one did.
    """

    claim: Claim
    plants: Mapping[PlantName, PlantFinding]
    because: str = ""

    @property
    def verdict(self) -> Verdict:
        """That of the plant that decides: physics, if the claim can be asked of it."""
        return self.plants[self.claim.plants[-1]].verdict
