"""Executors run every shard once, survive their workers, and leave no process behind."""

import importlib.util
import os
import pickle
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import executor_work
import pytest
from commands import Patch
from conftest import hear_interrupts
from loky import cpu_count

from grosmc_mj.errors import ArgumentError, DivergenceError, SetupError
from grosmc_mj.executors import make_executor
from grosmc_mj.executors.pools import Outcome, _run_until_broken, attempt

# A child that has not begun or ended by then never will [s].
SOON = 30.0
# How long a worker may outlive its parent [s].
ORPHANED = 5.0


@pytest.mark.parametrize(("name", "workers"), [("batch", None), ("processes", 2)])
def test_every_shard_is_run_once_and_errors_keep_type_and_message(name: str, workers: Any) -> None:
    notices: list[str] = []
    executor = make_executor(name, workers=workers)
    done = list(executor.run(executor_work.pid_and_threads, range(12), notices.append))
    assert sorted(one.index for one in done) == list(range(12))
    assert ({one.attempts for one in done}, notices) == ({1}, [])
    pids, threads = map(set, zip(*(one.report for one in done), strict=True))
    if name == "batch":
        assert pids == {os.getpid()}
        assert [one.index for one in done] == list(range(12))
        assert executor.threads_per_worker == cpu_count()
    else:
        # Kept from shard to shard. (One may have been quick enough to leave none for the other.)
        assert len(pids - {os.getpid()}) == len(pids) <= 2
        assert threads == {str(executor.threads_per_worker)} == {str(max(1, cpu_count() // 2))}
        assert make_executor("processes").threads_per_worker == 1
    assert list(executor.run(executor_work.square, range(0), print)) == []
    for work, index, error, words in executor_work.REFUSALS:
        with pytest.raises(error, match=words) as caught:
            list(executor.run(work, [index], print))
        assert type(caught.value) is error


def test_a_broken_pool_is_rebuilt_and_its_unfinished_parts_are_run_again(tmp_path: Path) -> None:
    notices: list[str] = []
    work = partial(executor_work.die_once, tmp_path)
    done = list(make_executor("processes", workers=2).run(work, range(8), notices.append))
    assert sorted((one.index, one.report) for one in done) == [(i, i * i) for i in range(8)]
    attempts = {part.index: part.attempts for part in done}
    # The part that the other worker had is run again too, and no third one.
    assert attempts[3] == 2
    assert sum(attempts.values()) in (9, 10)
    (line,) = notices
    assert line.startswith("a worker ended by SIGKILL(-9) while shard")
    assert re.search(r"\b3\b.* is run again$", line)


def test_a_shard_that_always_kills_or_has_no_report_is_one_line() -> None:
    notices: list[str] = []
    executor = make_executor("processes", workers=1)
    with pytest.raises(SetupError, match=r"a worker ended by EXIT\(7\), the 3. time while shard 5"):
        list(executor.run(executor_work.exit_always, [5], notices.append))
    assert len(notices) == 2
    with pytest.raises(SetupError, match=r"^shard 1 failed: TypeError: cannot pickle .*lock"):
        list(executor.run(executor_work.unpicklable, [1], print))


def test_no_more_parts_are_under_way_than_a_pool_has_room_for() -> None:
    submitted: list[int] = []

    def submit(index: int) -> Future:
        submitted.append(index)
        future = Future()
        if index != 1:
            future.set_result(Outcome(index))
        return future

    pool: Any = SimpleNamespace(ahead=2, submit=submit, require=lambda: None)
    parts = _run_until_broken(pool, iter(range(9)), {}, Counter())
    assert [next(parts).index for _ in range(2)] == [0, 2]
    assert submitted == [0, 1, 2]


def test_an_error_that_takes_more_than_a_message_travels_too() -> None:
    def diverge(index: int) -> None:
        raise DivergenceError(f"run {index} diverged", 0.5, trajectory=lambda: None)

    outcome = pickle.loads(pickle.dumps(attempt(diverge, 2)))
    with pytest.raises(DivergenceError, match=r"^run 2 diverged$"):
        outcome.result()


def begun(folder: Path) -> set[int]:
    """Processes that have begun a shard of `leave_pid`."""
    return {int(path.suffix[1:]) for path in folder.iterdir()}


def alive(pid: int) -> bool:
    """Whether a process runs; a zombie does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def wait_for(condition: Any, seconds: float) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.02)


def test_closing_the_iterator_ends_the_workers(tmp_path: Path) -> None:
    work = partial(executor_work.leave_pid, tmp_path, 0.2)
    done = make_executor("processes", workers=2).run(work, range(1000), print)
    next(done)
    pids = begun(tmp_path)
    done.close()
    assert pids
    assert not any(map(alive, pids))


# No guard for the main module: workers do not run it.
PROGRAM = """
import sys
from functools import partial
from pathlib import Path
import executor_work
from grosmc_mj.executors import make_executor
work = partial(executor_work.leave_pid, Path(sys.argv[1]), 60.0)
try:
    list(make_executor("processes", workers=2).run(work, range(8), print))
except KeyboardInterrupt:
    sys.exit("interrupted")
"""


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_no_worker_outlives_its_parent(how: signal.Signals, tmp_path: Path) -> None:
    folder, script = tmp_path / "begun", tmp_path / "program.py"
    folder.mkdir()
    script.write_text(PROGRAM)
    paths = os.pathsep.join([str(Path(__file__).parents[1]), *filter(None, sys.path)])
    with subprocess.Popen(
        [sys.executable, str(script), str(folder)], env={**os.environ, "PYTHONPATH": paths},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
        preexec_fn=hear_interrupts, text=True,
    ) as program:  # fmt: skip
        try:
            wait_for(lambda: len(begun(folder)) == 2, SOON)
            # A terminal sends Ctrl-C to the whole group; a kill hits one.
            (os.killpg if how is signal.SIGINT else os.kill)(program.pid, how)
            output, _ = program.communicate(timeout=SOON)
            wait_for(lambda: not any(map(alive, begun(folder))), ORPHANED)
        finally:
            program.kill()
    # No traceback, neither of the parent nor of a worker.
    expected = (1, "interrupted\n") if how is signal.SIGINT else (-signal.SIGKILL, "")
    assert (program.returncode, output) == expected


def test_wrong_arguments_are_one_line(monkeypatch: Patch) -> None:
    for arguments, message in (
        ({"name": "process"}, "executor 'process': did you mean 'processes'\\? valid: batch"),
        ({"name": "processes", "workers": 0}, "workers = 0 must be a whole number from 1 to 1024"),
        ({"name": "batch", "workers": 2}, "executor 'batch' is one process on all cores"),
        ({"name": "processes", "scheduler": "tcp://a:1"}, "no scheduler; only 'dask' does"),
        ({"name": "dask", "scheduler": "tcp://a:1", "workers": 2}, "has workers of its own"),
    ):
        with pytest.raises(ArgumentError, match=message):
            make_executor(**arguments)
    monkeypatch.setattr("grosmc_mj.executors.find_spec", lambda name: None)
    with pytest.raises(SetupError, match=r"needs Dask: pip install 'grosmc_mj\[dask\]'"):
        make_executor("dask")


def test_the_other_executors_do_not_import_dask() -> None:
    code = "import sys; from grosmc_mj.executors import make_executor as make; make('processes'); "
    code += "sys.exit('distributed' in sys.modules)"
    assert importlib.util.find_spec("distributed"), "the test extra brings it"
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    assert subprocess.run([sys.executable, "-c", code], env=env, check=False).returncode == 0
