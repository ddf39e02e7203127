"""grosmc-mj study tolerance."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import FlagCreatePairsOff, Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.targets import TARGET, result_name
from grosmc_mj.errors import ArgumentError

if TYPE_CHECKING:
    from rich.console import Console

    from grosmc_mj.studies.tolerance.measure import Tolerance
    from grosmc_mj.studies.tolerance.setting import Setting

_MOST_SEEDS = 1000


@dataclass(frozen=True)
class ToleranceCommand(Command):
    """Find how much of each imperfection of the loop each law stands.

    For each law and each number of the bench's loop alone (delay, resolution, lag and so on), and
    for all of them together: the largest amount up to which all that the target requires is kept,
    nominal and under its edits and disturbances, or else those of the system's case1 and case2.
    Amounts are searched on the equations, from 1/16 to 1024 times the bench's. Of the least answers
    over the conditions MuJoCo confirms, at both ends, each law's least, those next to a limit and
    some at random; all of a law's once one differs.

    Writes tolerance_NAME.json, .png and .svg to --out; after Ctrl-C what there is of them.

    Attributes:
        target: A system, which means its bench, a case, or a case file; without a loop of its own
            it is studied on its system's bench.
        laws: Laws to study, such as lqr, implicit or "implicit, predicted"; all by default.
        seeds: Runs that must all keep it where noise, jitter or missed samples are random.
        every_end: Confirm both ends of each answer in MuJoCo, under every condition.
        out: Folder for tolerance_NAME.json and the figure.
    """

    target: Annotated[Positional[str], arg(metavar=TARGET, name="target")]
    laws: Annotated[
        tuple[str, ...], arg(metavar="NAME [NAME ...]", help_behavior_hint="(default: all)")
    ] = ()
    seeds: Annotated[int, arg(metavar="N")] = 4
    every_end: Annotated[bool, FlagCreatePairsOff] = False
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")

    def execute(self) -> int:
        """Search, write, print, draw."""
        from grosmc_mj.executors import executor_for
        from grosmc_mj.studies.tolerance.measure import tolerances_of_laws
        from grosmc_mj.studies.tolerance.setting import setting

        if not 1 <= self.seeds <= _MOST_SEEDS:
            raise ArgumentError(f"--seeds {self.seeds} must be from 1 to {_MOST_SEEDS}")
        began = time.perf_counter()
        studied = setting(self.target, self.laws)
        found: dict[int, list[Tolerance]] = {}
        each_has = len(studied.imperfections) * len(studied.conditions)
        with (
            screen.kept_on_interrupt(
                lambda: self._write(studied, _in_order(found), complete=False)
            ),
            screen.progress(len(studied.laws) * each_has, "answers") as advance,
        ):
            executor = executor_for(len(studied.laws))
            for index, rows in tolerances_of_laws(
                studied, self.seeds, executor, screen.notice, every=self.every_end
            ):
                found[index] = rows
                advance(studied.laws[index].name, each_has)
        rows = _in_order(found)
        files = self._write(studied, rows, complete=True)
        console = screen.console()
        _answer(console, studied, rows, full=self.verbose)
        console.print(f"In {time.perf_counter() - began:.1f} s", style="dim")
        screen.say_files(console, *files)
        return screen.DONE

    def _write(
        self, studied: Setting, rows: Sequence[Tolerance], *, complete: bool
    ) -> tuple[Path, ...]:
        """Write document and figure; returns where they are, nowhere without a row."""
        from grosmc_mj.results.document import write_json
        from grosmc_mj.studies.tolerance.document import tolerance_document
        from grosmc_mj.studies.tolerance.figure import write_tolerance_figure

        if not rows:
            return ()
        base = self.out / f"tolerance_{result_name(studied.experiment.path)}"
        target = base.with_suffix(".json")
        write_json(target, tolerance_document(studied, rows, self.seeds, complete=complete))
        figure = write_tolerance_figure(studied, rows, base.with_suffix(".png"))
        return target, figure


def _in_order(found: Mapping[int, Sequence[Tolerance]]) -> list[Tolerance]:
    """What has been found, law by law."""
    return [row for _, rows in sorted(found.items()) for row in rows]


def _answer(console: Console, studied: Setting, rows: Sequence[Tolerance], *, full: bool) -> None:
    """Which law breaks first, who keeps the bench, and what each law stands."""
    from grosmc_mj.studies.tolerance import answers
    from grosmc_mj.studies.tolerance.report import LEGEND, every_answer, tolerance_table

    console.print(answers.verdict(rows), style="bold", markup=False)
    for line in answers.whole_bench(rows):
        console.print(line, markup=False)
    for condition in studied.conditions:
        if others := answers.never_kept(rows, condition.name):
            said = f"Not kept even ideally, {condition.name}: {'; '.join(others)}."
            console.print(said, markup=False)
    found = answers.least(rows)
    if found:
        table, left = tolerance_table("The least over the conditions kept ideally", found)
        console.print(table)
        if left:
            names = "; ".join(left)
            console.print(f"No room for: {names}; --verbose has all.", style="dim", markup=False)
        console.print(LEGEND, style="dim", markup=False)
    asked, differing = answers.disagreements(rows)
    if asked:
        console.print(f"MuJoCo was asked about {asked} answers: {differing} differ.")
    for condition in studied.conditions if full else ():
        if own := answers.least([row for row in rows if row.condition == condition.name]):
            title = f"{condition.name}: {condition.title}"
            screen.wide_console().print(tolerance_table(title, own)[0])
    if full:
        screen.wide_console().print(every_answer(rows))
