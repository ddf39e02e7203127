"""Questions of a campaign: its runs, its worst plants, how far its uncertainty may grow."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path

from grosmc_mj.cli import screen
from grosmc_mj.cli.answering import Question
from grosmc_mj.ground.executors import Executor
from grosmc_mj.ground.wording import counted, counted_of
from grosmc_mj.output.results.result import Result
from grosmc_mj.studies.campaign import work
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.findings import (
    RESULTS,
    Findings,
    campaign_result,
    findings,
    keeps_enough,
)
from grosmc_mj.studies.campaign.folder import Folder
from grosmc_mj.studies.campaign.map import write_figures
from grosmc_mj.studies.campaign.radius import RADIUS, Radius, radius, radius_result
from grosmc_mj.studies.campaign.worst import WORST, WorstPlant, worst, worst_result
from grosmc_mj.studies.pieces import held
from grosmc_mj.studies.sweep.sampled import ALL


@dataclass
class RunsQuestion(Question):
    """On what share of the plants do the laws hold?

    Attributes:
        campaign: The campaign.
        folder: Its folder.
        executor: Executor of the parts.
        resume: Whether to go on with what is in the folder.
        confidence: Confidence of the intervals.
        at_least: Share of the plants that each law must be shown to keep; None without.
        progress: Lines on the parts that were there already and on the speed of the others.
        begun: Whether the folder is this campaign's.
        searched: What searches from its runs found, by law.
        failing: Laws under which a search found a plant that fails inside the declared ranges.
    """

    campaign: Campaign
    folder: Folder
    executor: Executor
    resume: bool
    confidence: float
    at_least: float | None
    progress: list[str] = field(default_factory=list)
    begun: bool = False
    searched: dict[str, list[str]] = field(default_factory=dict)
    failing: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.path = self.folder.path / RESULTS

    def measure(self) -> None:
        """Run the missing parts."""
        with held(self.folder.path):
            lines = self.folder.begin(self.campaign, resume=self.resume)
            self.begun = True
            for line in (*lines, *notices(self.campaign)):
                screen.notice(line)
            self._run_missing()

    def _run_missing(self) -> None:
        """Run the missing parts with a progress bar."""
        specification = self.campaign.specification
        parts = self.folder.missing(self.campaign)
        present = specification.shards - len(parts)
        if present > 0:
            there = counted_of(present, specification.shards, "part", "is", "are")
            self.progress.append(f"{there} there already.")
        if not parts:
            return

        plants = sum(len(specification.ids(index)) for index in parts)
        runs = plants * len(self.campaign.laws)
        start = time.perf_counter()
        with screen.progress(runs, "runs") as advance:
            advance("designed; the first part takes a while", 0)
            finished = _FinishedRuns(advance, start)
            repeated = work.run_missing(
                self.campaign, self.folder, self.executor, screen.notice, finished
            )
        seconds = time.perf_counter() - start
        self.progress.append(_speed_line(self.campaign, runs, seconds, repeated))

    def result(self, *, complete: bool) -> Result | None:
        """Return the statements of the runs that are there."""
        if not self.begun or not self._done:
            return None
        return campaign_result(
            self.campaign, self.found, self.at_least, self.progress, self.searched, self.failing
        )

    @property
    def missing(self) -> Sequence[str]:
        """Number of parts that are not run, in words."""
        parts = self.campaign.specification.shards
        missing = parts - self._done
        return [f"{missing} of {parts} parts"] if missing else []

    def note(self, law: str, found: WorstPlant | Radius) -> None:
        """Note what a search found under a law."""
        self.searched.setdefault(law, []).append(found.words)
        if found.fails:
            self.failing.add(law)

    @cached_property
    def found(self) -> Findings:
        """Statements of the runs that are there, once no more are made."""
        return findings(self.campaign, self.folder, self.confidence)

    @property
    def _done(self) -> int:
        """Number of parts that are there."""
        return self.campaign.specification.shards - len(self.folder.missing(self.campaign))

    @property
    def kept(self) -> bool:
        """Whether each law keeps the share of the plants that is asked for.

        Without one it must keep everything on some plant, and no search may find a plant inside the
        declared ranges that fails.
        """
        if self.at_least is None and self.failing:
            return False
        rates = [self.found.rates[ALL, law] for law in self.campaign.judged]
        return all(keeps_enough(rate, self.at_least) for rate in rates)

    @property
    def advice(self) -> str:
        """How to go on after an interrupt."""
        return (
            f"interrupted: {self._done} of {self.campaign.specification.shards} parts are done; "
            "the same command with --resume runs the others"
        )


@dataclass
class WorstQuestion(Question):
    """Which plant is the worst under each law?

    Attributes:
        runs: Question of the campaign's runs, of which the worst ones begin the search.
        evaluations: Runs that the search may take for a law; as many random plants are tried.
        plants: The worst plant under each law.
        done: Whether the search has ended.
    """

    runs: RunsQuestion
    evaluations: int
    plants: list[WorstPlant] = field(default_factory=list)
    done: bool = False

    def __post_init__(self) -> None:
        self.path = self.runs.folder.path / WORST

    def measure(self) -> None:
        """Search for the worst plant under each law."""
        campaign = self.runs.campaign
        worst_runs = self.runs.found.worst
        with screen.progress(2 * self.evaluations * len(campaign.judged), "runs") as advance:
            for law in campaign.judged:
                advance_law = partial(advance, f"worst under {law}")
                found = worst(campaign, law, worst_runs[law], self.evaluations, advance_law)
                self.plants.append(found)
                self.runs.note(law, found)
        self.done = True

    def result(self, *, complete: bool) -> Result | None:
        """Return the worst plants that are found."""
        if not self.plants:
            return None
        result = worst_result(self.runs.campaign, self.plants)
        return result if complete else result.unfinished(self.missing)

    @property
    def missing(self) -> Sequence[str]:
        """Laws under which the search has not ended."""
        laws = list(self.runs.campaign.judged)[len(self.plants) :]
        return [f"worst plant under {law}" for law in laws]

    @property
    def advice(self) -> str:
        """How to go on after an interrupt."""
        return screen.RESUME


@dataclass
class RadiusQuestion(Question):
    """How far may the uncertainty grow under each law?

    Attributes:
        runs: Question of the campaign's runs.
        radii: Radius of each law.
        done: Whether the search has ended.
    """

    runs: RunsQuestion
    radii: list[Radius] = field(default_factory=list)
    done: bool = False

    def __post_init__(self) -> None:
        self.path = self.runs.folder.path / RADIUS

    def measure(self) -> None:
        """Search how far the uncertainty may grow under each law."""
        campaign = self.runs.campaign
        with screen.progress(len(campaign.judged), "controllers") as advance:
            for law in campaign.judged:
                words = f"radius under {law}"
                advance(words, 0)
                # The search says how many plants it has tried; the bar counts laws.
                found = radius(campaign, law, lambda _, words=words: advance(words, 0))
                self.radii.append(found)
                self.runs.note(law, found)
                advance(words)
        self.done = True

    def result(self, *, complete: bool) -> Result | None:
        """Return the radii that are found."""
        if not self.radii:
            return None
        result = radius_result(self.runs.campaign, self.radii)
        return result if complete else result.unfinished(self.missing)

    @property
    def missing(self) -> Sequence[str]:
        """Laws whose radius is not found."""
        laws = list(self.runs.campaign.judged)[len(self.radii) :]
        return [f"radius under {law}" for law in laws]

    @property
    def advice(self) -> str:
        """How to go on after an interrupt."""
        return screen.RESUME


@dataclass
class CampaignQuestion(Question):
    """Do the laws hold, by the runs of a campaign and by searches from the worst of them?

    The answer comes when all is done, so that it begins with both.

    Attributes:
        runs: Question of the runs.
        searches: Questions of the searches.
        axes: Two uncertain numbers of the map; empty for those that drive margins most.
        figures: Whether the figures are drawn.
    """

    runs: RunsQuestion
    searches: Sequence[WorstQuestion | RadiusQuestion]
    axes: tuple[str, ...]
    figures: bool
    _current: Question = field(init=False)

    def __post_init__(self) -> None:
        self.path = self.runs.path
        self._current = self.runs

    @property
    def files(self) -> Sequence[Path]:
        """Results of the searches."""
        return [search.path for search in self.searches]

    def measure(self) -> None:
        """Run what is missing, then search from the worst runs."""
        self.runs.measure()
        for search in self.searches:
            self._current = search
            search.measure()

    def result(self, *, complete: bool) -> Result | None:
        """Return the statements of the runs, with what the searches found."""
        return self.runs.result(complete=complete)

    @property
    def missing(self) -> Sequence[str]:
        """Parts of the runs, then searches by law."""
        names = list(self.runs.missing)
        for search in self.searches:
            names += search.missing
        return names

    def show(self, result: Result, *, full: bool, among: bool) -> None:
        """Write and print the results of the runs and of the searches."""
        super().show(result, full=full, among=among)
        for search in self.searches:
            # Of an interrupted search there is what it had found.
            found = search.result(complete=search.done)
            if found is not None:
                search.show(found, full=full, among=among)

    def close(self) -> None:
        """Draw the figures of all answers."""
        if not self.figures:
            return
        radii: list[Radius] = []
        for search in self.searches:
            if isinstance(search, RadiusQuestion):
                radii = search.radii
        files = write_figures(
            self.runs.campaign, self.runs.folder, self.runs.found, radii, self.axes
        )
        screen.say_files(screen.console(), *files)

    @property
    def kept(self) -> bool:
        """Whether each law keeps what is asked for in the runs."""
        return self.runs.kept

    @property
    def advice(self) -> str:
        """How to go on after an interrupt."""
        return self._current.advice


def notices(campaign: Campaign) -> list[str]:
    """Return the notes on a campaign, and a line on another integrator."""
    lines: list[str] = []
    if campaign.plant.restepped:
        lines.append(
            f"Steps by {campaign.experiment.settings.integrator} instead of the model's own "
            "integrator, which may judge some plants otherwise."
        )
    lines.extend(campaign.notes)
    return lines


class _FinishedRuns:
    """Progress of runs: how fast they are, and what share of them keeps everything."""

    def __init__(self, advance: Callable[[str, int], object], start: float) -> None:
        self._advance = advance
        self._start = start
        self._runs = 0

    def __call__(self, runs: int, rates: Mapping[str, float]) -> None:
        """Count runs of a part that is finished.

        Args:
            runs: Number of them.
            rates: Share of all finished runs that keeps everything, by law.
        """
        self._runs += runs
        speed = self._runs / (time.perf_counter() - self._start)
        shares = ", ".join(f"{law} {100 * rate:.1f} %" for law, rate in rates.items())
        self._advance(f"{speed:.3g} runs/s; kept so far: {shares}", runs)


def _speed_line(
    campaign: Campaign,
    runs: int,
    seconds: float,
    repeated: int,
) -> str:
    """Return a line on how many runs and timesteps a second were made."""
    steps = runs * campaign.duration / campaign.experiment.settings.timestep
    line = (
        f"{counted(runs, 'run')} of {campaign.duration:g} s in {seconds:.1f} s: "
        f"{runs / seconds:.3g} runs and {steps / seconds:.3g} timesteps a second"
    )
    if repeated:
        line += f"; {counted(repeated, 'part was', 'parts were')} run again"
    return f"{line}."
