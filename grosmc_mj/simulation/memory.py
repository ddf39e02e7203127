"""Memory that the records of runs take, and that the machine has."""

from __future__ import annotations

import os

from grosmc_mj.ground.errors import ArgumentError

_GB = 1e9
# Share of the machine's memory from which on a command says what its runs take.
_MUCH = 0.1


def machine_memory() -> int | None:
    """Return the memory of the machine [byte]; None where the system does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return None


def memory_words(size: int, runs: int, steps: int) -> str:
    """Return a clause on the memory that recorded runs take.

    Args:
        size: Size of their records [byte].
        runs: Number of runs.
        steps: Timesteps of each.
    """
    of_runs = f"the record of a run of {steps:,} timesteps takes"
    if runs > 1:
        of_runs = f"the records of {runs:,} runs of {steps:,} timesteps take"
    return f"{of_runs} at least {size / _GB:.3g} GB of memory"


def is_much_memory(size: int) -> bool:
    """Whether records of a size [byte] take so much of the machine's memory that one is told."""
    total = machine_memory()
    return total is not None and size > _MUCH * total


def require_memory(size: int, runs: int, steps: int) -> None:
    """Refuse recorded runs that do not fit into the machine's memory.

    Args:
        size: Size of their records [byte].
        runs: Number of runs.
        steps: Timesteps of each.

    Raises:
        ArgumentError: If the machine has less memory.
    """
    total = machine_memory()
    if total is None or size <= total:
        return
    raise ArgumentError(
        f"{memory_words(size, runs, steps)}, and this machine has {total / _GB:.3g} GB: take a "
        "shorter duration, a longer timestep or fewer runs at once"
    )
