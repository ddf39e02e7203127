"""The law of a controller as C99: one header and one source file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from grosmc_mj.control.controller import Controller
from grosmc_mj.control.surface import integrate
from grosmc_mj.export.program import Function, Program
from grosmc_mj.export.statements import function_in_c
from grosmc_mj.export.syntax import ExportError
from grosmc_mj.export.templates import listed, rendered
from grosmc_mj.export.values import Array, Number, record_at
from grosmc_mj.plants import System

# Answers of ``NAME_step``.
UNDEFINED_LAW = 1
UNDEFINED_INPUT = 2


@dataclass(frozen=True)
class LawInC:
    """The C of a controller's law, without a loop.

    Attributes:
        controller: The controller, with its control period in its parameters.
        name: Begin of all names in C.
        system: Signals of the plant.
        period: Control period [s].
        about: Paragraphs of the head comment.
        real: ``double``, or ``float`` in single precision.
    """

    controller: Controller
    name: str
    system: System
    period: float
    about: Sequence[str] = ()
    real: str = "double"

    # Header and source both ask for it.
    @cached_property
    def _law(self) -> tuple[Program, Function]:
        """The C of the law, and its function.

        Raises:
            ExportError: If it has no C.
        """
        self._refuse_impossible()
        program = self._program()
        arguments = [
            Number("t"),
            Array("x", (len(self.system.states),)),
            record_at("memory->", self.remembered),
            record_at("p->", self.controller.parameters),
            Array("u", (len(self.system.inputs),)),
        ]
        return program, function_in_c(program, *program.bound(self.controller.law, arguments, {}))

    @property
    def remembered(self) -> Any:
        """Dataclass of what the law remembers, as a run begins."""
        return self.controller.memory()

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

    def _program(self) -> Program:
        """A program without functions."""
        replacements = {}
        if self.real == "float":
            replacements[integrate] = by_period(self.period)
        return Program(
            memory="memory",
            memory_type=f"struct {self.name}_memory",
            real=self.real,
            replacements=replacements,
            reserved={f"{self.name}_{end}" for end in ("init", "step", "numbers", "memory")},
        )

    @property
    def header(self) -> str:
        """The text of NAME.h."""
        return rendered("law.h", law=self)

    @property
    def source(self) -> str:
        """The text of NAME.c."""
        return rendered("law.c", law=self)

    # Parts of both texts.

    # Whether it has the software of its loop; code before the fields of the law's memory.
    in_loop = False
    place = "memory->"

    @property
    def suffix(self) -> str:
        """Suffix of numbers in this precision."""
        return "f" if self.real == "float" else ""

    @property
    def functions(self) -> str:
        """Functions of ``NAME_step``."""
        program, law = self._law
        return program.text([law])

    @property
    def start(self) -> str:
        """Parameters of ``NAME_init`` after the memory."""
        return ""

    @property
    def settled(self) -> Sequence[str]:
        """Lines of ``NAME_init`` after the initial values."""
        return ()

    @property
    def signals(self) -> str:
        """Parameters of ``NAME_step`` before the memory."""
        return f"{self.real} t, const {self.real} x[{len(self.system.states)}]"

    @property
    def about_signals(self) -> str:
        """Comment on them."""
        return f"t: its time [s]. It reads {listed(self.system.states, 'x')}."

    @property
    def sample(self) -> Sequence[str]:
        """Lines of ``NAME_step`` that write the inputs."""
        return [*self._call("t", "x"), "memory->begun = 1;"]

    def _call(self, *signals: str) -> list[str]:
        """Lines that call the function of a sample."""
        _, law = self._law
        lines = [f"(void){name};" for name in signals if name not in law.parameters]
        arguments = list(law.parameters)
        if law.needs_memory:
            arguments.append("memory")
        return [*lines, f"{law.name}({', '.join(arguments)});"]


def by_period(period: float) -> Any:
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
