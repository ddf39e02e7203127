"""The disk cache of compiled code: what it follows, and what several processes make of it."""

from __future__ import annotations

import enum
import os
import subprocess
import sys
import types
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cloudpickle
import numba
import numpy as np
import pytest

from grosmc_mj.compilation import array_at, compile_c, fingerprint
from grosmc_mj.control.controller import Controller
from grosmc_mj.jitable import jitable
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.simulate import simulate

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Nothing:
    nothing: float = 0.0


def command(law: Callable[..., Any], plant: Any) -> float:
    """What the law commands at once."""
    return simulate(plant, Controller("k", law, Nothing()), [0, 0], duration=1e-3).command[0]


# What a user has: a law in one module, a function that it calls in another.
HELPER = "def gain(x):\n    return {k} * x\n"
LAW = """
import numba, numpy as np
import helper
from grosmc_mj.compilation import array_at, compile_c
from grosmc_mj.jitable import jitable

gain = jitable(helper.gain)

def law(address):
    array_at(address, (1,), np.float64)[0] = gain(2.0)

result = np.zeros(1)
function = compile_c(law, numba.types.voidptr)
function.ctypes(result.ctypes.data)
print(result[0])
"""


def start(folder: Path, program: str = LAW, *arguments: str) -> subprocess.Popen[str]:
    """A process that calls what it compiles or takes from the cache of a folder."""
    paths = os.pathsep.join([str(folder), str(ROOT)])
    env = {**os.environ, "PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(folder / "cache"),
           "PYTHONDONTWRITEBYTECODE": "1"}  # fmt: skip
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.Popen(command, cwd=folder, env=env, stdout=subprocess.PIPE, text=True)


def results(process: subprocess.Popen[str]) -> list[float]:
    printed, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    return [float(number) for number in printed.split()]


def entries(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Every file of the cache: when it was written, and its content."""
    files = folder.rglob("*.nb?")
    return {file.name: (file.stat().st_mtime_ns, file.read_bytes()) for file in files}


@pytest.mark.slow
def test_an_edited_helper_module_is_noticed(tmp_path: Path) -> None:
    """numba's own cache looks at the law's file alone, and would go on with the old gain."""
    for k in (3.0, 5.0, 3.0):
        (tmp_path / "helper.py").write_text(HELPER.format(k=k), encoding="utf-8")
        assert results(start(tmp_path)) == [2 * k]
    # The second time the old gain is not compiled again.
    assert len(list(tmp_path.rglob("*.nbi"))) == 2


@pytest.mark.slow
def test_what_two_processes_write_at_once_a_third_one_reads(tmp_path: Path) -> None:
    (tmp_path / "helper.py").write_text(HELPER.format(k=3.0), encoding="utf-8")
    writers = [start(tmp_path) for _ in range(2)]
    assert [results(process) for process in writers] == [[6.0], [6.0]]
    written = entries(tmp_path)
    assert {Path(name).suffix for name in written} == {".nbi", ".nbc"}
    assert results(start(tmp_path)) == [6.0]
    assert entries(tmp_path) == written


# Fingerprints


def law_with(helper: Callable[[float], float]) -> Callable[..., float]:
    def law(t: float, x: Any, memory: Any, p: Any) -> float:
        return helper(x[0] + 1.0)

    return law


def helper_with(k: float) -> Callable[[float], float]:
    @jitable
    def helper(x: float) -> float:
        return k * x

    return helper


def of_module(**names: Any) -> Any:
    module: Any = types.ModuleType("helpers")
    vars(module).update(names)
    return module


def by_array(k: float) -> Callable[..., float]:
    gains = np.array([k, 1.0])
    return lambda t, x, memory, p: gains[0]


def by_default(k: float) -> Callable[..., float]:
    def law(t: float, x: Any, memory: Any, p: Any, gain: float = k) -> float:
        return gain

    return law


def by_module(k: float) -> Callable[..., float]:
    module = of_module(k=k / 2, helper=helper_with(k / 2))
    return lambda t, x, memory, p: module.helper(1.0) + module.k


class Level(enum.Enum):
    LOW = 3.0
    HIGH = 7.0


def by_enumeration(k: float) -> Callable[..., float]:
    level = Level(k)
    return lambda t, x, memory, p: level.value * 1.0


def by_compiled_helper(k: float) -> Callable[..., float]:
    return law_with(numba.njit(lambda x: k * x))


@pytest.mark.parametrize(
    "make",
    [
        lambda k: law_with(helper_with(k)), by_array, by_default, by_compiled_helper, by_module,
        by_enumeration,
    ],
)  # fmt: skip
def test_fingerprint_follows_every_number_that_numba_freezes(make: Any) -> None:
    """Otherwise a changed law runs the old machine code from the disk, without a word."""
    assert fingerprint(make(3.0)) == fingerprint(make(3.0))
    assert fingerprint(make(3.0)) != fingerprint(make(7.0))
    changed = [command(make(k), MujocoPlant.load("servo").analytic()) for k in (3.0, 7.0)]
    assert changed == [3.0, 7.0]


def test_fingerprint_follows_operations_and_constants() -> None:
    laws = [lambda x: x + 2.0, lambda x: x * 2.0, lambda x: x + 3.0]
    assert len({fingerprint(law) for law in laws}) == 3


def test_a_new_law_is_compiled_alone_and_once_for_equations_and_mujoco(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plants = [MujocoPlant.load("servo"), MujocoPlant.load("servo").analytic()]
    for k in (5.0, 6.0):
        law = law_with(helper_with(k))
        assert [command(law, plant) for plant in plants] == [k, k]
        # The second time, after all that they share.
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    (entry,) = tmp_path.rglob("*.nbi")
    assert entry.name.startswith("sample-")


def test_a_law_that_has_travelled_is_compiled_where_it_arrives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By value, as laws of one's own do that no module has."""
    law = by_array(2.0)
    for folder in ("here", "there"):
        # Where nothing is compiled yet.
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / folder))
        assert command(law, MujocoPlant.load("servo").analytic()) == 2.0
        law = cloudpickle.loads(cloudpickle.dumps(law))


