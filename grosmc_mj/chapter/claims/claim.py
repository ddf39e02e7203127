"""Claims, the choices that they depend on, and the findings about them."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as checked_dataclass

from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.ground.errors import GrosmcError, value_text
from grosmc_mj.ground.wording import unit_after

_CHECKED = ConfigDict(extra="forbid", arbitrary_types_allowed=True)
# Limits that stand for words of the statements, with the reason; a word has one limit everywhere.
WORDS: dict[str, dict[str, Any]] = tomllib.loads(
    Path(__file__).with_name("words.toml").read_text(encoding="utf-8")
)


class ClaimVerdict(Enum):
    """Verdict of a claim.

    A claim is undetermined if its answer depends on a choice that the chapter does not print. Its
    premise is not met if a condition of its theorem fails in the case that it is claimed of. It is
    inconclusive if its answer depends on the time step.
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


class ClaimValue(NamedTuple):
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
        values: Values that are tried.
        printed: Whether the chapter prints it.
        key: Its key in the case files, such as ``task.Q``; empty for an argument.
        argument: Argument of the claim's measurement; empty for a number of the case files.
        unit: Unit of the values.
    """

    name: str
    values: Annotated[tuple[Any, ...], Field(min_length=1)]
    printed: bool = False
    key: str = ""
    argument: str = ""
    unit: str = ""

    def written(self, value: Any) -> str:
        """Return a value with name and unit."""
        if isinstance(value, list):
            numbers = ", ".join(value_text(number, str) for number in value)
            text = f"[{numbers}]"
        else:
            text = value_text(value, str)
        return f"{self.name} = {text}{unit_after(self.unit)}"


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
        threshold: Limit of the value, in ``unit``.
        unit: Unit of value and threshold.
        verdicts: Expected verdict on each plant that it can be judged on; the last plant decides.
        reason: Why these are expected.
        untested: Limits of the measurement.
        kind: Sort of statement.
        quote: The chapter's words for the statement; empty for a question of this project. Claims
            with the same quote rest on one sentence.
        word: The word of the statement that the threshold puts into numbers, a key of ``WORDS``;
            empty for a threshold of its own.
        choices: Numbers and measures that it depends on.
        every: Names of the choices for all values of which the statement is meant.
        some: Names of the choices for at least one value of which it is meant.
        cause: Why it is not supported, if it is not; several claims may fail for one cause.
        exact: Whether no time step enters, so that there is nothing to refine.
        premise: Function that names the premise that failed; it returns an empty text if none did.
        equation: The equation at stake, in LaTeX.
        drawing: Quantity, case and laws of the figure that shows it, see ``figures.draw_quantity``.
    """

    id: str
    system: str
    statement: str
    source: str
    criterion: str
    why: str
    measure: Callable[..., ClaimValue]
    sense: Literal["at most", "at least"]
    threshold: float
    unit: str
    verdicts: Annotated[Mapping[PlantName, ClaimVerdict], Field(min_length=1)]
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
    premise: Callable[[RunCache], str] | None = None
    equation: str = ""
    drawing: Mapping[str, Any] | None = None

    @property
    def plants(self) -> tuple[PlantName, ...]:
        """Plants that it can be judged on; the last one decides."""
        return tuple(self.verdicts)

    @property
    def quantifier(self) -> str:
        """The choices for which it is meant, in words."""
        if self.every:
            return f"for every value tried of: {', '.join(self.every)}"
        if self.some:
            return f"for at least one value tried of: {', '.join(self.some)}"
        if self.kind in (Kind.PROOF, Kind.MISPRINT) and not self.choices:
            return "for all that it allows: one counterexample refutes it"
        if self.kind is not Kind.QUESTION and all(choice.printed for choice in self.choices):
            return "for the printed numbers"
        return "for the printed numbers, and those declared here where none is printed"

    def holds(self, measured: ClaimValue) -> bool:
        """Whether a measurement meets the criterion; one without a value does not."""
        if measured.value is None:
            return False
        if self.sense == "at most":
            return measured.value <= self.threshold
        return measured.value >= self.threshold


@dataclass(frozen=True)
class PlantFinding:
    """The measurements of a claim on one plant.

    Attributes:
        measured: Value at the run cache's settings.
        refined: Value at half the timestep and control period; None for an exact claim.
        verdict: Verdict by both values together.
        finer: Plant on which the time steps were halved.
    """

    measured: ClaimValue
    refined: ClaimValue | None
    verdict: ClaimVerdict
    finer: PlantName = "corrected"


