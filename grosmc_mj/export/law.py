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
from grosmc_mj.export.program import Function, Program
from grosmc_mj.export.syntax import ExportError
from grosmc_mj.export.templates import rendered
from grosmc_mj.export.values import Array, Number, record_at
from grosmc_mj.ground.compilation.records import pack
from grosmc_mj.simulation.loop.applied import AppliedLoop
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.surface import integrate
from grosmc_mj.theory.plants import Signal, System

# Answers of ``NAME_step``.
UNDEFINED_LAW = 1
UNDEFINED_INPUT = 2


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
    def memory_size(self) -> int:
        """Count of the numbers in memory."""
        return pack(self.remembered).size

    @property
    def header(self) -> str:
        """The text of NAME.h."""
        return rendered("law.h", law=self)

    @property
    def undefined(self) -> str:
        """Place in C that is 1 after a sample for which the law is not defined."""
        return "memory->undefined" if self.loop is None else "memory->law.undefined"

    # It is written into files, and the name of an FMU is a hash of it.
    @cached_property
    def source(self) -> str:
        """The text of NAME.c.

        Raises:
            ExportError: If the law has no C.
        """
        self._refuse_impossible()
        replacements = {}
        if self.real == "float":
            replacements[integrate] = _integrate_by(self.period)
        program = Program(self.name, self.real, self.undefined, replacements)
        step, missed = self._functions(program)
        roots = [step] if missed is None else [step, missed]
        return rendered(
            "law.c",
            law=self,
            functions=program.text(roots),
            tables=program.tables.values(),
            step=step,
            missed=missed,
            settled=[] if self.loop is None else settled_places(self.loop),
        )

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

    def _refuse_impossible(self) -> None:
        """Refuse a law that needs more than a controller has."""
        controller = self.controller
        _, workspace = controller.begin()
        if workspace is not None:
            raise ExportError(
                f"{controller.name}: MuJoCo computes M(q) of {self.system.name} at every sample, "
                "and a controller has no MuJoCo: export a law of a system with equations"
            )
        if getattr(controller.law, "python_only", False):
            raise ExportError(f"{controller.name} runs in Python only: it has no C")


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