PRINT = """
from grosmc_mj.compilation import compile_c, fingerprint
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.experiments.catalogue import chapter_controller
plant = MujocoPlant.load("arm").analytic()
print(*(fingerprint(chapter_controller(name, plant).law) for name in ("lqr", "grosmc")))
"""


def test_fingerprint_is_the_same_in_another_process(capsys: pytest.CaptureFixture[str]) -> None:
    """Or nothing would ever be found in the cache on disk."""
    env = {**os.environ, "PYTHONHASHSEED": "1", "PYTHONPATH": str(ROOT)}
    there = subprocess.check_output([sys.executable, "-c", PRINT], cwd=ROOT, env=env, text=True)
    exec(PRINT, {})
    assert capsys.readouterr().out == there
    assert len(set(there.split())) == 2


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
@pytest.mark.parametrize("content", [b"", b"cut", b"\x80\x05cos\nsystem\n"])
def test_a_damaged_entry_of_the_cache_is_compiled_again(
    kind: str, content: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))

    def returned() -> float:
        """Compiled anew or taken from the disk."""
        function, result = compile_c(store_seven, numba.types.voidptr), np.zeros(1)
        function.ctypes(result.ctypes.data)
        return result[0]

    assert returned() == 7.0
    (entry,) = tmp_path.rglob(f"*.{kind}")
    intact = entry.read_bytes()
    entry.write_bytes(content or intact[: len(intact) // 2])
    assert returned() == 7.0
    # It is mended: the next one reads it, and writes none.
    written = entries(tmp_path)
    assert returned() == 7.0
    assert entries(tmp_path) == written


def store_seven(address: Any) -> None:
    array_at(address, (1,), np.float64)[0] = 7.0


COMPILE_NAMESAKES = """
import math, sys
import numba, numpy as np
from grosmc_mj.compilation import array_at, compile_c

def law_of(k):
    # Too long to be inlined: it is called by its name.
    @numba.njit
    def long(x):
        SINES
        return k + 0.0 * x

    @numba.njit
    def recursive(x):
        return k if x < 1.0 else recursive(x - 1.0)

    inner = INNER

    def control(address):
        result = array_at(address, (1,), np.float64)
        result[0] = inner(result[0] + inner(result[0]))

    return control

for k in sys.argv[1:]:
    function, result = compile_c(law_of(float(k)), numba.types.voidptr), np.ones(1)
    function.ctypes(result.ctypes.data)
    print(result[0])
""".replace("SINES", "; ".join(200 * ["x = math.sin(x) * x"]))


@pytest.mark.slow
@pytest.mark.parametrize("inner", ["long", "recursive"])
def test_laws_of_one_name_that_two_processes_compiled_stay_apart(
    inner: str, tmp_path: Path
) -> None:
    """numba numbers the functions of every process from 1 and links them by these names.

    What calls itself does so by an address of its process, and cannot be loaded by another.
    """
    program = COMPILE_NAMESAKES.replace("INNER", inner)
    for numbers in ("1",), ("2",), ("1", "2"):
        assert results(start(tmp_path, program, *numbers)) == [float(k) for k in numbers]
