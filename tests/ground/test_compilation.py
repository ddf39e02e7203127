"""The disk cache of compiled code: what it follows, and what several processes make of it."""

from __future__ import annotations

import ast
import enum
import inspect
import os
import re
import subprocess
import sys
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cloudpickle
import numba
import numpy as np
import pytest

from grosmc_mj.ground.compilation.compiler import compile_c, fingerprint
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.compilation.structures import array_at
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.task import NoNumbers

ROOT = Path(__file__).resolve().parents[2]


def command(law: Callable[..., Any], plant: Any) -> float:
    """The law's first input, from compiled code."""
    return simulate(plant, Controller("k", law, NoNumbers()), [0, 0], duration=1e-3).command[0]


def returned(law: Any) -> float:
    """What a law writes, compiled anew or taken from the disk."""
    function, result = compile_c(law, numba.types.voidptr), np.ones(1)
    function.ctypes(result.ctypes.data)
    return result[0]


# A law in one module, a function that it calls in another.
HELPER = "def gain(x):\n    return {k} * x\n"
RETURNED = f"""
import math, sys
from typing import Any
import numba, numpy as np
from grosmc_mj.ground.compilation.compiler import compile_c
from grosmc_mj.ground.compilation.structures import array_at

{inspect.getsource(returned)}
"""
LAW = f"""{RETURNED}
import helper
from grosmc_mj.ground.compilation.jitable import jitable

gain = jitable(helper.gain)

def law(address):
    array_at(address, (1,), np.float64)[0] = gain(2.0)

print(returned(law))
"""
# Functions of one name: one is too long to be inlined and called by its name, one calls itself.
NAMESAKES = """
def law_of(k, name):
    @numba.njit
    def long(x):
        SINES
        return k + 0.0 * x

    @numba.njit
    def recursive(x):
        return k if x < 1.0 else recursive(x - 1.0)

    inner = {"long": long, "recursive": recursive}[name]

    def control(address):
        result = array_at(address, (1,), np.float64)
        result[0] = inner(result[0] + inner(result[0]))

    return control

for k in sys.argv[1:]:
    print(returned(law_of(float(k), "long")), returned(law_of(float(k), "recursive")))
""".replace("SINES", "; ".join(200 * ["x = math.sin(x) * x"]))


PRINTS = """
from grosmc_mj.ground.compilation.compiler import fingerprint
from grosmc_mj.theory.control.switching import SWITCHINGS
print(*(fingerprint(kind.reach) for kind in SWITCHINGS.values()))
"""


