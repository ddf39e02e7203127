"""An exported law in QEMU: a simulation samples it like a compiled law, and instructions count."""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import subprocess
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from grosmc_mj.export.compiler import run_compiler, write_law
from grosmc_mj.export.law import LawInC
from grosmc_mj.export.processor.processors import Processor
from grosmc_mj.export.templates import rendered
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import SetupError, one_line

_COMPILER = "arm-none-eabi-gcc"
_SIZE = "arm-none-eabi-size"
_EMULATOR = "qemu-system-arm"
_PACKAGES = "gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"
# Kinds of what the simulation asks, in the program's order.
_BEGIN, _STEP, _MISSED, _STACK = range(4)
# QEMU lets 2^6 ns pass for an instruction, more than a period of the timer: it resolves each.
_SHIFT = 6
_INSTRUCTION = 2**_SHIFT * 1e-9
_PROGRAM = "law.elf"
# Longest time that an answer takes [s].
_LONGEST_ANSWER = 30.0


def missing_tools() -> str:
    """Return what to install for laws on a processor; empty if it is there."""
    missing = [tool for tool in (_COMPILER, _SIZE, _EMULATOR) if shutil.which(tool) is None]
    if not missing:
        return ""
    return f"{', '.join(missing)} missing: apt-get install {_PACKAGES}"


class Size(NamedTuple):
    """Memory of a law on a processor, with what it needs of the C library.

    Attributes:
        code: Code and constants [bytes].
        data: Variables of the C library; the memory of the law is its caller's [bytes].
    """

    code: int
    data: int


@dataclass(eq=False)
class EmulatedLaw:
    """An exported law in a running emulator, which has the memory of one run.

    Attributes:
        law: The law.
        processor: The processor.
        folder: Folder of its program.
        instructions: Instructions of each step so far.
    """

    law: LawInC
    processor: Processor
    folder: Path
    _process: subprocess.Popen[bytes]
    _asked: int
    _answered: int
    instructions: list[float] = field(default_factory=list)

    def begin(self, memory: Array, start: Array) -> None:
        """Begin a run: the memory, flat, shows that of the processor."""
        self._ask(_BEGIN, 0.0, start)
        self._show_memory(self._answer(), memory)

    def step(self, t: float, x: Array, memory: Array, u: Array) -> int:
        """Make one sample of a law alone, see ``CompiledLaw``."""
        return self.step_in_loop(t, x, np.zeros(0), memory, u)

    def step_in_loop(self, clock: float, y: Array, fresh: Array, memory: Array, u: Array) -> int:
        """Make one sample, see ``CompiledLaw``; the memory is the processor's."""
        self._ask(_STEP, clock, np.concatenate([y, fresh]))
        answer = self._answer()
        self.instructions.append(answer[1] / self.processor.clock / _INSTRUCTION)
        u[:] = answer[2 : 2 + len(u)]
        self._show_memory(answer, memory)
        return int(answer[0])

    def missed(self, memory: Array) -> None:
        """Tell a law with its loop that its last output was not sent in time."""
        self._ask(_MISSED, 0.0, np.zeros(0))
        self._show_memory(self._answer(), memory)

    @property
    def size(self) -> Size:
        """Size that the law adds to a program."""
        empty = _link(self.processor, self.folder, [self.folder / "nothing.c"], "nothing.elf")
        code, data = _sizes(self.folder / _PROGRAM)
        code_without, data_without = _sizes(empty)
        return Size(code - code_without, data - data_without)

    @property
    def stack(self) -> int:
        """Largest depth of the stack below the caller of the law so far [bytes]."""
        self._ask(_STACK, 0.0, np.zeros(0))
        return int(self._answer()[0])

    def _show_memory(self, answer: Array, memory: Array) -> None:
        """Write the memory of the processor, which stands behind the inputs in an answer."""
        memory[:] = answer[2 + len(self.law.system.inputs) :]

    def _ask(self, kind: int, when: float, signals: Array) -> None:
        """Send what is asked."""
        request = np.zeros(_asked_size(self.law))
        request[0] = kind
        request[1] = when
        request[2 : 2 + len(signals)] = signals
        os.write(self._asked, request.tobytes())

    def _answer(self) -> Array:
        """Read the answer.

        Raises:
            SetupError: If the emulator has ended, or does not answer.
        """
        wanted = 8 * _answered_size(self.law)
        end = time.monotonic() + _LONGEST_ANSWER
        answer = b""
        while len(answer) < wanted:
            ready, _, _ = select.select([self._answered], [], [], 0.5)
            if ready:
                answer += os.read(self._answered, wanted - len(answer))
            elif self._process.poll() is not None:
                complaint = one_line(
                    (self._process.communicate()[0] or b"").decode(errors="replace")
                )
                raise SetupError(f"{_EMULATOR} has ended: {complaint}")
            elif time.monotonic() > end:
                raise SetupError(f"{_EMULATOR} gave no answer for {_LONGEST_ANSWER:g} s")
        return np.frombuffer(answer)


