"""grosmc-mj compare and bench."""

from __future__ import annotations

import os

from grosmc_mj.cli import screen
from grosmc_mj.cli.commands import Bench, Compare
from grosmc_mj.errors import ArgumentError

# Of the states under each of the edits; a hundred thousand take a minute.
_MOST_STATES, _MOST_EDITS, _MOST_ROUNDS = 10**6, 10**4, 10**4


def compare(command: Compare) -> int:
    """Analytic against physics plants."""
    from grosmc_mj.report.document import write_json
    from grosmc_mj.studies.agreement.measure import AGREEMENT_BOUND, agreements, disagreements
    from grosmc_mj.studies.agreement.report import agreement_table, comparison_document

    ranges = (
        ("states", command.states, 1, _MOST_STATES),
        ("edits", command.edits, 0, _MOST_EDITS),
        ("seed", command.seed, 0, 2**63 - 1),
    )
    for name, value, least, most in ranges:
        if not least <= value <= most:
            raise ArgumentError(f"--{name} {value} must be from {least} to {most}")
    rows = agreements(command.system, seed=command.seed, states=command.states, edits=command.edits)
    found = disagreements(rows)
    target = command.out / f"compare_{command.system}.json"
    write_json(target, comparison_document(rows, found, command.seed))
    console = screen.console()
    console.print(agreement_table(rows))
    for line in found:
        console.print(f"differs: {line}", style="red", soft_wrap=True)
    worst = max(row.acceleration for row in rows if row.variant == "corrected")
    console.print(
        f"Accelerations of the corrected equations and of MuJoCo differ by up to {worst:.1e} of "
        f"the largest term (bound {AGREEMENT_BOUND:.0e}), at {command.states} states of each "
        f"model, seed {command.seed}; {target}"
    )
    return screen.DIFFERS if found else screen.DONE


def bench(command: Bench) -> int:
    """Throughput ratios."""
    from grosmc_mj.bench.loops import benchmark
    from grosmc_mj.bench.tables import throughput_table

    if command.rounds is not None and not 1 <= command.rounds <= _MOST_ROUNDS:
        raise ArgumentError(f"--rounds {command.rounds} must be from 1 to {_MOST_ROUNDS}")
    if command.films:
        return _bench_films(command.rounds or 3)
    if command.campaign:
        return _bench_campaign(command.rounds or 5, command.integrator)
    console = screen.console()
    if command.robot:
        from grosmc_mj.bench.robots import benchmark_robots

        rows = benchmark_robots(command.rounds or 5)
        console.print(throughput_table(rows, "Jaco arms with payloads, Euler"))
        return screen.DONE
    for integrator in [command.integrator] if command.integrator else ["RK4", "implicitfast"]:
        rows = benchmark(integrator, command.rounds or 15)  # pyright: ignore[reportArgumentType]
        console.print(throughput_table(rows, f"cart_pendulum, {integrator}"))
    return screen.DONE


def _bench_films(rounds: int) -> int:
    """Frames per second of a film beside bare ones."""
    from grosmc_mj.bench.films import benchmark_films
    from grosmc_mj.bench.tables import film_rates_table
    from grosmc_mj.films.offscreen.backends import find_backend

    found = find_backend(os.environ.get("MUJOCO_GL"))
    with screen.progress(4 * rounds, "measurements") as advance:
        rows = benchmark_films(found.backend, rounds=rounds, advance=advance)
    screen.console().print(film_rates_table(rows, f"{found.backend}, {found.renderer}"))
    return screen.DONE


def _bench_campaign(rounds: int, integrator: str | None) -> int:
    """A campaign beside the open loop; its workers, time and memory."""
    from grosmc_mj.bench.campaigns import (
        benchmark_campaign,
        costs,
        scalings,
        whole_campaigns,
    )
    from grosmc_mj.bench.tables import costs_table, scalings_table, throughput_table

    console = screen.console()
    # First: a child's largest memory counts that of its parent when it began.
    console.print(costs_table(costs(whole_campaigns())))
    for name in [integrator] if integrator else ["RK4", "implicitfast"]:
        rows = benchmark_campaign(rounds, name)  # pyright: ignore[reportArgumentType]
        console.print(throughput_table(rows, f"cart_pendulum's campaign, {name}"))
    console.print(scalings_table(scalings((1, 2))))
    return screen.DONE
