"""Memory of the software of its own outputs: one row for each sample of the law."""

from __future__ import annotations

from typing import Any

from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.simulation.loop.rows import ring_row


@jitable
def keep_output(k: int, u: Any, in_time: bool, measured: Any, software: Any) -> None:
    """Keep the output of sample k and the instant at which it was sent.

    Args:
        k: Number of the sample, from 0.
        u: Output of the law, (m,).
        in_time: Whether it was sent in time; else the previous one is held.
        measured: What was measured at the sample, with the clock.
        software: Software of the loop.
    """
    row = ring_row(k, software.sent)
    previous = ring_row(k - 1, software.sent)
    software.sent_at[row, 0] = measured.clock[0]
    for j in range(len(software.inputs)):
        if in_time:
            software.sent[row, j] = u[j]
        elif k > 0:
            software.sent[row, j] = software.sent[previous, j]
        else:
            software.sent[row, j] = software.inputs[j].rest


@jitable
def sample_in(tick: int, k: int, software: Any) -> int:
    """Number of the sample whose output is put out in a tick before sample k; -1 before all."""
    number = k - 1
    while number >= 0 and software.sent_at[ring_row(number, software.sent_at), 0] > tick:
        number -= 1
    return number


@jitable
def sample_after(number: int, tick: int, k: int, software: Any) -> int:
    """Number of the sample whose output is put out in a tick, not before that of another one."""
    later = number + 1
    while later < k and software.sent_at[ring_row(later, software.sent_at), 0] <= tick:
        later += 1
    return later - 1


@jitable
def put_out(number: int, j: int, software: Any) -> float:
    """Output of a sample to input j, within the limit that the software knows; -1 for none yet."""
    known = software.inputs[j]
    u = known.rest
    if number >= 0:
        u = software.sent[ring_row(number, software.sent), j]
    return min(known.known_limit, max(-known.known_limit, u))