@dataclass(frozen=True)
class ClaimFinding:
    """The measurements of a claim on all its plants.

    Attributes:
        claim: The claim.
        plants: Measurements by plant.
        because: The premise that failed where the claim did; empty if none did.
        trials: Measurements on the plant that decides, one for each value of the choices in
            ``every`` and ``some`` of the claim.
    """

    claim: Claim
    plants: Mapping[PlantName, PlantFinding]
    because: str = ""
    trials: Mapping[str, ClaimValue] = field(default_factory=dict)

    @property
    def verdict(self) -> ClaimVerdict:
        """Verdict on the plant that decides: physics, if the claim can be judged on it."""
        return self.decisive.verdict

    @property
    def decisive(self) -> PlantFinding:
        """Measurements on the plant that decides."""
        return self.plants[self.claim.plants[-1]]

    @property
    def unexpected(self) -> dict[PlantName, ClaimVerdict]:
        """The verdicts that are not the expected ones, by plant."""
        unexpected: dict[PlantName, ClaimVerdict] = {}
        for plant, finding in self.plants.items():
            if finding.verdict is not self.claim.verdicts[plant]:
                unexpected[plant] = finding.verdict
        return unexpected

    @property
    def representative(self) -> ClaimValue:
        """The measurement that stands for the claim, on the plant that decides.

        Of a claim that holds for every one of its choices, it is the worst; of one that is meant
        for some of them, or holds for none, the nearest to the criterion.
        """
        measured = self.decisive.measured
        values = [trial for trial in self.trials.values() if trial.value is not None]
        if measured.value is not None:
            values.insert(0, measured)
        if not self.trials or self.verdict is ClaimVerdict.UNDETERMINED or not values:
            return measured

        takes_worst = bool(self.claim.every) and self.verdict is ClaimVerdict.SUPPORTED
        largest_is_worst = self.claim.sense == "at most"
        if takes_worst is largest_is_worst:
            return max(values, key=_value)
        return min(values, key=_value)

    @property
    def near(self) -> bool:
        """Whether the verdict would turn if the threshold were half as large again, or half."""
        value = self.decisive.measured.value
        threshold = self.claim.threshold
        if value is None or threshold == 0 or self.claim.exact:
            return False
        return 0.5 <= value / threshold <= 1.5

    @property
    def needs(self) -> str:
        """The value of a choice with which alone the statement holds; empty if as declared."""
        if self.verdict is not ClaimVerdict.SUPPORTED or self.claim.holds(self.decisive.measured):
            return ""

        holding = []
        for name, trial in self.trials.items():
            if self.claim.holds(trial):
                holding.append(f"{name}: {trial.note}" if trial.note else name)
        return "; ".join(holding)

    @property
    def turns(self) -> str:
        """With which choices the statement is true, and with which not; empty unless it turns."""
        if self.verdict is not ClaimVerdict.UNDETERMINED:
            return ""

        true = []
        false = []
        for name, trial in self.trials.items():
            if trial.value is not None:
                side = true if self.claim.holds(trial) else false
                side.append(f"{name} ({trial.value:.3g})")
        return f"true with {', '.join(true)}; false with {', '.join(false)}"


def _value(measured: ClaimValue) -> float:
    """The value of a measurement that has one."""
    assert measured.value is not None
    return measured.value


# The verdict of a sentence is the first of these that one of its claims has.
_WEAKEST = (
    ClaimVerdict.REFUTED,
    ClaimVerdict.PREMISE_NOT_MET,
    ClaimVerdict.UNDETERMINED,
    ClaimVerdict.INCONCLUSIVE,
    ClaimVerdict.SUPPORTED,
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
        findings: Findings about the claims that rest on it.
    """

    quote: str
    findings: tuple[ClaimFinding, ...]

    @property
    def verdict(self) -> ClaimVerdict:
        """The claims' verdicts together, by ``RULE``."""
        return min((finding.verdict for finding in self.findings), key=_WEAKEST.index)


def sentences_of(findings: Iterable[ClaimFinding]) -> list[Sentence]:
    """Return the sentences that claims of the chapter rest on, in the claims' order."""
    by_sentence: dict[tuple[str, str], list[ClaimFinding]] = {}
    for finding in findings:
        if finding.claim.kind is Kind.CLAIM:
            sentence = (finding.claim.system, finding.claim.quote)
            by_sentence.setdefault(sentence, []).append(finding)
    return [Sentence(quote, tuple(group)) for (_, quote), group in by_sentence.items()]


def verdicts_of(findings: Iterable[ClaimFinding], kind: Kind) -> list[ClaimVerdict]:
    """Return the verdicts of a kind that are counted: one a sentence, or one a statement."""
    of_kind = [finding for finding in findings if finding.claim.kind is kind]
    if kind is Kind.CLAIM:
        return [sentence.verdict for sentence in sentences_of(of_kind)]
    return [finding.verdict for finding in of_kind]
