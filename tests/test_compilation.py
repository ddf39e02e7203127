"""The disk cache of compiled code: what it follows, and what several processes make of it."""

from __future__ import annotations

import ast
import enum
import inspect
import os
import subprocess
import sys
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cloudpickle
import numba
import numpy as np
import pytest

from grosmc_mj.compilation import compile_c, fingerprint
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.task import NoNumbers
from grosmc_mj.jitable import jitable
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.structures import array_at

ROOT = Path(__file__).resolve().parents[1]


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
from grosmc_mj.compilation import compile_c
from grosmc_mj.structures import array_at

{inspect.getsource(returned)}
"""
LAW = f"""{RETURNED}
import helper
from grosmc_mj.jitable import jitable

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
from grosmc_mj.compilation import fingerprint
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.physics.mujoco_plant import MujocoPlant
plant = MujocoPlant.load("servo").analytic()
print(*(fingerprint(chapter_controller(name, plant).law) for name in ("lqr", "grosmc")))
"""


def start(folder: Path, program: str, *arguments: str) -> subprocess.Popen[str]:
    """A process that calls what it compiles or takes from the cache of a folder."""
    paths = os.pathsep.join(map(str, (folder, ROOT)))
    env = {**os.environ, "PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(folder / "cache"),
           "PYTHONDONTWRITEBYTECODE": "1"}  # fmt: skip
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


@pytest.mark.slow
def test_processes_share_entries_and_notice_an_edited_helper(tmp_path: Path) -> None:
    """numba's own cache looks at the law's file alone, and would go on with the old gain."""
    helper = tmp_path / "helper.py"
    helper.write_text(HELPER.format(k=3.0), encoding="utf-8")
    together = [start(tmp_path, LAW) for _ in range(2)]
    assert [printed(process) for process in together] == [["6.0"], ["6.0"]]
    written = entries(tmp_path)
    assert {Path(name).suffix for name in written} == {".nbi", ".nbc"}
    helper.write_text(HELPER.format(k=5.0), encoding="utf-8")
    assert printed(start(tmp_path, LAW)) == ["10.0"]
    both = entries(tmp_path)
    assert both.items() > written.items()
    helper.write_text(HELPER.format(k=3.0), encoding="utf-8")
    assert printed(start(tmp_path, LAW)) == ["6.0"]
    assert entries(tmp_path) == both


@pytest.mark.slow
def test_laws_of_one_name_that_two_processes_compiled_stay_apart(tmp_path: Path) -> None:
    """numba numbers the functions of every process from 1 and links them by these names.

    What calls itself does so by an address of its process, and cannot be loaded by another.
    """
    for numbers in ("1",), ("2",), ("1", "2"):
        expected = [f"{k}.0" for k in numbers for _ in range(2)]
        assert printed(start(tmp_path, RETURNED + NAMESAKES, *numbers)) == expected


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


def test_fingerprint_follows_operations_constants_and_every_number_that_numba_freezes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Otherwise a changed law runs the old machine code from the disk, without a word."""
    same, again, others = ([fingerprint(law) for law in laws_of(k)] for k in (3.0, 3.0, 7.0))
    assert same == again
    assert all(one != other for one, other in zip(same, others, strict=True))
    laws = [lambda x: x + 2.0, lambda x: x * 2.0, lambda x: x + 3.0]
    assert len({fingerprint(law) for law in laws}) == 3
    # Another process has the same ones.
    there = printed(start(tmp_path, PRINTS))
    exec(PRINTS, {})
    assert capsys.readouterr().out.split() == there


def test_a_new_law_is_compiled_alone_and_once_for_equations_and_mujoco(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plants = [MujocoPlant.load("servo"), MujocoPlant.load("servo").analytic()]
    for k in (3.0, 7.0):
        # One that has travelled by value is compiled where it arrives.
        law = cloudpickle.loads(cloudpickle.dumps(laws_of(k)[2]))
        assert [command(law, plant) for plant in plants] == [k, k]
        # The second time, after all that they share.
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    (entry,) = tmp_path.rglob("*.nbi")
    assert entry.name.startswith("sample-")


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_a_damaged_entry_of_the_cache_is_compiled_again(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert returned(store_seven) == 7.0
    (entry,) = tmp_path.rglob(f"*.{kind}")
    intact = entry.read_bytes()
    for content in (intact[: len(intact) // 2], b"cut", b"\x80\x05cos\nsystem\n"):
        entry.write_bytes(content)
        assert returned(store_seven) == 7.0
        # It is mended: the next one reads it, and writes none.
        written = entries(tmp_path)
        assert returned(store_seven) == 7.0
        assert entries(tmp_path) == written


def store_seven(address: Any) -> None:
    array_at(address, (1,), np.float64)[0] = 7.0


# Slices, of which each assignment takes numba a second to compile

# A law of the user's own may return an array.
SLICES_ALLOWED = {("control/law.py", "u[:] = returned")}


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
    found = {
        (file.relative_to(package).as_posix(), assignment)
        for file in package.rglob("*.py")
        for function in compiled_functions(ast.parse(file.read_text(encoding="utf-8")))
        for assignment in slices_assigned(function)
    }
    assert found == SLICES_ALLOWED
