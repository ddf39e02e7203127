"""The law of a controller as C99: one header and one source file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from grosmc_mj.export.functions import translate
from grosmc_mj.export.loop import (
    hold_output,
    loop_memory,
    measured_states,
    sample_in_loop,
    settled_places,
    software_record,
)
from grosmc_mj.export.program import Function, Program, Table
from grosmc_mj.export.structure import Structure
from grosmc_mj.export.syntax import ExportError
from grosmc_mj.export.templates import rendered
from grosmc_mj.export.values import Array, Number, record_at
from grosmc_mj.simulation.loop.applied import AppliedLoop
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.surface import integrate
from grosmc_mj.theory.plants import Signal, System

# Answers of ``NAME_step``.
UNDEFINED_LAW = 1
UNDEFINED_INPUT = 2


@dataclass(frozen=True, eq=False)
class Written:
    """Functions of a law in C.

    Attributes:
        functions: Their text.
        code: The text with all members that the rest of the file has.
        tables: Tables that they may read.
        step: Function of ``NAME_step``.
        missed: Function of ``NAME_missed``; None without a loop.
        settled: Members of memory that begin with a state, and the index of that state.
    """

    functions: str
    code: str
    tables: Sequence[Table]
    step: Function
    missed: Function | None
    settled: Sequence[tuple[str, int]]


@dataclass(frozen=True)
class LawInC:
    """The C of a controller's law, alone or with the software of its loop.

    Attributes:
        controller: The controller, with its control period in its parameters.
        name: Begin of all names in C.
        system: Signals of the plant.
        period: Control period [s].
        about: Paragraphs of the head comment.
        real: ``double``, or ``float`` in single precision.
        loop: The loop whose estimators, filter and prediction are part of the C; None for the law
            alone, which reads the state.
    """

    controller: Controller
    name: str
    system: System
    period: float
    about: Sequence[str] = ()
    real: str = "double"
    loop: AppliedLoop | None = None

    @property
    def measured(self) -> Sequence[int]:
        """Indices of the states that a step reads."""
        states = range(len(self.system.states))
        return states if self.loop is None else measured_states(self.loop)

    @property
    def signals(self) -> Sequence[Signal]:
        """Signals that a step reads."""
        return [self.system.states[j] for j in self.measured]

    @property
    def remembered(self) -> Any:
        """Dataclass of the C's memory as a run begins."""
        memory = self.controller.memory()
        return memory if self.loop is None else loop_memory(memory, self.loop)

    @property
    def memory(self) -> Structure:
        """The structure of what the law remembers."""
        name = f"{self.name}_memory"
        return Structure(name, self.remembered, "memory->", self.written.code, self.real)

    @property
    def numbers(self) -> Structure:
        """The structure of the law's numbers."""
        parameters = self.controller.parameters
        return Structure(f"{self.name}_numbers", parameters, "p->", self.written.code, self.real)

    @property
    def header(self) -> str:
        """The text of NAME.h."""
        return rendered("law.h", law=self)

    @property
    def undefined(self) -> str:
        """Place in C that is 1 after a sample for which the law is not defined."""
        return "memory->undefined" if self.loop is None else "memory->law.undefined"

    # It is asked for each text, and the name of an FMU is a hash of it.
    @cached_property
    def written(self) -> Written:
        """The functions of the law in C.

        Raises:
            ExportError: If the law has no C.
        """
        if getattr(self.controller.law, "python_only", False):
            raise ExportError(f"{self.controller.name} runs in Python only: it has no C")
        replacements = {}
        if self.real == "float":
            replacements[integrate] = _integrate_by(self.period)
        program = Program(self.name, self.real, self.undefined, replacements)
        step, missed = self._functions(program)
        roots = [step] if missed is None else [step, missed]
        settled = [] if self.loop is None else settled_places(self.loop)
        functions = program.text(roots)
        places = [f"memory->{place}" for place, _ in settled]
        code = "\n".join([functions, self.undefined, *places])
        return Written(functions, code, list(program.tables.values()), step, missed, settled)

    @property
    def source(self) -> str:
        """The text of NAME.c.

        Raises:
            ExportError: If the law has no C.
        """
        return rendered("law.c", law=self, **vars(self.written))

    def _functions(self, program: Program) -> tuple[Function, Function | None]:
        """Functions of ``NAME_step`` and, with a loop, of ``NAME_missed``."""
        memory = record_at("memory->", self.remembered)
        p = record_at("p->", self.controller.parameters)
        u = Array("u", (len(self.system.inputs),))
        count = len(self.measured)
        law = self.controller.law
        if self.loop is None:
            return translate(program, law, Number("t"), Array("x", (count,)), memory, p, u), None
        software = software_record(self.loop, memory, p)
        step = translate(
            program,
            sample_in_loop(law, tuple(self.measured)),
            Number("clock"),
            Array("y", (count,)),
            Array("fresh", (count,)),
            memory,
            software,
            p,
            u,
        )
        return step, translate(program, hold_output, memory, software)


def _integrate_by(period: float) -> Callable[[float, Any], None]:
    """Return the integration of the surface by the control period [s].

    In single precision the difference of two times has an error of 0.4 % of a period of 1 ms after
    100 s.
    """

    def integrate_by_period(t: float, memory: Any) -> None:
        """Bring the integral of the rate up to this sample, a control period after the last."""
        memory.elapsed = 0.0
        if memory.begun:
            memory.elapsed = period
        memory.t = t
        for i in range(len(memory.rate)):
            memory.integral[i] += memory.rate[i] * memory.elapsed

    return integrate_by_period
