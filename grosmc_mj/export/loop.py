"""The software of a loop as part of an exported law: estimators, filter and prediction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.export.values import Number, Record
from grosmc_mj.ground.arrays import Array
from grosmc_mj.simulation.loop.applied import AppliedLoop
from grosmc_mj.simulation.loop.sent import keep_output
from grosmc_mj.simulation.loop.software import Software, observe
from grosmc_mj.theory.control.memory import Memory


@dataclass
class LoopMemory:
    """Memory of the law and of the software around it.

    Attributes:
        law: Memory of the law.
        k: Number of the next sample.
        clock: Reading of the clock at the last sample, in ticks, (1,).
        y: Newest measurement of each state, in its unit, (n,).
        fresh: How many measurements of each state are new, (n,).
        observed: Estimate of each state by the filter, (n,).
        missed: Rate of each state that the design model misses, per second, (n,).
        gained: Change of each state in a period by the design model, (n,).
        estimated_y: Position that each estimator has, one for each estimated rate.
        estimated_rate: Its rate.
        estimated_load: Its disturbance.
        estimated_last: Its last measurement.
        sent: Outputs of the last samples, in the units of the inputs, (a power of two, m).
        sent_at: The clock as each of them was sent, in ticks, (a power of two, 1).
        seen: State by sensors and estimators, (n,).
        predicted: State that the law gets, (n,).
        x: State of the design model, (n,).
        mean: Input under which it moves, (m,).
        own: Room and numbers of the design model.
    """

    law: Memory
    k: float
    clock: Array
    y: Array
    fresh: Array
    observed: Array
    missed: Array
    gained: Array
    estimated_y: Array
    estimated_rate: Array
    estimated_load: Array
    estimated_last: Array
    sent: Array
    sent_at: Array
    seen: Array
    predicted: Array
    x: Array
    mean: Array
    own: Array


def loop_memory(law: Memory, applied: AppliedLoop) -> LoopMemory:
    """Return the memory of a law and of the software around it, as a run begins.

    Args:
        law: Memory of the law.
        applied: The loop.
    """
    software = applied.start.software
    n = len(applied.system.states)
    m = len(applied.system.inputs)
    arrays = {}
    for name in ("y", "observed", "missed", "gained", "seen", "predicted", "x"):
        arrays[name] = np.zeros(n)
    for name in ("y", "rate", "load", "last"):
        # C has no array without entries.
        arrays[f"estimated_{name}"] = np.zeros(max(1, len(software.estimators)))
    return LoopMemory(
        law=law,
        k=0.0,
        clock=np.zeros(1),
        # A state that is not measured hides no measurement of another one.
        fresh=np.ones(n),
        sent=np.zeros(software.sent.shape),
        sent_at=np.zeros(software.sent_at.shape),
        mean=np.zeros(m),
        own=np.zeros(1) if applied.model is None else applied.model.own.copy(),
        **arrays,
    )


def measured_states(applied: AppliedLoop) -> list[int]:
    """Return the indices of the states that the software needs measurements of."""
    software = applied.start.software
    estimated = set(software.estimators["of"].astype(int).tolist())
    heard = np.any(software.gain != 0.0, axis=0)
    filtered = software.states["filtered"] != 0.0
    estimated |= set(np.flatnonzero(filtered & ~heard).tolist())
    return [j for j in range(len(applied.system.states)) if j not in estimated]


def settled_places(applied: AppliedLoop) -> list[tuple[str, int]]:
    """Return the places in memory that begin with the true state, and the index of the state."""
    software = applied.start.software
    places = []
    for row, estimator in enumerate(software.estimators):
        if estimator["settled"]:
            places.append((f"estimated_rate[{row}]", int(estimator["of"])))
    for j, state in enumerate(software.states):
        if state["settled"]:
            places.append((f"observed[{j}]", j))
    return places


def software_record(applied: AppliedLoop, memory: Record, p: Record) -> Record:
    """Return the software's half of a loop, with the numbers that no run changes known.

    A field that ``LoopMemory`` has, too, is a place there.

    Args:
        applied: The loop.
        memory: The ``LoopMemory`` in C.
        p: Numbers of the law in C.
    """
    software = applied.start.software
    places = memory.members
    members: dict[str, Any] = {name: places[name] for name in Software._fields if name in places}
    for name in ("setup", "inputs", "states"):
        members[name] = _rows(getattr(software, name), memory)
    members["estimators"] = _rows(software.estimators, memory, "estimated_")
    members["gain"] = software.gain
    members["address"] = 0
    if applied.model is not None:
        advance = applied.model.advance
        members["advance"] = _advance_of(advance, places["law"], p, places["own"])
    return Record("memory->software", members)


def _rows(rows: Any, memory: Record, prefix: str = "") -> tuple[Record, ...]:
    """Rows of numbers as records: those in memory are places, all others are known.

    Args:
        rows: The rows.
        memory: The ``LoopMemory`` in C.
        prefix: Begin of their names in memory, which has an entry for each row.
    """
    records = []
    for number, row in enumerate(rows):
        members: dict[str, Any] = {}
        for name in rows.dtype.names:
            place = memory.members.get(prefix + name)
            members[name] = float(row[name])
            if place is not None:
                members[name] = Number(f"{place.code}[{number}]")
        records.append(Record(f"row {id(rows)} {number}", members))
    return tuple(records)


def sample_in_loop(law: Any, places: Sequence[int]) -> Any:
    """Return the function of one sample: measurements in, inputs out.

    Args:
        law: The law.
        places: Indices of the states that are measured.
    """

    def sample(
        clock: float, y: Any, fresh: Any, memory: Any, software: Any, p: Any, u: Any
    ) -> None:
        """Estimate the state, ask the law, keep its output."""
        k = int(memory.k)
        memory.clock[0] = clock
        for i in range(len(places)):
            memory.y[places[i]] = y[i]
            memory.fresh[places[i]] = fresh[i]

        t = observe(k, memory, software)
        law(t, software.predicted, memory.law, p, u)
        keep_output(k, u, True, memory, software)
        memory.law.begun = 1.0
        memory.k += 1.0

    return sample


def hold_output(memory: Any, software: Any) -> None:
    """Keep the output before the last one as the one that is held."""
    last = int(memory.k) - 1
    keep_output(last, software.mean, False, memory, software)


def _advance_of(advance: Any, memory: Any, p: Any, own: Any) -> Any:
    """Motion of the design model with the records of this law."""

    def moved(t: float, x: Any, u: Any, h: float, address: Any) -> None:
        """Move the design model."""
        advance(t, x, u, h, memory, p, own)

    return moved
