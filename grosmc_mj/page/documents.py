"""What the page reads of the documents of results: all else in them is left alone.

A document is known by the keys that it has, so that those of older versions are, too.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

# A value that JSON has no number for is null.
Number = float | None
Text = Annotated[str, Field(max_length=20_000)]
Colour = Annotated[str, Field(pattern=r"^#[0-9a-fA-F]{6}$")]


class StoredPart(BaseModel):
    """Part of a document; numbers are finite, and a text is no number."""

    model_config = ConfigDict(allow_inf_nan=False, frozen=True, strict=True)


class StoredProvenance(StoredPart):
    """Where a document comes from.

    Attributes:
        complete: Whether it has all that was asked for.
        configuration: As resolved.
    """

    versions: dict[str, Text] = {}
    git_revision: Text | None = None
    machine: Text | None = None
    command: Text | None = None
    seed: int | None = None
    complete: bool = True
    configuration: Any = None


class StoredRequirement(StoredPart):
    """A requirement of a run, and whether it is kept."""

    requirement: Text
    limit: dict[str, Number | Text] = {}
    controller: Text
    plant: Text
    measured: Number = None
    margin: Number = None
    kept: bool
    note: Text = ""


class StoredCase(StoredPart):
    """Which case something is of."""

    system: Text = ""
    case: Text = ""
    title: Text = ""


class StoredCases(StoredPart):
    """A configuration of cases."""

    cases: list[StoredCase] = []


class StoredMetric(StoredPart):
    """A number of a run."""

    value: Number = None
    unit: Text = "1"


class StoredRun(StoredPart):
    """A run of a case."""

    system: Text = ""
    case: Text = ""
    plant: Text
    controller: Text
    ended: Text = ""
    status: Text = ""
    switching: Text = ""
    metrics: dict[str, StoredMetric] = {}


class StoredRunResults(StoredPart):
    """What ``run`` writes."""

    configuration: StoredCases = StoredCases()
    complete: bool = True
    requirements: list[StoredRequirement]
    runs: list[StoredRun]


class StoredFound(StoredPart):
    """What was found of a claim on one plant."""

    value: Number = None
    note: Text = ""
    verdict: Text
    evidence: dict[str, Any] = {}
    trials: dict[str, Number] = {}


class StoredExpected(StoredPart):
    """What is expected of a claim."""

    verdicts: dict[str, Text] = {}
    reason: Text = ""


class StoredClaim(StoredPart):
    """A claim, and what was found."""

    id: Text
    system: Text
    source: Text = ""
    statement: Text
    equation: Text = ""
    criterion: Text = ""
    sense: Text = "at most"
    threshold: Number = None
    unit: Text = "1"
    why: Text = ""
    cause: Text = ""
    verdict: Text
    because: Text = ""
    untested: Text = ""
    plants: dict[str, StoredFound] = {}
    expected: StoredExpected = StoredExpected()


class StoredSentence(StoredPart):
    """A sentence of the chapter, and the claims under it."""

    quote: Text = ""
    verdict: Text
    claims: list[Text] = []


class StoredClaims(StoredPart):
    """What ``claims`` writes."""

    sentences: list[StoredSentence] = []
    claims: list[StoredClaim]


class StoredValidation(StoredPart):
    """What ``validate`` writes."""

    complete: bool = True
    as_recorded: bool | None
    differences: list[Text] = []
    runs: list[StoredRun]
    sentences: list[StoredSentence] = []
    claims: list[StoredClaim] = []


class StoredAmount(StoredPart):
    """So much of an imperfection."""

    factor: float
    parts: list[dict[str, Number | Text]] = []


class StoredTolerance(StoredPart):
    """How much of an imperfection a law stands."""

    law: Text
    imperfection: Text
    condition: Text
    kept_ideally: bool
    largest_kept: StoredAmount | None = None
    smallest_failed: StoredAmount | None = None
    breaks: Text | None = None
    impossible: Text | None = None


class StoredTolerances(StoredPart):
    """What ``study tolerance`` writes."""

    configuration: dict[str, Any] = {}
    complete: bool = True
    tolerances: list[StoredTolerance]


class StoredStanding(StoredPart):
    """How a law stands on a rung."""

    law: Text
    rung: Text
    together: bool
    condition: Text
    kept: bool
    share_of_the_tightest_limit: Number = None
    tightest: Text | None = None
    impossible: Text | None = None


class StoredStatement(StoredPart):
    """A statement of the chapter that is judged on each rung."""

    claim: Text
    statement: Text = ""


class StoredFall(StoredPart):
    """The rung on which a claim on a law falls; None if it stands on all."""

    law: Text
    condition: Text
    claim: Text
    rung: Text | None = None


class StoredLadder(StoredPart):
    """What ``study ladder`` writes."""

    configuration: dict[str, Any] = {}
    complete: bool = True
    claims: list[StoredStatement] = Field(default=[])
    fallen: list[StoredFall] = Field(default=[])
    standings: list[StoredStanding]


class StoredRate(StoredPart):
    """Of how many runs a requirement is kept, with its interval."""

    requirement: Text
    controller: Text
    kept: int
    runs: int
    rate: Number = None
    low: Number = None
    high: Number = None
    confidence: Number = None


class StoredMargin(StoredPart):
    """How margins are distributed."""

    requirement: Text
    controller: Text
    unit: Text = ""
    least: Number = None
    q05: Number = None
    median: Number = None
    q95: Number = None
    mean: Number = None
    mean_low: Number = None
    mean_high: Number = None


class StoredCampaignResults(StoredPart):
    """What ``campaign`` writes beside its parts."""

    pass_rates: list[StoredRate]
    margins: list[StoredMargin] = []
    units: dict[str, Text] = {}
    says: Text = ""


class StoredFilmFormat(StoredPart):
    """How a film shows its run."""

    speed: Annotated[float, Field(gt=0)] = 1.0
    start: float = 0.0


class StoredFilmConfiguration(StoredPart):
    """What a film was made from."""

    case: StoredCase = StoredCase()
    film: StoredFilmFormat = StoredFilmFormat()


class StoredFilm(StoredPart):
    """What lies beside a film."""

    configuration: StoredFilmConfiguration
    drawn_from: Text
    sha256: Text


class StoredLine(StoredPart):
    """Values over time [s]."""

    t: list[float]
    y: list[float]


class StoredLimit(StoredLine):
    """Where a requirement's limit is."""

    words: Text


class StoredCurve(StoredLine):
    """A curve of a run; the range of one that jumps, which y is the mean of then."""

    law: Text
    plant: Text
    name: Text = ""
    range: list[list[float]] | None = None


class StoredPanel(StoredPart):
    """One quantity over time."""

    label: Text
    curves: list[StoredCurve]
    reference: StoredLine | None = None
    limits: list[StoredLimit] = []
    play: float = 0.0


class StoredShaded(StoredPart):
    """When a disturbance acts [s]."""

    start: float
    stop: float
    label: Text = ""


class StoredLawStyle(StoredPart):
    """How a law is drawn."""

    label: Text
    colour: Colour


class StoredCurves(StoredPart):
    """What a figure of a case shows."""

    system: Text
    case: Text
    title: Text = ""
    duration: float
    disturbances: list[StoredShaded] = []
    laws: dict[str, StoredLawStyle] = {}
    panels: list[StoredPanel]


class StoredChange(StoredPart):
    """What is not as it was."""

    name: Text
    effect: Text
    before: Number | Text = None
    after: Number | Text = None
    unit: Text = ""
    note: Text = ""


class StoredDiff(StoredPart):
    """What ``diff`` writes."""

    old: Text
    new: Text
    compared: int
    changes: list[StoredChange]
