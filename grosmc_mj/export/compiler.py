"""The C compiler of this machine, and an exported law as a shared library."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from grosmc_mj.arrays import Array
from grosmc_mj.errors import SetupError, one_line
from grosmc_mj.export.law import LawInC
from grosmc_mj.export.templates import rendered

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
_COMPILERS = ("cc", "gcc", "clang")


def find_compiler() -> str | None:
    """Return the C compiler of this machine; None without one."""
    for name in _COMPILERS:
        path = shutil.which(name)
        if path is not None:
            return path
    return None


@dataclass(frozen=True, eq=False)
class CompiledLaw:
    """An exported law as a function of this process.

    Attributes:
        library: The shared library, which stays loaded.
    """

    library: ctypes.CDLL

    @property
    def address(self) -> int:
        """Address of ``int (double t, const double *x, double *memory, double *u)``."""
        address = ctypes.cast(self.library.law_of_doubles, ctypes.c_void_p).value
        assert address is not None
        return address

    def step(self, t: float, x: Array, memory: Array, u: Array) -> int:
        """Make one sample.

        Args:
            t: Time [s].
            x: State, (n,).
            memory: Memory of the law, flat, which it changes.
            u: Array for the inputs, (m,).

        Returns:
            The answer of ``NAME_step``.
        """
        return self.library.law_of_doubles(ctypes.c_double(t), *_pointers(x, memory, u))

    def begin(self, memory: Array, start: Array) -> None:
        """Begin a run: write memory, flat, for a start, (n,)."""
        self.library.begin_of_doubles(*_pointers(memory, start))

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
    """Write NAME.h and NAME.c into a folder, and return their paths."""
    header = folder / f"{law.name}.h"
    source = folder / f"{law.name}.c"
    header.write_text(law.header, encoding="utf-8")
    source.write_text(law.source, encoding="utf-8")
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
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SetupError(f"{compiler} does not compile {source}: {one_line(done.stderr)}")
    return CompiledLaw(ctypes.CDLL(str(library)))
