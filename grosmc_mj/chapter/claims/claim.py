"""Claims, the choices that they depend on, and what is measured of them."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as checked_dataclass

from grosmc_mj.errors import GrosmcError, shown
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.plants import PlantName

_CHECKED = ConfigDict(extra="forbid", arbitrary_types_allowed=True)
# The limits that words of the statements mean, and why: one for one word, wherever it is said.
WORDS: dict[str, dict[str, Any]] = tomllib.loads(
    Path(__file__).with_name("words.toml").read_text(encoding="utf-8")
)


class Verdict(Enum):
    """Verdict of a claim.

    Undetermined is what turns on a choice that the chapter does not print; a premise is not met
    where a theorem's own condition fails on the case that it is claimed of; inconclusive is what
    depends on the time step.
    """

    SUPPORTED = "supported"
    REFUTED = "refuted"
    UNDETERMINED = "undetermined"
    PREMISE_NOT_MET = "premise not met"
    INCONCLUSIVE = "inconclusive"


class Kind(Enum):
    """Sort of a statement; each sort has a table of its own, with this title.

    Claims are counted by the sentence of the chapter that they rest on, the others one by one.
    """

    CLAIM = "sentences of the chapter"
    MISPRINT = "equations as printed"
    PROOF = "assumptions and proofs"
    QUESTION = "questions of this project"


class NeedsSlidingModeError(GrosmcError):
    """A measurement needs a quantity that only a sliding mode law has."""


class NoValueError(GrosmcError):
    """A measurement has no value, because a run on which it rests ended early or is empty."""


class Measured(NamedTuple):
    """A measured value.

    Attributes:
        value: In the claim's unit; None if there is none.
        note: Further numbers, or why there is no value.
        broken: Whether a run that it rests on ended early.
    """

    value: float | None
    note: str = ""
    broken: bool = False


@checked_dataclass(frozen=True, config=_CHECKED)
class Choice:
    """A number or a measure that a claim depends on.

    Attributes:
        name: For people.
        values: That are tried.
        printed: Whether the chapter prints it.
        key: Its key in the case files, such as ``task.Q``; empty for an argument.
        argument: Of the claim's measurement; empty for a number of the case files.
        unit: Of the values.
    """

    name: str
    values: Annotated[tuple[Any, ...], Field(min_length=1)]
    printed: bool = False
    key: str = ""
    argument: str = ""
    unit: str = ""

    def written(self, value: Any) -> str:
        """A value with name and unit."""
        numbers = value if isinstance(value, list) else [value]
        words = ", ".join(shown(number, str) for number in numbers)
        listed = f"[{words}]" if isinstance(value, list) else words
        return f"{self.name} = {listed} {self.unit}".rstrip()


@checked_dataclass(frozen=True, config=_CHECKED)
class Claim:
    """One statement of the chapter, and how it is judged.

    Attributes:
        id: Name on the command line, in JSON and in the system's file.
        system: System that it is about.
        statement: The chapter's words, in short and paraphrased.
        source: Section, figure and equation.
        criterion: The measured quantity and its limit.
        why: Reason for this threshold.
        measure: The measurement on one plant.
        sense: Whether the value must be at most or at least the threshold.
        threshold: In ``unit``.
        unit: Of value and threshold.
        verdicts: Expected on each plant that it can be judged on; the last one decides.
        reason: Why these are expected.
        untested: Limits of the measurement.
        kind: Of statement.
        quote: The words that it is the statement of; empty for a question of this project's. Claims
            with the same quote rest on one sentence.
        word: The word of the statement that the threshold says in numbers; empty for its own.
        choices: Numbers and measures that it depends on.
        every: Names of those choices for every value of which the statement is meant.
        some: Names of those for one value of which at least it is meant.
        cause: Why it is not supported, where it is not: one cause may fail several claims.
        exact: Whether no time step enters, so that there is nothing to refine.
        premise: Names the premise that failed, or nothing.
        equation: The equation at stake, in LaTeX.
        drawing: Panel, case and laws of the figure that shows it, see ``figures.claim_panel``.
    """

    id: str
    system: str
    statement: str
    source: str
    criterion: str
    why: str
    measure: Callable[..., Measured]
    sense: Literal["at most", "at least"]
    threshold: float
    unit: str
    verdicts: Annotated[Mapping[PlantName, Verdict], Field(min_length=1)]
    reason: str
    untested: str
    kind: Kind = Kind.CLAIM
    quote: str = ""
    word: str = ""
    choices: tuple[Choice, ...] = ()
    every: tuple[str, ...] = ()
    some: tuple[str, ...] = ()
    cause: str = ""
    exact: bool = False
    premise: Callable[[Laboratory], str] | None = None
    equation: str = ""
    drawing: Mapping[str, Any] | None = None

    @property
    def plants(self) -> tuple[PlantName, ...]:
        """Plants that it can be judged on; the last one decides."""
        return tuple(self.verdicts)

    @property
    def quantifier(self) -> str:
        """The choices for which it is meant."""
        if meant := ", ".join(self.every or self.some):
            return f"for {'every' if self.every else 'at least one'} value tried of: {meant}"
        if self.kind in (Kind.PROOF, Kind.MISPRINT) and not self.choices:
            return "for all that it allows: one counterexample refutes it"
        if self.kind is not Kind.QUESTION and all(choice.printed for choice in self.choices):
            return "for the printed numbers"
        return "for the printed numbers, and those declared here where none is printed"

    def holds(self, measured: Measured) -> bool:
        """Whether a measurement meets the criterion; one without a value doesn't."""
        if measured.value is None:
            return False
        if self.sense == "at most":
            return measured.value <= self.threshold
        return measured.value >= self.threshold


