"""A compiled export of a law with its loop in a simulation of the Python engine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.export.compiler import CompiledLaw
from grosmc_mj.export.law_in_simulation import unpack
from grosmc_mj.export.loop import LoopInC
from grosmc_mj.export.structures import size_of
from grosmc_mj.loop.ring import ring_row
from grosmc_mj.simulation.problem import Problem, Record
from grosmc_mj.simulation.python_engine import ClosedLoop
from grosmc_mj.simulation.steppers import Steppers


@dataclass(eq=False)
class _Sampler:
    """The C in place of software and law.

    Attributes:
        compiled: The export.
        places: Indices of the states that it gets measurements of.
        memory: What it remembers, flat.
        run: The loop of the simulation.
        samples: Number of samples so far.
        last: Last output.
    """

    compiled: CompiledLaw
    places: list[int]
    memory: Array
    run: Any = None
    samples: int = 0
    last: Any = None

    def law(self, t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        """Sample the C: it gets what is measured, not the state x that Python has estimated."""
        measured = self.run.measured
        if self.samples > 0:
            sent = self.run.software.sent
            if np.any(sent[ring_row(self.samples - 1, sent)] != self.last):
                self.compiled.missed(self.memory)
        y = measured.y[self.places]
        fresh = measured.fresh[self.places]
        self.compiled.step_in_loop(float(measured.clock[0]), y, fresh, self.memory, u)
        self.last = u.copy()
        self.samples += 1
        # The law's memory comes first.
        unpack(self.memory, memory)


def run_in_loop(problem: Problem, law: LoopInC, compiled: CompiledLaw) -> Record:
    """Run the only simulation of a problem with the C in place of its software and law.

    Args:
        problem: The simulation, with the export's controller and loop.
        law: The export.
        compiled: The same, compiled.
    """
    memory = np.zeros(size_of(law.remembered))
    compiled.begin(memory, np.array(problem.x0[0]))
    sampler = _Sampler(compiled, list(law.measured), memory)
    controller = replace(problem.controllers[0], law=_function_of(sampler))
    problem = replace(problem, controllers=(controller,))

    steppers = Steppers(problem.timestep)
    record = Record.empty(problem, steppers.of(problem.plants[0]).recorded_size)
    closed_loop = ClosedLoop(problem, 0, record, steppers)
    sampler.run = closed_loop.run.loop
    record.status[0] = closed_loop.advance(problem.steps).value
    record.valid[0] = closed_loop.steps
    return record


def _function_of(sampler: _Sampler) -> Any:
    """Law of a sampler: a controller takes a function."""

    def law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        sampler.law(t, x, memory, p, u)

    return law
