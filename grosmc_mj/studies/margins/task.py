"""Margins of a task: how far gain and delay may change until a requirement is no longer kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.studies.margins.changes import (
    DELAY,
    GAIN_DOWN,
    GAIN_UP,
    ChangeSearch,
    search_changes,
)
from grosmc_mj.studies.sweep.draws import drawn_case
from grosmc_mj.studies.sweep.runs import Row, run_rows
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import Plant


@dataclass(frozen=True)
class TaskMargin:
    """Largest change of a loop with which a task is kept under one condition.

    Attributes:
        kind: ``gain down``, ``gain up`` or ``delay``.
        condition: Name of the condition.
        kept: Largest change that is kept in all draws: a factor, 1/factor of ``gain down``, or
            seconds.
        failed: Smallest change that is not kept; infinite if none that was tried fails.
        breaks: Requirement that breaks first, or how the run ended; empty if none fails.
        draws: Draws in which each change was run.
        failing_draws: Draws that do not keep the smallest failing change.
    """

    kind: str
    condition: str
    kept: float
    failed: float
    breaks: str
    draws: int = 1
    failing_draws: int = 0


@dataclass(frozen=True, eq=False)
class Task:
    """A law in a loop under one condition, with its requirements.

    Attributes:
        condition: Name of the condition.
        experiment: Experiment with the loop, which a law that predicts takes for its own.
        plant: The plant.
        plant_name: ``corrected`` or ``physics``.
        law: The law.
        predict: Whether it predicts over the delay of its loop.
        limits: The requirements.
        draws: Draws in which each loop is run; one where nothing is drawn.
        threads: Threads of the runs; 0 for all cores.
    """

    condition: str
    experiment: Experiment
    plant: Plant
    plant_name: PlantName
    law: Controller
    predict: bool
    limits: Sequence[Requirement]
    draws: int = 1
    threads: int = 0

    @property
    def loop(self) -> Loop:
        """The loop as it is."""
        return self.experiment.loop or Loop()

    @property
    def draw_numbers(self) -> range:
        """Numbers of the draws: the first one alone where nothing is drawn."""
        return range(self.draws if self.loop.drawn else 1)

    def breaking(self, loops: Sequence[Loop]) -> list[str]:
        """Run the task in some loops; tell what breaks in each: nothing if all draws keep it.

        Further draws are made only of what the first one keeps.

        Raises:
            GrosmcError: If there can be no such run.
        """
        reasons = self._breaking([(loop, 0) for loop in loops])
        kept = [i for i, reason in enumerate(reasons) if not reason]
        further = list(product(kept, self.draw_numbers[1:]))
        of_draws = self._breaking([(loops[i], draw) for i, draw in further])
        for (i, _), reason in zip(further, of_draws, strict=True):
            reasons[i] = reasons[i] or reason
        return reasons

    def failing_draws(self, loop: Loop) -> int:
        """Return the number of draws of a loop that do not keep the task.

        Raises:
            GrosmcError: If there can be no such run.
        """
        reasons = self._breaking([(loop, draw) for draw in self.draw_numbers])
        return sum(bool(reason) for reason in reasons)

    def _breaking(self, draws: Sequence[tuple[Loop, int]]) -> list[str]:
        """Run draws of loops, by their numbers; tell what breaks in each."""
        if not draws:
            return []
        cases = [drawn_case(self.experiment.varied(loop=loop), draw) for loop, draw in draws]
        rows = [Row(self.law, case=case, plant=self.plant, predict=self.predict) for case in cases]
        outcomes = run_rows(
            self.experiment, rows, self.limits, self.plant_name, threads=self.threads
        )

        reasons = []
        for i in range(len(draws)):
            reason = ""
            if not outcomes.completed[i]:
                reason = f"the run ended: {outcomes['status'][i]}"
            elif outcomes["relative"][i] < 0:
                shares = [share[i] for share in outcomes.shares]
                reason = self.limits[shares.index(min(shares))].name
            reasons.append(reason)
        return reasons

    def margins(self) -> list[TaskMargin]:
        """Search how far gain and delay may change; the task must be kept without a change.

        Raises:
            GrosmcError: If there can be no such run.
        """
        reasons: dict[Loop, str] = {}

        def passing(loops: Sequence[Loop]) -> list[bool]:
            reasons.update(zip(loops, self.breaking(loops), strict=True))
            return [not reasons[loop] for loop in loops]

        timestep = self.experiment.settings.timestep
        searches = [ChangeSearch(kind, timestep) for kind in (GAIN_DOWN, GAIN_UP, DELAY)]
        inputs = [signal.name for signal in self.plant.system.inputs]
        search_changes(searches, self.loop, inputs, passing)

        margins = []
        for search in searches:
            kept, failed = search.bounds
            breaks = ""
            failing_draws = 0
            if search.failed is not None:
                loop = search.loop(self.loop, inputs, search.failed)
                breaks = reasons[loop]
                failing_draws = self.failing_draws(loop)
            margin = TaskMargin(
                kind=search.kind,
                condition=self.condition,
                kept=kept,
                failed=failed,
                breaks=breaks,
                draws=len(self.draw_numbers),
                failing_draws=failing_draws,
            )
            margins.append(margin)
        return margins