@dataclass(frozen=True)
class PlantFinding:
    """The measurements of a claim on one plant.

    Attributes:
        measured: At the laboratory's settings.
        refined: At half the timestep and control period; None for an exact claim.
        verdict: Of both together.
        finer: Where the time steps were halved.
    """

    measured: Measured
    refined: Measured | None
    verdict: Verdict
    finer: PlantName = "corrected"


@dataclass(frozen=True)
class Finding:
    """The measurements of a claim on all its plants.

    Attributes:
        claim: The claim.
        plants: By plant.
        because: The premise that failed where the claim did, if one did.
        trials: On the plant that decides, at the values of the choices that the claim is meant for
            every or some of.
    """

    claim: Claim
    plants: Mapping[PlantName, PlantFinding]
    because: str = ""
    trials: Mapping[str, Measured] = field(default_factory=dict)

    @property
    def verdict(self) -> Verdict:
        """That of the plant that decides: physics, if the claim can be judged on it."""
        return self.decisive.verdict

    @property
    def decisive(self) -> PlantFinding:
        """Measurements on the plant that decides."""
        return self.plants[self.claim.plants[-1]]

    @property
    def unexpected(self) -> dict[PlantName, Verdict]:
        """The verdicts that are not the expected ones."""
        return {
            plant: finding.verdict
            for plant, finding in self.plants.items()
            if finding.verdict is not self.claim.verdicts[plant]
        }

    @property
    def shown(self) -> Measured:
        """The measurement that stands for the claim, on the plant that decides.

        Of a claim that is meant for some of its choices, or holds for none, it is the one that is
        nearest to the criterion; of one that holds for every one of them the worst.
        """
        measured = self.decisive.measured
        valued = [one for one in (measured, *self.trials.values()) if one.value is not None]
        if not self.trials or self.verdict is Verdict.UNDETERMINED or not valued:
            return measured
        worst = bool(self.claim.every) and self.verdict is Verdict.SUPPORTED
        least = (self.claim.sense == "at most") is not worst
        return (min if least else max)(valued, key=lambda one: one.value or 0.0)

    @property
    def near(self) -> bool:
        """Whether the verdict would turn if the threshold were half as large again, or half."""
        value, threshold = self.decisive.measured.value, self.claim.threshold
        if value is None or threshold == 0 or self.claim.exact:
            return False
        return 0.5 <= value / threshold <= 1.5

    @property
    def needs(self) -> str:
        """The value of a choice with which alone the statement holds; empty if as declared."""
        if self.verdict is not Verdict.SUPPORTED or self.claim.holds(self.decisive.measured):
            return ""
        holding = [trial for trial in self.trials.items() if self.claim.holds(trial[1])]
        return "; ".join(f"{name}: {at.note}" if at.note else name for name, at in holding)

    @property
    def turns(self) -> str:
        """With which of the choices the statement is true, and with which not; empty if on none."""
        if self.verdict is not Verdict.UNDETERMINED:
            return ""
        sides: dict[bool, list[str]] = {True: [], False: []}
        for name, at in self.trials.items():
            if at.value is not None:
                sides[self.claim.holds(at)].append(f"{name} ({at.value:.3g})")
        return f"true with {', '.join(sides[True])}; false with {', '.join(sides[False])}"


# The first of these that a claim has is its sentence's verdict.
_WEAKEST = (
    Verdict.REFUTED,
    Verdict.PREMISE_NOT_MET,
    Verdict.UNDETERMINED,
    Verdict.INCONCLUSIVE,
    Verdict.SUPPORTED,
)
RULE = (
    "A sentence is refuted if any claim under it is refuted. Otherwise its premise is not met if "
    "that of any claim is not; otherwise it is undetermined if any is, or inconclusive if any is. "
    "It is supported only if all are."
)


@dataclass(frozen=True)
class Sentence:
    """A sentence of the chapter with the findings about the claims under it.

    Attributes:
        quote: Its words.
        findings: Of the claims that rest on it.
    """

    quote: str
    findings: tuple[Finding, ...]

    @property
    def verdict(self) -> Verdict:
        """The claims' verdicts together, by ``RULE``."""
        return min((finding.verdict for finding in self.findings), key=_WEAKEST.index)


def sentences_of(findings: Iterable[Finding]) -> list[Sentence]:
    """The sentences that claims of the chapter rest on, in the claims' order."""
    under: dict[tuple[str, str], list[Finding]] = {}
    for finding in findings:
        if finding.claim.kind is Kind.CLAIM:
            under.setdefault((finding.claim.system, finding.claim.quote), []).append(finding)
    return [Sentence(quote, tuple(own)) for (_, quote), own in under.items()]


def verdicts_of(findings: Iterable[Finding], kind: Kind) -> list[Verdict]:
    """The verdicts of a kind that are counted: one a sentence, or one a statement."""
    own = [finding for finding in findings if finding.claim.kind is kind]
    return [one.verdict for one in (sentences_of(own) if kind is Kind.CLAIM else own)]
