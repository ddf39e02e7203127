"""The C compiler of this machine, and an exported law as a shared library."""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import signal
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from grosmc_mj.export.law import LawInC
from grosmc_mj.export.templates import rendered
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import SetupError, one_line
from grosmc_mj.ground.files import write_whole

# As strict as a reviewer's build; -ffp-contract=off is for compilers that read no pragma.
FLAGS = (
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Werror",
    "-O2",
    "-ffp-contract=off",
)
# Longest time that a compiler has [s]; a law takes below one.
LONGEST_COMPILATION = 60.0
_COMPILERS = ("cc", "gcc", "clang")


def find_compiler() -> str | None:
    """Return the C compiler of this machine; None without one."""
    for name in _COMPILERS:
        path = shutil.which(name)
        if path is not None:
            return path
    return None


class RunningLaw(Protocol):
    """An exported law that can be sampled: in this process, or on an emulated processor.

    A memory is that of the C, flat. What samples a law gives it the same one from ``begin`` on.
    """

    def begin(self, memory: Array, start: Array) -> None:
        """Begin a run: write the memory for a start, (n,)."""
        ...

    def step(self, t: float, x: Array, memory: Array, u: Array) -> int:
        """Make one sample of a law alone at t [s] and x, (n,), write u, (m,); return the answer."""
        ...

    def step_in_loop(self, clock: float, y: Array, fresh: Array, memory: Array, u: Array) -> int:
        """Make one sample of a law with its loop, see ``CompiledLaw``."""
        ...

    def missed(self, memory: Array) -> None:
        """Tell a law with its loop that its last output was not sent in time."""
        ...


@dataclass(frozen=True, eq=False)
class CompiledLaw:
    """An exported law as a function of this process.

    Attributes:
        library: The shared library, which stays loaded.
    """

    library: ctypes.CDLL

    @property
    def address(self) -> int:
        """Address of ``void (double t, const double *x, double *run, double *u, double *shown)``.

        ``run`` is 1 once the run has begun, the answer of the last step, and the memory of the C,
        see ``run_of``; ``shown`` is the memory of the Python law, flat.
        """
        address = ctypes.cast(self.library.sample_of_doubles, ctypes.c_void_p).value
        assert address is not None
        return address

    def step(self, t: float, x: Array, memory: Array, u: Array) -> int:
        """Make one sample.

        Args:
            t: Time [s].
            x: State, (n,).
            memory: Memory of the C, flat, which it changes.
            u: Array for the inputs, (m,).

        Returns:
            The answer of ``NAME_step``.
        """
        return self.step_in_loop(t, x, x, memory, u)

    def begin(self, memory: Array, start: Array) -> None:
        """Begin a run: write the memory of the C, flat, for a start, (n,)."""
        self.library.begin_of_doubles(*_pointers(memory, start))

    def sample(self, t: float, x: Array, run: Array, u: Array, shown: Array) -> None:
        """Make one sample of a run, see ``address``."""
        self.library.sample_of_doubles(ctypes.c_double(t), *_pointers(x, run, u, shown))

    def missed(self, memory: Array) -> None:
        """Tell a law with its loop that its last output was not sent in time."""
        self.library.missed_of_doubles(*_pointers(memory))

    def step_in_loop(self, clock: float, y: Array, fresh: Array, memory: Array, u: Array) -> int:
        """Make one sample of a law with its loop.

        Args:
            clock: Reading of the clock, in ticks.
            y: Measurements of the states that the software needs.
            fresh: How many of each are new.
            memory: Memory of law and software, flat, which it changes.
            u: Array for the inputs, (m,).

        Returns:
            The answer of ``NAME_step``.
        """
        return self.library.step_of_doubles(ctypes.c_double(clock), *_pointers(y, fresh, memory, u))


def _pointers(*arrays: Array) -> list[ctypes.c_void_p]:
    """Addresses of arrays."""
    return [ctypes.c_void_p(array.ctypes.data) for array in arrays]


def write_law(law: LawInC, folder: Path) -> tuple[Path, Path]:
    """Write NAME.h and NAME.c into a folder, and return their paths.

    Raises:
        SetupError: If one of them cannot be written.
    """
    header = folder / f"{law.name}.h"
    source = folder / f"{law.name}.c"
    write_whole(header, law.header)
    write_whole(source, law.source)
    return header, source


def compile_law(
    law: LawInC,
    folder: Path,
    compiler: str,
    flags: Sequence[str] = FLAGS,
) -> CompiledLaw:
    """Compile an exported law to a shared library, and load it.

    Args:
        law: The law, whose files are in the folder, see ``write_law``.
        folder: Folder for the library.
        compiler: Path of the compiler.
        flags: Options of the compiler.

    Raises:
        SetupError: If it does not compile.
    """
    call = folder / f"{law.name}_call.c"
    call.write_text(rendered("call.c", law=law), encoding="utf-8")
    library = folder / f"{law.name}.so"
    source = folder / f"{law.name}.c"
    command = [compiler, *flags, "-fPIC", "-shared", source, call, "-o", library, "-lm"]
    words = run_compiler(command)
    if words:
        raise SetupError(f"{compiler} {words}")
    try:
        return CompiledLaw(ctypes.CDLL(str(library)))
    except OSError as error:
        raise SetupError(f"{compiler} made no library that loads: {one_line(str(error))}") from None


def run_compiler(command: Sequence[str | Path]) -> str:
    """Run a compiler; return why there is no library, empty if there is one."""
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            # A group of its own: what it starts, such as an assembler, is stopped with it.
            start_new_session=True,
        )
    except OSError as error:
        return f"cannot be started: {error.strerror or error}"
    try:
        complaints = _complaints_in_time(process)
    except subprocess.TimeoutExpired:
        return (
            f"was stopped after {LONGEST_COMPILATION:g} s: mend it, or take it from PATH to write "
            "the law without a proof"
        )
    if process.returncode:
        return f"does not compile the law: {one_line(complaints)}"
    return ""


def _complaints_in_time(process: subprocess.Popen[str]) -> str:
    """Wait for a compiler, and return its messages; it is stopped after the time that it has.

    Raises:
        TimeoutExpired: If it was stopped.
    """
    try:
        _, complaints = process.communicate(timeout=LONGEST_COMPILATION)
    except BaseException:
        # Also after Ctrl-C, which a group of its own does not get.
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        # It closes the pipe, too.
        process.communicate()
        raise
    return complaints
