"""Workers do not import modules from the working folder."""

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import sys
from functools import partial
from operator import add
from grosmc_mj.ground.executors import make_executor

if __name__ == "__main__":
    executor = make_executor(sys.argv[1], workers=1)
    print([finished.report for finished in executor.run(partial(add, 1), range(2), print)])
"""
# Modules that a worker imports before any code of this package.
NAMES = ("json", "pickle", "random", "threading", "multiprocessing", "loky", "distributed")


@pytest.mark.slow
@pytest.mark.parametrize("executor", ["processes", pytest.param("dask", marks=pytest.mark.apart)])
def test_modules_in_the_working_folder_are_not_taken_for_libraries(
    executor: str, tmp_path: Path
) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    for name in NAMES:
        marker = folder / f"{name}.ran"
        (folder / f"{name}.py").write_text(f"open({str(marker)!r}, 'w').close()\n")

    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    command = [sys.executable, str(program), executor]
    finished = subprocess.run(command, cwd=folder, capture_output=True, timeout=120, check=False)
    assert list(folder.glob("*.ran")) == []
    assert finished.stdout == b"[1, 2]\n"
    assert finished.returncode == 0