def start(folder: Path, program: str, *arguments: str) -> subprocess.Popen[str]:
    """A process that calls what it compiles or takes from the cache of a folder."""
    paths = os.pathsep.join(map(str, (folder, ROOT)))
    env = {
        **os.environ,
        "PYTHONPATH": paths,
        "NUMBA_CACHE_DIR": str(folder / "cache"),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.Popen(command, cwd=folder, env=env, stdout=subprocess.PIPE, text=True)


def printed(process: subprocess.Popen[str]) -> list[str]:
    said, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    return said.split()


def entries(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Every file of the cache: when it was written, and its content."""
    files = folder.rglob("*.nb?")
    return {file.name: (file.stat().st_mtime_ns, file.read_bytes()) for file in files}


class Edited(NamedTuple):
    """Outputs and cache of processes: two at once, one with another gain, one with the first."""

    together: list[list[str]]
    entries_together: dict[str, tuple[int, bytes]]
    edited: list[str]
    entries_edited: dict[str, tuple[int, bytes]]
    restored: list[str]
    entries_restored: dict[str, tuple[int, bytes]]


@pytest.fixture(scope="module")
def edited(tmp_path_factory: pytest.TempPathFactory) -> Edited:
    """Run a law in processes of one cache, while its helper is edited."""
    folder = tmp_path_factory.mktemp("edited")
    helper = folder / "helper.py"
    helper.write_text(HELPER.format(k=3.0), encoding="utf-8")
    processes = [start(folder, LAW) for _ in range(2)]
    together = [printed(process) for process in processes]
    entries_together = entries(folder)

    helper.write_text(HELPER.format(k=5.0), encoding="utf-8")
    edited = printed(start(folder, LAW))
    entries_edited = entries(folder)

    helper.write_text(HELPER.format(k=3.0), encoding="utf-8")
    restored = printed(start(folder, LAW))
    entries_restored = entries(folder)
    return Edited(together, entries_together, edited, entries_edited, restored, entries_restored)


@pytest.mark.slow
def test_two_processes_fill_one_cache(edited: Edited) -> None:
    assert edited.together == [["6.0"], ["6.0"]]
    assert {Path(name).suffix for name in edited.entries_together} == {".nbi", ".nbc"}


@pytest.mark.slow
def test_an_edited_helper_is_noticed(edited: Edited) -> None:
    """numba's own cache looks at the law's file alone, and would go on with the old gain."""
    assert edited.edited == ["10.0"]
    assert edited.entries_edited.items() > edited.entries_together.items()


@pytest.mark.slow
def test_a_helper_edited_back_is_taken_from_the_cache(edited: Edited) -> None:
    assert edited.restored == ["6.0"]
    assert edited.entries_restored == edited.entries_edited


# Gains of the laws of a process; the third one finds the laws of the first two in the cache.
GAINS = [("1",), ("2",), ("1", "2")]


@pytest.fixture(scope="module")
def namesakes(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, ...], list[str]]:
    """Return what processes of one cache print, one after the other."""
    folder = tmp_path_factory.mktemp("namesakes")
    program = RETURNED + NAMESAKES
    return {gains: printed(start(folder, program, *gains)) for gains in GAINS}


@pytest.mark.slow
@pytest.mark.parametrize("gains", GAINS, ids=" ".join)
def test_laws_of_one_name_that_two_processes_compiled_stay_apart(
    gains: tuple[str, ...], namesakes: dict[tuple[str, ...], list[str]]
) -> None:
    """numba numbers the functions of every process from 1 and links them by these names.

    What calls itself does so by an address of its process, and cannot be loaded by another.
    """
    assert namesakes[gains] == [f"{gain}.0" for gain in gains for _ in range(2)]


def laws_of(k: float) -> list[Callable[..., float]]:
    """Laws that return k by whatever numba freezes: helpers, arrays, defaults, modules, members."""
    helper, compiled, gains = jitable(lambda x: k * x), numba.njit(lambda x: k * x), np.array([k])
    module: Any = types.ModuleType("helpers")
    vars(module).update(k=k / 2, helper=jitable(lambda x: k / 2 * x))
    level = Level(k)

    def by_default(t: float, x: Any, memory: Any, p: Any, gain: float = k) -> float:
        return gain

    return [
        lambda t, x, memory, p: helper(x[0] + 1.0),
        lambda t, x, memory, p: compiled(x[0] + 1.0),
        lambda t, x, memory, p: gains[0],
        by_default,
        lambda t, x, memory, p: module.helper(1.0) + module.k,
        lambda t, x, memory, p: level.value * 1.0,
    ]


class Level(enum.Enum):
    LOW = 3.0
    HIGH = 7.0


def fingerprints(k: float) -> list[str]:
    """Return the fingerprints of all laws that return k."""
    return [fingerprint(law) for law in laws_of(k)]


def test_a_fingerprint_follows_every_number_that_numba_freezes() -> None:
    """Otherwise a changed law runs the old machine code from the disk, without a word."""
    pairs = zip(fingerprints(3.0), fingerprints(7.0), strict=True)
    assert all(low != high for low, high in pairs)


def test_equal_laws_have_one_fingerprint() -> None:
    assert fingerprints(3.0) == fingerprints(3.0)


def test_a_fingerprint_follows_the_formula_of_a_law() -> None:
    """It has other operations, or other constants."""
    laws = [lambda x: x + 2.0, lambda x: x * 2.0, lambda x: x + 3.0]
    assert len({fingerprint(law) for law in laws}) == 3


@pytest.mark.slow
def test_another_process_has_the_same_fingerprints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    printed_elsewhere = printed(start(tmp_path, PRINTS))
    exec(PRINTS, {})
    assert capsys.readouterr().out.split() == printed_elsewhere


def commands(k: float) -> list[float]:
    """Return the first inputs, in MuJoCo and by equations, of a law that has travelled by value.

    It is compiled where it arrives.
    """
    law = cloudpickle.loads(cloudpickle.dumps(laws_of(k)[2]))
    plant = MujocoPlant.load("servo")
    return [command(law, plant), command(law, plant.analytic())]


def test_a_new_law_is_one_entry_of_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is compiled alone, and once for equations and MuJoCo."""
    # All that laws share is compiled with the first one.
    assert commands(3.0) == [3.0, 3.0]
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert commands(7.0) == [7.0, 7.0]
    (entry,) = tmp_path.rglob("*.nbi")
    assert entry.name.startswith("sample-")


def test_an_equal_law_made_anew_is_not_compiled_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert commands(3.0) == [3.0, 3.0]
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert commands(3.0) == [3.0, 3.0]
    assert not list(tmp_path.rglob("*.nbi"))


def first_half(content: bytes) -> bytes:
    return content[: len(content) // 2]


def unreadable(content: bytes) -> bytes:
    return b"cut"


def harmful(content: bytes) -> bytes:
    """Return a pickle that names a function of the operating system."""
    return b"\x80\x05cos\nsystem\n"


@pytest.mark.parametrize("damaged", [first_half, unreadable, harmful])
@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_a_damaged_entry_of_the_cache_is_compiled_again(
    kind: str,
    damaged: Callable[[bytes], bytes],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert returned(store_seven) == 7.0
    (entry,) = tmp_path.rglob(f"*.{kind}")
    entry.write_bytes(damaged(entry.read_bytes()))
    assert returned(store_seven) == 7.0

    # It is mended: the next one reads it, and writes none.
    written = entries(tmp_path)
    assert returned(store_seven) == 7.0
    assert entries(tmp_path) == written


def store_seven(address: Any) -> None:
    array_at(address, (1,), np.float64)[0] = 7.0


# Slices, of which each assignment takes numba a second to compile

# A law of the user's own may return an array.
# A first look for them, since parsing the whole package takes a second.
SLICE_ASSIGNED = re.compile(r"\[[^\]\n]*:[^\]\n]*\] *[-+*/@]?=[^=]")
SLICES_ALLOWED = {("theory/control/law.py", "u[:] = returned")}


def compiled_functions(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    """Functions of a file that it marks or hands over for compilation."""
    handed_over = {
        argument.id
        for call in ast.walk(tree)
        if isinstance(call, ast.Call)
        and ast.unparse(call.func).split(".")[-1]
        in ("jitable", "njit", "compile_c", "compile_python")
        for argument in call.args
        if isinstance(argument, ast.Name)
    }
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            marks = [ast.unparse(mark) for mark in function.decorator_list]
            if function.name in handed_over or any("jit" in mark for mark in marks):
                yield function


def slices_assigned(function: ast.FunctionDef) -> Iterator[str]:
    """Assignments of a function to slices of arrays."""
    for statement in ast.walk(function):
        targets = getattr(statement, "targets", [getattr(statement, "target", None)])
        for target in targets:
            if isinstance(target, ast.Subscript) and any(
                isinstance(part, ast.Slice) for part in ast.walk(target.slice)
            ):
                yield ast.unparse(statement)


def test_compiled_functions_assign_to_no_slices() -> None:
    package = ROOT / "grosmc_mj"
    sources = {file: file.read_text(encoding="utf-8") for file in package.rglob("*.py")}
    found = {
        (file.relative_to(package).as_posix(), assignment)
        for file, source in sources.items()
        if SLICE_ASSIGNED.search(source)
        for function in compiled_functions(ast.parse(source))
        for assignment in slices_assigned(function)
    }
    assert found == SLICES_ALLOWED
