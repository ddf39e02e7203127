"""The law of a controller as C99: one header and one source file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from grosmc_mj.control.controller import Controller
from grosmc_mj.control.surface import integrate
from grosmc_mj.export.c_text import INDENT, comment, wrapped
from grosmc_mj.export.program import Function, Program
from grosmc_mj.export.statements import function_in_c
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
        name = self.name
        guard = f"{name.upper()}_H"
        lines = [*self._head(), f"#ifndef {guard}", f"#define {guard}", ""]
        lines += ["/* Numbers of the law. */"]
        lines += definition(self.controller.parameters, f"{name}_numbers", self.real)
        lines += [f"extern const struct {name}_numbers {name}_numbers;", ""]
        lines += ["/* What the law remembers from one sample to the next. */"]
        lines += definition(self.remembered, f"{name}_memory", self.real)
        lines += [*comment(self._about_init), f"{self._init};", ""]
        lines += comment(
            f"{self._about_step} Returns 0, {UNDEFINED_LAW} where the law is not defined, "
            f"{UNDEFINED_INPUT} where an input is not finite."
        )
        lines += [*wrapped(f"{self._step};", 0), "", *self._further_declarations]
        lines += ["#endif", ""]
        return "\n".join(lines)

    @property
    def source(self) -> str:
        """The text of NAME.c."""
        name = self.name
        program, law = self._law
        suffix = program.suffix
        further = self._further_functions
        functions = program.text([law, *further.values()])
        lines = [f'#include "{name}.h"', "", _GUARDS]
        lines += [f"const struct {name}_numbers {name}_numbers = {{"]
        lines += [*initial(self.controller.parameters, suffix), "};", ""]
        if "p->" in functions:
            lines += [f"static const struct {name}_numbers *const p = &{name}_numbers;", ""]
        lines += [functions]
        lines += [self._init, "{", f"{INDENT}*memory = (struct {name}_memory){{"]
        lines += [*initial(self.remembered, suffix, 2), f"{INDENT}}};"]
        lines += [*self._settled, "}", ""]
        lines += [*wrapped(self._step, 0), "{", *self._step_body(law), "}", ""]
        for declaration, function in further.items():
            lines += [declaration, "{", f"{INDENT}{function.name}(memory);", "}", ""]
        return "\n".join([*self._head(), *lines])

    @property
    def _init(self) -> str:
        """Declaration of ``NAME_init``."""
        return f"void {self.name}_init(struct {self.name}_memory *memory)"

    @property
    def _about_init(self) -> str:
        """Comment on ``NAME_init``."""
        return "Begin a run."

    @property
    def _settled(self) -> list[str]:
        """Lines of ``NAME_init`` after the initial values."""
        return []

    @property
    def _about_step(self) -> str:
        """Comment on ``NAME_step``."""
        signals = f"It reads {listed('x', self.system.states)}"
        return (
            f"One sample at the time t [s], {self.period:g} s after the last one. {signals} and "
            f"writes {listed('u', self.system.inputs)}."
        )

    @property
    def _step(self) -> str:
        """Declaration of ``NAME_step``."""
        n = len(self.system.states)
        m = len(self.system.inputs)
        return (
            f"int {self.name}_step({self.real} t, const {self.real} x[{n}], "
            f"struct {self.name}_memory *memory, {self.real} u[{m}])"
        )

    @property
    def _further_declarations(self) -> list[str]:
        """Lines of the header for further functions."""
        return []

    @property
    def _further_functions(self) -> Mapping[str, Function]:
        """Functions of the memory alone that further ones call, by their declarations."""
        return {}

    def _step_body(self, law: Function) -> list[str]:
        """Lines of ``NAME_step``."""
        arguments = list(law.parameters)
        lines = [f"(void){name};" for name in ("t", "x") if name not in arguments]
        if law.needs_memory:
            arguments.append("memory")
        lines += [f"{law.name}({', '.join(arguments)});", "memory->begun = 1;"]
        return [*(INDENT + line for line in lines), *self._answer("memory->")]

    def _answer(self, place: str) -> list[str]:
        """Lines that return what ``NAME_step`` does.

        Args:
            place: Code before the fields of the law's memory.
        """
        finite = [f"isfinite(u[{i}])" for i in range(len(self.system.inputs))]
        lines = [f"if ({place}undefined != 0) {{", f"{INDENT}return {UNDEFINED_LAW};", "}"]
        lines += [f"return {' && '.join(finite)} ? 0 : {UNDEFINED_INPUT};"]
        return [INDENT + line for line in lines]

    def _head(self) -> list[str]:
        """Head comment."""
        lines: list[str] = []
        for paragraph in self.about:
            lines += comment(paragraph)
        return lines


def listed(array: str, signals: Sequence[Any]) -> str:
    """Return names and units of the entries of an array."""
    places = [f"{array}[{i}] {signal.name} [{signal.unit}]" for i, signal in enumerate(signals)]
    return ", ".join(places)


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
