"""What the page reads of the documents of studies, sweeps and premises."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from grosmc_mj.page.documents import Number, StoredPart, Text


class StoredAxis(StoredPart):
    """An axis of a map of starts, from minus to plus its limit."""

    name: Text = ""
    unit: Text = "1"
    limit: Annotated[float, Field(gt=0)]


class StoredRegionConfiguration(StoredPart):
    """What starts were tried."""

    axes: Annotated[list[StoredAxis], Field(min_length=2, max_length=2)]


class StoredOutcome(StoredPart):
    """What a letter of a map stands for."""

    name: Text


class StoredInterval(StoredPart):
    """From where to where."""

    start: Number = Field(default=None, alias="from")
    stop: Number = Field(default=None, alias="to")


class StoredMap(StoredPart):
    """What became of each start: a string for each value of the second axis."""

    case: Text
    controller: Text
    counts: dict[str, int] = Field(default={})
    converges_on_first_axis: StoredInterval = StoredInterval()
    grid: list[Text]


class StoredRegion(StoredPart):
    """What ``study region`` writes."""

    system: Text = ""
    configuration: StoredRegionConfiguration
    outcomes: dict[str, StoredOutcome]
    maps: list[StoredMap]


class StoredSample(StoredPart):
    """A switching law on the scalar benchmark."""

    law: Text
    h: float
    gain_ratio: float = 1.0
    max_sliding: Number = None


class StoredBenchmark(StoredPart):
    """The scalar benchmark."""

    equation: Text = ""
    orders: dict[str, Number] = Field(default={})
    sample_times: list[StoredSample]
    gain_ratios: list[StoredSample] = Field(default=[])


class StoredSwitchingCase(StoredPart):
    """A switching law in a case."""

    system: Text
    case: Text
    law: Text
    surface: Text = ""
    control_period: float
    deviation: Number = None
    ended: Text = ""


class StoredSwitching(StoredPart):
    """What ``study switching`` writes."""

    benchmark: StoredBenchmark
    cases: list[StoredSwitchingCase]


class StoredTrial(StoredPart):
    """What was measured with a choice."""

    choice: Text
    measured: Number = None
    holds: bool | None = None


class StoredSweep(StoredPart):
    """A claim over one of its choices."""

    claim: Text
    choice: Text
    printed: bool = False
    values: list[StoredTrial]
    flips: Text = ""


class StoredSweeps(StoredPart):
    """What ``claims --sweep`` writes."""

    sweeps: list[StoredSweep]


class StoredReading(StoredPart):
    """A premise at its worst point, and the share of points that violate it."""

    margin: Number = None
    violated: Number = None


class StoredPremise(StoredPart):
    """What a theorem asks for."""

    name: Text
    source: Text = ""
    requirement: Text = ""
    unit: Text = "1"
    holds: bool
    region: StoredReading | None = None
    along_run: StoredReading | None = None
    restored_by: Text = ""
    note: Text = ""


class StoredAudit(StoredPart):
    """The premises of a law in a case."""

    system: Text = ""
    case: Text
    controller: Text
    premises: list[StoredPremise]


class StoredPremises(StoredPart):
    """What ``claims --premises`` writes."""

    premises: list[StoredAudit]
