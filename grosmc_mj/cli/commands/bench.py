"""grosmc-mj bench."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.errors import ArgumentError

if TYPE_CHECKING:
    from grosmc_mj.bench.timing import Throughput
    from grosmc_mj.report.tables import TableData

_MOST_ROUNDS = 10**4
_INTEGRATORS = ("RK4", "implicitfast")


@dataclass(frozen=True)
class BenchCommand(Command):
    """Measure the closed loop's throughput as ratios to MuJoCo's own open loop.

    The pendulum runs under the full GROSMC law at every timestep, once and 1024 times at once.
    All loops are measured in turn in each round; ratios are medians over the rounds. Leave the
    machine alone meanwhile.

    Attributes:
        integrator: MuJoCo's integrator; by default both RK4, the model's own, and implicitfast.
        rounds: How often each loop is measured; by default 15 times, robots and
            machines 5 and films 3 times.
        robot: Measure 1024 Jaco arms of dm_control with payloads instead.
        machine: Measure 1024 of each shipped machine instead: gear, friction, motor and stops.
        campaign: Measure a campaign of 4096 pendulums instead, its memory and its workers.
        films: Measure films instead: composed frames per second against bare mujoco.Renderer
            frames of the same size.
        page: Measure all of this, and put the tables between the marks of this page.
    """

    integrator: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None
    rounds: Annotated[int | None, arg(metavar="N", help_behavior_hint="")] = None
    robot: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    machine: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    campaign: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    films: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    page: Annotated[Path | None, arg(metavar="FILE.md", help_behavior_hint="")] = None

    def execute(self) -> int:
        """Measure, print the least ratio and all tables."""
        from grosmc_mj.report.tables import table

        if self.rounds is not None and not 1 <= self.rounds <= _MOST_ROUNDS:
            raise ArgumentError(f"--rounds {self.rounds} must be from 1 to {_MOST_ROUNDS}")
        if self.page is not None:
            return self._write_page(self.page)
        measure = self._loops
        if self.films:
            measure = self._films
        elif self.campaign:
            measure = self._campaign
        elif self.robot:
            measure = self._robots
        elif self.machine:
            measure = self._machines
        words, tables = measure()
        console = screen.console()
        console.print(words, style="bold", markup=False)
        for each in tables:
            console.print(table(*each))
        return screen.DONE

    def _write_page(self, page: Path) -> int:
        """Measure everything, and write it between the page's marks."""
        from grosmc_mj.bench.tables import tables_text
        from grosmc_mj.report.markdown import replace_marked

        if self.robot or self.machine or self.campaign or self.films or self.integrator:
            raise ArgumentError("--page measures everything: leave out what names a part")
        # Campaigns first, for the memory that they tell.
        parts = (self._campaign, self._loops, self._robots, self._machines, self._films)
        said: list[str] = []

        def text() -> str:
            found = [measure() for measure in parts]
            said.extend(words for words, _ in found)
            return tables_text(each for _, tables in found for each in tables)

        replace_marked(page, "bench", text)
        console = screen.console()
        for words in said:
            console.print(words, style="bold", markup=False)
        screen.say_files(console, page)
        return screen.DONE

    def _loops(self) -> tuple[str, list[TableData]]:
        """The pendulum's loops."""
        from grosmc_mj.bench.loops import benchmark
        from grosmc_mj.bench.tables import throughput_table

        found = {
            name: benchmark(name, self.rounds or 15)  # pyright: ignore[reportArgumentType]
            for name in self._integrators
        }
        return _least([row for rows in found.values() for row in rows]), [
            throughput_table(rows, f"cart_pendulum, {name}") for name, rows in found.items()
        ]

    def _robots(self) -> tuple[str, list[TableData]]:
        """Robots with payloads."""
        from grosmc_mj.bench.robots import benchmark_robots
        from grosmc_mj.bench.tables import throughput_table

        rows = benchmark_robots(self.rounds or 5)
        return _least(rows), [throughput_table(rows, "Jaco arms with payloads, Euler")]

    def _machines(self) -> tuple[str, list[TableData]]:
        """Machines as built."""
        from grosmc_mj.bench.machines import benchmark_machines
        from grosmc_mj.bench.tables import throughput_table

        found = benchmark_machines(self.rounds or 5)
        return _least([row for rows in found.values() for row in rows]), [
            throughput_table(rows, case) for case, rows in found.items()
        ]

    def _films(self) -> tuple[str, list[TableData]]:
        """Frames per second of a film beside bare ones."""
        from grosmc_mj.bench.films import benchmark_films
        from grosmc_mj.bench.tables import film_rates_table
        from grosmc_mj.films.offscreen import find_backend

        found, rounds = find_backend(os.environ.get("MUJOCO_GL")), self.rounds or 3
        with screen.progress(4 * rounds, "measurements") as advance:
            rows = benchmark_films(found.backend, rounds=rounds, advance=advance)
        least = min(rows, key=lambda row: row.ratio)
        words = f"A film is made at {least.ratio:.2f} of the rate of {least.what}."
        return words, [film_rates_table(rows, f"{found.backend}, {found.renderer}")]

    def _campaign(self) -> tuple[str, list[TableData]]:
        """A campaign beside the open loop; its workers, time and memory."""
        from grosmc_mj.bench.campaigns import (
            benchmark_campaign,
            costs,
            scalings,
            whole_campaigns,
        )
        from grosmc_mj.bench.tables import costs_table, scalings_table, throughput_table

        # First: a child's largest memory counts that of its parent when it began.
        whole = costs_table(costs(whole_campaigns()))
        found = {
            name: benchmark_campaign(self.rounds or 5, name)  # pyright: ignore[reportArgumentType]
            for name in self._integrators
        }
        tables = [
            throughput_table(rows, f"cart_pendulum's campaign, {name}")
            for name, rows in found.items()
        ]
        workers = scalings_table(scalings((1, 2)))
        return _least([row for rows in found.values() for row in rows]), [whole, *tables, workers]

    @property
    def _integrators(self) -> Sequence[str]:
        """Those that are measured."""
        return (self.integrator,) if self.integrator else _INTEGRATORS


def _least(rows: Sequence[Throughput]) -> str:
    """The least throughput of a compiled closed loop, in words."""
    own = [row for row in rows if row.loop != row.baseline and "Python" not in row.loop]
    least = min(own, key=lambda row: row.ratio)
    return f"Least: {least.loop} at {least.ratio:.2f} of the rate of {least.baseline}."