def _asked_size(law: LawInC) -> int:
    """Count of the numbers in what is asked: kind, time, and signals or a start."""
    return 2 + max(2 * len(law.signals), len(law.system.states))


def _answered_size(law: LawInC) -> int:
    """Count of the numbers in an answer: of the step, ticks, inputs, memory."""
    return 2 + len(law.system.inputs) + len(law.memory.places)


@contextlib.contextmanager
def emulated_law(law: LawInC, processor: Processor, folder: Path) -> Iterator[EmulatedLaw]:
    """Compile a law for a processor and run it in QEMU, as long as the context lasts.

    Args:
        law: The law.
        processor: The processor.
        folder: An empty folder.

    Raises:
        SetupError: If a tool is missing, or the law does not compile.
    """
    missing = missing_tools()
    if missing:
        raise SetupError(missing)
    program = _linked(law, processor, folder)
    for pipe in ("asked", "answered"):
        os.mkfifo(folder / pipe)
    command = [
        _EMULATOR,
        *("-machine", processor.board, "-kernel", program.name, "-display", "none"),
        *("-serial", "none", "-monitor", "none", "-icount", f"shift={_SHIFT}"),
        *("-semihosting-config", "enable=on,target=native"),
    ]
    with contextlib.ExitStack() as stack:
        process = subprocess.Popen(
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            # Ctrl-C is for the command, which ends the emulator.
            start_new_session=True,
        )
        stack.callback(_end, process)
        # Both ends are open here, so that nothing waits for an emulator that has ended.
        pipes = []
        for pipe in ("asked", "answered"):
            pipes.append(os.open(folder / pipe, os.O_RDWR))
            stack.callback(os.close, pipes[-1])
        yield EmulatedLaw(law, processor, folder, process, *pipes)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the emulator."""
    process.kill()
    process.communicate()


def _linked(law: LawInC, processor: Processor, folder: Path) -> Path:
    """Write and link the program of the law."""
    _, source = write_law(law, folder)
    values = {
        "law": law,
        "processor": processor,
        "asked": _asked_size(law),
        "answered": _answered_size(law),
    }
    files = {"main.c": "processor.c", "nothing.c": "nothing.c", "memory.ld": "processor.ld"}
    for name, template in files.items():
        (folder / name).write_text(rendered(template, **values), encoding="utf-8")
    return _link(processor, folder, [source], _PROGRAM)


def _link(processor: Processor, folder: Path, sources: Sequence[Path], name: str) -> Path:
    """Compile and link a program.

    Raises:
        SetupError: If it does not compile.
    """
    flags = [*processor.flags, "-mthumb", "-mfloat-abi=hard"]
    start = subprocess.run(
        [_COMPILER, *flags, "-print-file-name=rdimon-crt0.o"],
        capture_output=True,
        text=True,
        check=True,
    )
    program = folder / name
    command = [
        _COMPILER,
        *flags,
        *("-O2", "-std=gnu99", "-ffp-contract=off", "-ffunction-sections", "-fdata-sections"),
        *(
            "--specs=rdimon.specs",
            "-nostartfiles",
            "-Wl,--gc-sections",
            "-Wl,--no-warn-rwx-segments",
        ),
        *("-T", folder / "memory.ld", folder / "main.c", *sources, start.stdout.strip(), "-lm"),
        *("-o", program),
    ]
    words = run_compiler(command)
    if words:
        raise SetupError(f"{_COMPILER} {words}")
    return program


def _sizes(program: Path) -> tuple[int, int]:
    """Code with constants, and data, of a program [bytes]."""
    answer = subprocess.run([_SIZE, program], capture_output=True, text=True, check=True)
    text, data, bss = answer.stdout.splitlines()[1].split()[:3]
    return int(text) + int(data), int(data) + int(bss)
