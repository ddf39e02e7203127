"""Accumulation of metrics during a run, so that it need not be recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from grosmc_mj.ground.compilation.records import record_dtype


@dataclass(frozen=True, eq=False)
class Accumulator:
    """Metrics that the engines accumulate at each timestep of a run.

    Attributes:
        note: Jitable (t, x, u, memory, p, values, numbers): accumulate the timestep that begins at
            t [s] in the state x, (n,), under the input u, (m,), of the law with memory and p. It
            changes ``values`` in place and reads ``numbers``.
        start: ``values`` as a run begins, a dataclass of numbers and arrays.
        numbers: Constants of the run, a dataclass of numbers and arrays.
    """

    note: Callable[[float, Any, Any, Any, Any, Any, Any], None]
    start: Any
    numbers: Any

    @property
    def kind(self) -> tuple[Any, ...]:
        """Properties shared by the runs of one batch."""
        return self.note, record_dtype(self.start), record_dtype(self.numbers)
