"""Memory of the software of its own outputs: one row for each sample of the law."""

from __future__ import annotations

from typing import Any

from grosmc_mj.jitable import jitable
from grosmc_mj.loop.ring import ring_row


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
def before_all(k: int, software: Any) -> int:
    """Number of the sample before the oldest one of which the output is kept at sample k."""
    return max(k - software.sent.shape[0], 0) - 1


@jitable
def sample_in(tick: int, number: int, k: int, software: Any) -> int:
    """Number of the sample whose output is put out in a tick.

    Args:
        tick: A tick before that of sample k.
        number: Sample from which the search begins, not a later one.
        k: Number of the present sample, of which there is no output yet.
        software: Software of the loop.

    Returns:
        The number; -1 before the first sample.
    """
    after = number + 1
    while after < k and software.sent_at[ring_row(after, software.sent_at), 0] <= tick:
        after += 1
    return after - 1


@jitable
def put_out(number: int, j: int, software: Any) -> float:
    """Output of a sample to input j, within the limit that the software knows; -1 for none yet."""
    known = software.inputs[j]
    u = known.rest
    if number >= 0:
        u = software.sent[ring_row(number, software.sent), j]
    return min(known.known_limit, max(-known.known_limit, u))
