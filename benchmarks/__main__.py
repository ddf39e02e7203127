"""Measure the closed loop's throughput as ratios to MuJoCo's own open loop.

All loops are measured in turn in each round; ratios are medians over the rounds. Leave the machine
alone meanwhile.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from benchmarks.campaigns import benchmark_campaign, costs, scalings, whole_campaigns
from benchmarks.loops import benchmark
from benchmarks.machines import benchmark_machines
from benchmarks.robots import benchmark_robots
from benchmarks.tables import costs_table, scalings_table, tables_text, throughput_table
from benchmarks.timing import Throughput
from grosmc_mj.cli import screen
from grosmc_mj.errors import GrosmcError
from grosmc_mj.physics.mujoco_plant import Integrator
from grosmc_mj.results.markdown import replace_marked
from grosmc_mj.results.tables import Table

INTEGRATORS: tuple[Integrator, ...] = ("RK4", "implicitfast")
Answer = tuple[str, list[Table]]


def campaign(rounds: int | None) -> Answer:
    """4096 pendulums beside the open loop, time and memory of whole campaigns, and workers."""
    # Whole campaigns first: a child's largest memory counts that of its parent when it began.
    whole = costs_table(costs(whole_campaigns()))
    rows = {name: benchmark_campaign(rounds or 5, name) for name in INTEGRATORS}
    tables = [throughput_table(rows[name], f"cart_pendulum's campaign, {name}") for name in rows]
    return least(rows.values()), [whole, *tables, scalings_table(scalings((1, 2)))]


def loops(rounds: int | None) -> Answer:
    """The pendulum under the full GROSMC law at every timestep, once and 1024 times at once."""
    rows = {name: benchmark(name, rounds or 15) for name in INTEGRATORS}
    tables = [throughput_table(rows[name], f"cart_pendulum, {name}") for name in rows]
    return least(rows.values()), tables


def robots(rounds: int | None) -> Answer:
    """1024 Jaco arms of dm_control with payloads."""
    rows = benchmark_robots(rounds or 5)
    return least([rows]), [throughput_table(rows, "Jaco arms with payloads, Euler")]


def machines(rounds: int | None) -> Answer:
    """1024 of each shipped machine: gear, friction, motor and stops."""
    rows = benchmark_machines(rounds or 5)
    return least(rows.values()), [throughput_table(rows[case], case) for case in rows]


# Campaigns first, for the memory that they report.
PARTS: dict[str, Callable[[int | None], Answer]] = {
    function.__name__: function for function in (campaign, loops, robots, machines)
}


def least(tables: Iterable[Sequence[Throughput]]) -> str:
    """The least throughput of a compiled closed loop, in words."""
    closed = [
        row
        for rows in tables
        for row in rows
        if row.loop != row.baseline and "Python" not in row.loop
    ]
    slowest = min(closed, key=lambda row: row.ratio)
    return f"Least: {slowest.loop} at {slowest.ratio:.2f} of the rate of {slowest.baseline}."


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
        """The tables of these parts; their answers are printed."""
        answers = [PARTS[name](options.rounds) for name in names]
        for sentence, _ in answers:
            console.print(sentence, style="bold", markup=False)
        return [data for _, part in answers for data in part]

    if options.page:
        try:  # the page's marks are looked for before anything is measured
            replace_marked(options.page, "bench", lambda: tables_text(measured(PARTS)))
        except GrosmcError as error:
            parser.error(str(error))
    else:
        for data in measured(options.parts):
            console.print(data)


if __name__ == "__main__":
    main()
