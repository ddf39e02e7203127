"""Measure the closed loop's throughput as ratios to MuJoCo's own open loop.

All loops are measured in turn in each round; ratios are medians over the rounds. Leave the machine
alone meanwhile.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.campaigns import benchmark_campaign, costs, scalings, whole_campaigns
from benchmarks.growth import benchmark_growth
from benchmarks.loops import benchmark
from benchmarks.machines import benchmark_machines
from benchmarks.robots import benchmark_robots
from benchmarks.tables import (
    costs_table,
    growth_table,
    scalings_table,
    tables_text,
    throughput_table,
    tuning_table,
)
from benchmarks.timing import Throughput
from benchmarks.tuning import benchmark_tuning
from grosmc_mj.cli import screen
from grosmc_mj.ground.errors import GrosmcError
from grosmc_mj.mechanics.physics.mujoco_plant import Integrator
from grosmc_mj.output.results.markdown import replace_marked
from grosmc_mj.output.results.tables import Table
from grosmc_mj.theory.plants import SYSTEMS

INTEGRATORS: tuple[Integrator, ...] = ("RK4", "implicitfast")
# How the names of compiled closed loops begin.
_COMPILED = ("GROSMC, native", "GROSMC in its loop", "campaign", *(f"{name}: " for name in SYSTEMS))


class Part(NamedTuple):
    """Measurements of one part.

    Attributes:
        sentence: Main number in words.
        tables: All numbers.
    """

    sentence: str
    tables: list[Table]


def campaign(rounds: int | None) -> Part:
    """4096 pendulums beside the open loop, time and memory of whole campaigns, and workers."""
    # Whole campaigns first: the largest memory of a child counts that of its parent at its start.
    whole = costs_table(costs(whole_campaigns()))
    rows = {name: benchmark_campaign(rounds or 5, name) for name in INTEGRATORS}
    tables = [throughput_table(rows[name], f"cart_pendulum's campaign, {name}") for name in rows]
    return Part(least(rows.values()), [whole, *tables, scalings_table(scalings((1, 2)))])


def loops(rounds: int | None) -> Part:
    """The pendulum under the full GROSMC law at every timestep, once and 1024 times at once."""
    rows = {name: benchmark(name, rounds or 15) for name in INTEGRATORS}
    tables = [throughput_table(rows[name], f"cart_pendulum, {name}") for name in rows]
    return Part(least(rows.values()), tables)


def robots(rounds: int | None) -> Part:
    """1024 Jaco arms of dm_control with payloads."""
    rows = benchmark_robots(rounds or 5)
    return Part(least([rows]), [throughput_table(rows, "Jaco arms with payloads, Euler")])


def machines(rounds: int | None) -> Part:
    """1024 of each shipped machine: gear, friction, motor and stops."""
    rows = benchmark_machines(rounds or 5)
    tables = [throughput_table(rows[case], case) for case in rows]
    return Part(least(rows.values()), tables)


def growth(rounds: int | None) -> Part:
    """Cost over runs and timesteps, of systems with more and more states and inputs."""
    rows = benchmark_growth(rounds or 5)
    largest = rows[-1]
    sentence = f"A step of {largest.case} with {largest.states} states: {largest.step:.1f} us."
    return Part(sentence, [growth_table(rows)])


def tuning(rounds: int | None) -> Part:
    """A search for the numbers of LQR on the servo's machine, beside a plain batch of its runs."""
    found = benchmark_tuning(rounds or 3)
    sentence = (
        f"Tuning: {found.beside_batch:.2f} of the runs a second of a plain batch; with racing "
        f"{found.raced:.2f} of the runs of its designs."
    )
    return Part(sentence, [tuning_table(found)])


# Campaigns first, for the memory that they report.
PARTS: dict[str, Callable[[int | None], Part]] = {
    function.__name__: function for function in (campaign, loops, robots, machines, growth, tuning)
}


def least(tables: Iterable[Sequence[Throughput]]) -> str:
    """Least throughput of a compiled closed loop, in words."""
    closed = [row for rows in tables for row in rows if row.loop.startswith(_COMPILED)]
    slowest = min(closed, key=lambda row: row.shipped.median)
    return (
        f"Least: {slowest.loop} at {slowest.shipped.median:.2f} of MuJoCo's open loop as shipped, "
        f"{slowest.untimed.median:.2f} of the one without its clock."
    )


def main() -> None:
    """Measure the named parts, and print them or put them into a page."""
    parser = argparse.ArgumentParser("python -m benchmarks", description=__doc__)
    parser.add_argument("parts", nargs="*", default=["loops"], help=", ".join(PARTS))
    parser.add_argument("--rounds", type=int, help="how often each loop is measured, at least once")
    parser.add_argument("--page", type=Path, help="measure all parts, for the marks of this page")
    options = parser.parse_args()
    for name in options.parts:
        if name not in PARTS:
            parser.error(f"unknown part {name!r}: valid: {', '.join(PARTS)}")
    if options.rounds is not None and not 1 <= options.rounds <= 10_000:
        parser.error(f"--rounds {options.rounds} must be from 1 to 10000")
    console = screen.console()

    def measured(names: Iterable[str]) -> list[Table]:
        """Measure parts, print their main numbers and return their tables."""
        tables = []
        for name in names:
            part = PARTS[name](options.rounds)
            console.print(part.sentence, style="bold", markup=False)
            tables += part.tables
        return tables

    if options.page:
        try:  # the page's marks are looked for before anything is measured
            replace_marked(options.page, "bench", lambda: tables_text(measured(PARTS)))
        except GrosmcError as error:
            parser.error(str(error))
    else:
        for item in measured(options.parts):
            screen.wide_console().print(item)


if __name__ == "__main__":
    main()
