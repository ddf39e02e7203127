"""A law with the software of its loop as C: estimators, filter and prediction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array as Numbers
from grosmc_mj.control.memory import Memory
from grosmc_mj.export.law import LawInC
from grosmc_mj.export.program import Function, Program
from grosmc_mj.export.statements import function_in_c
from grosmc_mj.export.templates import listed
from grosmc_mj.export.values import Array, Known, Number, Record, record_at
from grosmc_mj.loop.applied import AppliedLoop
from grosmc_mj.loop.sent import keep_output
from grosmc_mj.loop.software import Software, observe

# Fields that a run changes, of each state and of each estimator.
_OF_STATE = ("observed", "missed", "gained")
_OF_ESTIMATOR = ("y", "rate", "load", "last")
# Arrays that a run changes.
_OF_SOFTWARE = ("sent", "sent_at", "seen", "predicted", "x", "mean", "own")


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
    clock: Numbers
    y: Numbers
    fresh: Numbers
    observed: Numbers
    missed: Numbers
    gained: Numbers
    estimated_y: Numbers
    estimated_rate: Numbers
    estimated_load: Numbers
    estimated_last: Numbers
    sent: Numbers
    sent_at: Numbers
    seen: Numbers
    predicted: Numbers
    x: Numbers
    mean: Numbers
    own: Numbers


@dataclass(frozen=True, kw_only=True)
class LoopInC(LawInC):
    """The C of a controller's law with the software of its loop.

    Attributes:
        loop: The loop around the law.
    """

    loop: AppliedLoop

    @property
    def _software(self) -> Software:
        return self.loop.start.software

    @cached_property
    def measured(self) -> Sequence[int]:
        """Indices of the states that the software needs measurements of."""
        software = self._software
        estimated = set(software.estimators["of"].astype(int).tolist())
        heard = np.any(software.gain != 0.0, axis=0)
        filtered = software.states["filtered"] != 0.0
        estimated |= set(np.flatnonzero(filtered & ~heard).tolist())
        return [j for j in range(len(self.system.states)) if j not in estimated]

    @property
    def remembered(self) -> Any:
        """Dataclass of what law and software remember, as a run begins."""
        software = self._software
        n = len(self.system.states)
        m = len(self.system.inputs)
        e = max(1, len(software.estimators))
        own = np.zeros(1) if self.loop.model is None else self.loop.model.own
        return LoopMemory(
            law=self.controller.memory(),
            k=0.0,
            clock=np.zeros(1),
            y=np.zeros(n),
            # A state that is not measured hides no measurement of another one.
            fresh=np.ones(n),
            observed=np.zeros(n),
            missed=np.zeros(n),
            gained=np.zeros(n),
            estimated_y=np.zeros(e),
            estimated_rate=np.zeros(e),
            estimated_load=np.zeros(e),
            estimated_last=np.zeros(e),
            sent=np.zeros(software.sent.shape),
            sent_at=np.zeros(software.sent_at.shape),
            seen=np.zeros(n),
            predicted=np.zeros(n),
            x=np.zeros(n),
            mean=np.zeros(m),
            own=own.copy(),
        )

    @cached_property
    def _law(self) -> tuple[Program, Function]:
        """The C of a sample, and its function."""
        self._refuse_impossible()
        program = self._program()
        memory, p, software = self._records
        count = len(self.measured)
        arguments = [
            Number("clock"),
            Array("y", (count,)),
            Array("fresh", (count,)),
            memory,
            software,
            p,
            Array("u", (len(self.system.inputs),)),
        ]
        sample = _sample_of(self.controller.law, tuple(self.measured))
        return program, function_in_c(program, *program.bound(sample, arguments, {}))

    @cached_property
    def _records(self) -> tuple[Record, Record, Record]:
        """Memory, numbers of the law, and software."""
        memory = record_at("memory->", self.remembered)
        p = record_at("p->", self.controller.parameters)
        return memory, p, self._software_at(memory, p)

    @property
    def functions(self) -> str:
        """Functions of ``NAME_step`` and ``NAME_missed``."""
        program, law = self._law
        return program.text([law, self.missed])

    @cached_property
    def missed(self) -> Function:
        """Function of ``NAME_missed``."""
        program, _ = self._law
        memory, _, software = self._records
        return function_in_c(program, *program.bound(_hold_output, [memory, software], {}))

    def _software_at(self, memory: Record, p: Record) -> Record:
        """The software's half as a record, with the numbers that no run changes known."""
        software = self._software
        places = memory.members
        members: dict[str, Any] = {name: places[name] for name in _OF_SOFTWARE}
        members["setup"] = _rows(software.setup, {})
        members["inputs"] = _rows(software.inputs, {})
        members["states"] = _rows(software.states, {name: places[name] for name in _OF_STATE})
        changing = {name: places[f"estimated_{name}"] for name in _OF_ESTIMATOR}
        members["estimators"] = _rows(software.estimators, changing)
        members["gain"] = Known(software.gain)
        members["address"] = Known(0)
        if self.loop.model is not None:
            advance = _advance_of(self.loop.model.advance, places["law"], p, places["own"])
            members["advance"] = Known(advance)
        return Record("memory->software", members)

    # Parts of the texts.

    in_loop = True
    place = "memory->law."

    @property
    def start(self) -> str:
        """Parameters of ``NAME_init`` after the memory."""
        return f", const {self.real} start[{len(self.system.states)}]"

    @property
    def settled(self) -> Sequence[str]:
        """Lines of ``NAME_init`` that tell settled estimators the start."""
        software = self._software
        lines = []
        for row, settled in enumerate(software.estimators["settled"].tolist()):
            if settled:
                rate = int(software.estimators["of"][row])
                lines.append(f"memory->estimated_rate[{row}] = start[{rate}];")
        for j, settled in enumerate(software.states["settled"].tolist()):
            if settled:
                lines.append(f"memory->observed[{j}] = start[{j}];")
        return lines or ["(void)start;"]

    @property
    def signals(self) -> str:
        """Parameters of ``NAME_step`` before the memory."""
        size = len(self.measured)
        return f"{self.real} clock, const {self.real} y[{size}], const {self.real} fresh[{size}]"

    @property
    def about_signals(self) -> str:
        """Comment on them."""
        signals = [self.system.states[j] for j in self.measured]
        return (
            "clock: reading of the clock since the first sample, in ticks of "
            f"{self.loop.timestep:g} s. {listed(signals, 'y')}: newest measurements. fresh: how "
            "many measurements the sensor has made since the last sample, at most 1 for one "
            "without a period of its own."
        )

    @property
    def sample(self) -> Sequence[str]:
        """Lines of ``NAME_step`` that write the inputs."""
        return self._call("clock", "y", "fresh")


def _rows(rows: Any, changing: dict[str, Any]) -> tuple[Record, ...]:
    """Rows of numbers as records: those that a run changes are places, all others are known.

    Args:
        rows: The rows.
        changing: Arrays of what a run changes, an entry for each row, by the rows' names.
    """
    records = []
    for number, row in enumerate(rows):
        members: dict[str, Any] = {}
        for name in rows.dtype.names:
            members[name] = Known(float(row[name]))
            if name in changing:
                members[name] = Number(f"{changing[name].code}[{number}]")
        records.append(Record(f"row {id(rows)} {number}", members))
    return tuple(records)


def _sample_of(law: Any, places: tuple[int, ...]) -> Any:
    """Function of one sample: measurements in, inputs out."""

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


def _hold_output(memory: Any, software: Any) -> None:
    """Keep the output before the last one as the one that is held."""
    last = int(memory.k) - 1
    keep_output(last, software.mean, False, memory, software)


def _advance_of(advance: Any, memory: Any, p: Any, own: Any) -> Any:
    """Motion of the design model with the records of this law."""

    def moved(t: float, x: Any, u: Any, h: float, address: Any) -> None:
        """Move the design model."""
        advance(t, x, u, h, memory, p, own)

    return moved
