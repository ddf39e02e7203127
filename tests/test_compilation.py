"""The disk cache of compiled code, seen by several processes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

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


def start(folder: Path) -> subprocess.Popen[str]:
    """A process that calls the law of a folder, compiled or taken from the cache there."""
    paths = [str(folder), str(Path(__file__).parents[1])]
    return subprocess.Popen(
        [sys.executable, "-c", LAW],
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(paths),
            "PYTHONDONTWRITEBYTECODE": "1",
            "NUMBA_CACHE_DIR": str(folder / "cache"),
        },
        stdout=subprocess.PIPE,
        text=True,
    )


def result_of(process: subprocess.Popen[str]) -> float:
    printed, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    return float(printed)


def entries(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Every file of the cache: when it was written, and its content."""
    return {
        path.name: (path.stat().st_mtime_ns, path.read_bytes()) for path in folder.rglob("*.nb?")
    }


@pytest.mark.slow
def test_an_edited_helper_module_is_noticed(tmp_path: Path) -> None:
    """numba's own cache looks at the law's file alone, and would go on with the old gain."""
    for k in (3.0, 5.0, 3.0):
        (tmp_path / "helper.py").write_text(HELPER.format(k=k), encoding="utf-8")
        assert result_of(start(tmp_path)) == 2 * k
    # The second time the old gain is not compiled again.
    assert len(list(tmp_path.rglob("*.nbi"))) == 2


@pytest.mark.slow
def test_what_two_processes_write_at_once_a_third_one_reads(tmp_path: Path) -> None:
    (tmp_path / "helper.py").write_text(HELPER.format(k=3.0), encoding="utf-8")
    writers = [start(tmp_path) for _ in range(2)]
    assert [result_of(process) for process in writers] == [6.0, 6.0]
    written = entries(tmp_path)
    assert {Path(name).suffix for name in written} == {".nbi", ".nbc"}
    assert result_of(start(tmp_path)) == 6.0
    assert entries(tmp_path) == written
