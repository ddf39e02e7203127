"""Workers do not run what lies in the folder that the user happens to be in."""

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import sys
from functools import partial
from operator import add
from grosmc_mj.executors import make_executor

if __name__ == "__main__":
    executor = make_executor(sys.argv[1], workers=1)
    print([finished.report for finished in executor.run(partial(add, 1), range(2), print)])
"""
# What an interpreter that starts a worker imports before any code of ours.
NAMES = ("json", "pickle", "random", "threading", "multiprocessing", "loky", "distributed")


@pytest.mark.slow
@pytest.mark.parametrize("executor", ["processes", pytest.param("dask", marks=pytest.mark.apart)])
def test_modules_in_the_working_folder_are_not_taken_for_libraries(executor, tmp_path: Path):
    folder, program = tmp_path / "folder", tmp_path / "program.py"
    folder.mkdir()
    program.write_text(PROGRAM)
    for name in NAMES:
        (folder / f"{name}.py").write_text(f"open({str(folder / name)!r} + '.ran', 'w').close()\n")
    command = [sys.executable, str(program), executor]
    done = subprocess.run(command, cwd=folder, capture_output=True, timeout=120, check=False)
    assert list(folder.glob("*.ran")) == []
    assert (done.stdout, done.returncode) == (b"[1, 2]\n", 0)
