"""The law of a controller as C99: one header and one source file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from grosmc_mj.control.controller import Controller
from grosmc_mj.control.surface import integrate
from grosmc_mj.export.c_text import INDENT, comment, wrapped
from grosmc_mj.export.program import Function, Program
from grosmc_mj.export.structures import definition, initial
from grosmc_mj.export.syntax import ExportError
from grosmc_mj.export.values import Array, Number, record_at
from grosmc_mj.plants import System

# Answers of ``NAME_step``.
UNDEFINED_LAW = 1
UNDEFINED_INPUT = 2

_GUARDS = """\
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#ifdef __FAST_MATH__
#error "-ffast-math changes the law: leave it out"
#endif
#if FLT_EVAL_METHOD != 0
#error "numbers must be rounded after every operation: for x86 of 32 bits take -mfpmath=sse"
#endif
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("fp-contract=off")
#else
#pragma STDC FP_CONTRACT OFF
#endif
"""


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
        controller = self.controller
        parameters = controller.parameters
        _, workspace = controller.begin()
        if workspace is not None:
            raise ExportError(
                f"{controller.name}: MuJoCo computes M(q) of {self.system.name} at every sample, "
                "and a controller has no MuJoCo: export a law of a system with equations"
            )
        if getattr(controller.law, "python_only", False):
            raise ExportError(f"{controller.name} runs in Python only: it has no C")

        replacements = {}
        if self.real == "float":
            replacements[integrate] = by_period(self.period)
        program = Program(
            memory="memory",
            memory_type=f"struct {self.name}_memory",
            real=self.real,
            replacements=replacements,
            reserved={f"{self.name}_{end}" for end in ("init", "step", "numbers", "memory")},
        )
        arguments = [
            Number("t"),
            Array("x", (len(self.system.states),), constant=True),
            record_at("memory->", controller.memory()),
            record_at("p->", parameters, constant=True),
            Array("u", (len(self.system.inputs),)),
        ]
        return program, program.function(controller.law, arguments, {})

    @property
    def header(self) -> str:
        """The text of NAME.h."""
        name = self.name
        guard = f"{name.upper()}_H"
        lines = [*self._head(), f"#ifndef {guard}", f"#define {guard}", ""]
        lines += ["/* Numbers of the law. */"]
        lines += definition(self.controller.parameters, f"{name}_numbers", self.real)
        lines += [f"extern const struct {name}_numbers {name}_numbers;", ""]
        lines += ["/* What the law remembers from one sample to the next. */"]
        lines += definition(self.controller.memory(), f"{name}_memory", self.real)
        lines += ["/* Begin a run. */", f"void {name}_init(struct {name}_memory *memory);", ""]
        lines += comment(
            f"One sample at the time t [s], {self.period:g} s after the last one. "
            f"{self._signals()} Returns 0, {UNDEFINED_LAW} where the law is not defined, "
            f"{UNDEFINED_INPUT} where an input is not finite."
        )
        lines += [*wrapped(f"{self._step};", 0), "", "#endif", ""]
        return "\n".join(lines)

    @property
    def source(self) -> str:
        """The text of NAME.c."""
        name = self.name
        program, law = self._law
        suffix = program.suffix
        functions = program.text([law])
        lines = [f'#include "{name}.h"', "", _GUARDS]
        lines += [f"const struct {name}_numbers {name}_numbers = {{"]
        lines += [*initial(self.controller.parameters, suffix), "};", ""]
        if "p->" in functions:
            lines += [f"static const struct {name}_numbers *const p = &{name}_numbers;", ""]
        lines += [functions]
        lines += [f"void {name}_init(struct {name}_memory *memory)", "{"]
        lines += [f"{INDENT}*memory = (struct {name}_memory){{"]
        lines += [*initial(self.controller.memory(), suffix, 2), f"{INDENT}}};", "}", ""]
        lines += [*wrapped(self._step, 0), "{", *self._step_body(law), "}", ""]
        return "\n".join([*self._head(), *lines])

    @property
    def _step(self) -> str:
        """Declaration of ``NAME_step``."""
        n = len(self.system.states)
        m = len(self.system.inputs)
        return (
            f"int {self.name}_step({self.real} t, const {self.real} x[{n}], "
            f"struct {self.name}_memory *memory, {self.real} u[{m}])"
        )

    def _step_body(self, law: Function) -> list[str]:
        """Lines of ``NAME_step``."""
        arguments = [parameter.name for parameter in law.parameters]
        lines = [] if "t" in arguments else ["(void)t;"]
        if law.needs_memory:
            arguments.append("memory")
        lines += [f"{law.name}({', '.join(arguments)});", "memory->begun = 1;"]
        finite = [f"isfinite(u[{i}])" for i in range(len(self.system.inputs))]
        lines += ["if (memory->undefined != 0) {", f"{INDENT}return {UNDEFINED_LAW};", "}"]
        lines += [f"return {' && '.join(finite)} ? 0 : {UNDEFINED_INPUT};"]
        return [INDENT + line for line in lines]

    def _signals(self) -> str:
        """Names and units of states and inputs."""
        states = [f"x[{i}] {s.name} [{s.unit}]" for i, s in enumerate(self.system.states)]
        inputs = [f"u[{i}] {s.name} [{s.unit}]" for i, s in enumerate(self.system.inputs)]
        return f"It reads {', '.join(states)} and writes {', '.join(inputs)}."

    def _head(self) -> list[str]:
        """Head comment."""
        lines: list[str] = []
        for paragraph in self.about:
            lines += comment(paragraph)
        return lines


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
