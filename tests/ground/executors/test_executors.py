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
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import executor_work
import pytest
from commands import Patch, hear_interrupts
from loky import cpu_count

from grosmc_mj.ground.errors import ArgumentError, DivergenceError, SetupError
from grosmc_mj.ground.executors import Executor, Finished, executor_for, make_executor
from grosmc_mj.ground.executors.pools import (
    InProcess,
    Processes,
    WorkOutcome,
    _run_until_broken,
    attempt,
)

# A child that has not begun or ended by then never will [s].
SOON = 30.0
# Time that a worker may outlive its parent [s].
ORPHANED = 5.0


class Run(NamedTuple):
    """Shards that an executor has run, and its notices."""

    executor: Executor
    finished: list[Finished]
    notices: list[str]


@pytest.fixture(scope="module", params=["batch", "processes"])
def run(request: pytest.FixtureRequest) -> Run:
    """Return twelve shards of an executor."""
    workers = 2 if request.param == "processes" else None
    executor = make_executor(request.param, workers=workers)
    notices: list[str] = []
    finished = list(executor.run(executor_work.pid_and_threads, range(12), notices.append))
    return Run(executor, finished, notices)


def test_every_shard_is_run_once(run: Run) -> None:
    assert sorted(part.index for part in run.finished) == list(range(12))
    assert {part.attempts for part in run.finished} == {1}
    assert run.notices == []


def test_an_executor_that_has_no_shards_ends_at_once(run: Run) -> None:
    assert list(run.executor.run(executor_work.square, range(0), print)) == []


@pytest.mark.parametrize(("work", "index", "error", "words"), executor_work.REFUSALS)
def test_an_error_is_the_same_in_every_executor(
    run: Run, work: Any, index: int, error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words) as caught:
        list(run.executor.run(work, [index], print))
    assert type(caught.value) is error


@pytest.mark.parametrize("run", ["batch"], indirect=True)
def test_this_process_runs_shards_in_their_order_on_all_cores(run: Run) -> None:
    assert [part.index for part in run.finished] == list(range(12))
    assert {part.report[0] for part in run.finished} == {os.getpid()}
    assert run.executor.threads_per_worker == cpu_count()


@pytest.mark.parametrize("run", ["processes"], indirect=True)
def test_workers_are_kept_from_shard_to_shard(run: Run) -> None:
    pids = {part.report[0] for part in run.finished}
    assert os.getpid() not in pids
    # One worker may have been quick enough to leave no shard for the other.
    assert len(pids) <= 2


@pytest.mark.parametrize("run", ["processes"], indirect=True)
def test_workers_share_the_cores(run: Run) -> None:
    threads = {part.report[1] for part in run.finished}
    assert threads == {str(max(1, cpu_count() // 2))}
    assert run.executor.threads_per_worker == max(1, cpu_count() // 2)
    assert make_executor("processes").threads_per_worker == 1


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return eight shards of two workers, one of which was killed at shard 3."""
    executor = make_executor("processes", workers=2)
    work = partial(executor_work.die_once, tmp_path_factory.mktemp("broken"))
    notices: list[str] = []
    finished = list(executor.run(work, range(8), notices.append))
    return Run(executor, finished, notices)


def test_a_broken_pool_is_rebuilt(broken: Run) -> None:
    reports = {part.index: part.report for part in broken.finished}
    assert reports == {index: index**2 for index in range(8)}


def test_unfinished_parts_of_a_broken_pool_are_run_again(broken: Run) -> None:
    attempts = {part.index: part.attempts for part in broken.finished}
    assert attempts[3] == 2
    # The part that the other worker had is run again, too, and no third one.
    assert sum(attempts.values()) - len(broken.finished) in (1, 2)


def test_a_broken_pool_is_one_notice(broken: Run) -> None:
    (line,) = broken.notices
    assert line.startswith("a worker ended by SIGKILL(-9) while shard")
    assert re.search(r"\b3\b.* is run again$", line)


@pytest.mark.slow
def test_a_shard_that_always_kills_its_worker_is_one_line() -> None:
    notices: list[str] = []
    executor = make_executor("processes", workers=1)
    with pytest.raises(SetupError, match=r"a worker ended by EXIT\(7\), the 3. time while shard 5"):
        list(executor.run(executor_work.exit_always, [5], notices.append))
    assert len(notices) == 2


def test_a_report_that_cannot_be_pickled_is_one_line() -> None:
    executor = make_executor("processes", workers=1)
    with pytest.raises(SetupError, match=r"^shard 1 failed: TypeError: cannot pickle .*lock"):
        list(executor.run(executor_work.unpicklable, [1], print))


def test_no_more_parts_are_under_way_than_a_pool_has_room_for() -> None:
    submitted: list[int] = []

    def submit(index: int) -> Future:
        submitted.append(index)
        future = Future()
        # Part 1 never ends.
        if index != 1:
            future.set_result(WorkOutcome(index))
        return future

    pool: Any = SimpleNamespace(ahead=2, submit=submit, require=lambda: None)
    parts = _run_until_broken(pool, iter(range(9)), {}, Counter())
    assert next(parts).index == 0
    assert next(parts).index == 2
    assert submitted == [0, 1, 2]


def test_parts_that_had_finished_when_a_pool_broke_come_first() -> None:
    def submit(index: int) -> Future:
        future = Future()
        if index == 0:
            future.set_exception(BrokenExecutor())
        else:
            future.set_result(WorkOutcome(index))
        return future

    pool: Any = SimpleNamespace(ahead=2, submit=submit, require=lambda: None)
    parts = _run_until_broken(pool, iter(range(2)), {}, Counter())
    assert next(parts).index == 1
    with pytest.raises(BrokenExecutor):
        next(parts)


@pytest.mark.parametrize(("parts", "kind"), [(1, InProcess), (2, Processes)])
def test_several_parts_have_processes(parts: int, kind: type) -> None:
    assert type(executor_for(parts)) is kind


def diverge(index: int) -> None:
    raise DivergenceError(f"run {index} diverged", 0.5, trajectory=lambda: None)


def test_an_error_that_takes_more_than_a_message_is_pickled() -> None:
    outcome = pickle.loads(pickle.dumps(attempt(diverge, 2)))
    with pytest.raises(DivergenceError, match=r"^run 2 diverged$"):
        outcome.result()


# Ends of workers.


def begun(folder: Path) -> set[int]:
    """Return the processes that have begun a shard of `leave_pid`."""
    return {int(path.suffix[1:]) for path in folder.iterdir()}


def is_alive(pid: int) -> bool:
    """Return True if a process runs; a zombie does not."""
    try:
        status = Path(f"/proc/{pid}/stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
    # The state follows the name, which is in brackets.
    return status.rsplit(")", 1)[1].split()[0] != "Z"


def wait_for(condition: Callable[[], bool], seconds: float) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.02)


@pytest.mark.slow
def test_closing_the_iterator_ends_the_workers(tmp_path: Path) -> None:
    work = partial(executor_work.leave_pid, tmp_path, 0.2)
    parts = make_executor("processes", workers=2).run(work, range(1000), print)
    next(parts)
    pids = begun(tmp_path)
    parts.close()
    assert pids
    assert not any(map(is_alive, pids))


# No guard for the main module: workers do not run it.
PROGRAM = """
import sys
from functools import partial
from pathlib import Path
import executor_work
from grosmc_mj.ground.executors import make_executor
work = partial(executor_work.leave_pid, Path(sys.argv[1]), 60.0)
try:
    list(make_executor("processes", workers=2).run(work, range(8), print))
except KeyboardInterrupt:
    sys.exit("interrupted")
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kill", "number", "code", "printed"),
    [
        # A terminal sends Ctrl-C to the whole group.
        (os.killpg, signal.SIGINT, 1, "interrupted\n"),
        (os.kill, signal.SIGKILL, -signal.SIGKILL, ""),
    ],
    ids=["interrupt", "kill"],
)
def test_no_worker_outlives_its_parent(
    kill: Callable[[int, int], None], number: int, code: int, printed: str, tmp_path: Path
) -> None:
    """No traceback is printed, neither of the parent nor of a worker."""
    folder = tmp_path / "begun"
    folder.mkdir()
    script = tmp_path / "program.py"
    script.write_text(PROGRAM)
    paths = [str(Path(__file__).parents[2]), *filter(None, sys.path)]
    with subprocess.Popen(
        [sys.executable, str(script), str(folder)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        preexec_fn=hear_interrupts,
        text=True,
    ) as program:
        try:
            wait_for(lambda: len(begun(folder)) == 2, SOON)
            kill(program.pid, number)
            output, _ = program.communicate(timeout=SOON)
            wait_for(lambda: not any(map(is_alive, begun(folder))), ORPHANED)
        finally:
            program.kill()
    assert program.returncode == code
    assert output == printed


# Arguments.


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"name": "process"}, "executor 'process': did you mean 'processes'\\? valid: batch"),
        ({"name": "processes", "workers": 0}, "workers = 0 must be a whole number from 1 to 1024"),
        ({"name": "batch", "workers": 2}, "executor 'batch' is one process on all cores"),
        ({"name": "processes", "scheduler": "tcp://a:1"}, "no scheduler; only 'dask' does"),
        ({"name": "dask", "scheduler": "tcp://a:1", "workers": 2}, "has workers of its own"),
        ({"name": "dask", "scheduler": "", "workers": 2}, "has workers of its own"),
    ],
)
def test_wrong_arguments_are_one_line(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        make_executor(**arguments)


def test_dask_that_is_not_installed_is_one_line(monkeypatch: Patch) -> None:
    monkeypatch.setattr("grosmc_mj.ground.executors.find_spec", lambda name: None)
    with pytest.raises(SetupError, match=r"needs Dask: pip install 'grosmc_mj\[dask\]'"):
        make_executor("dask")


IMPORT = """
import sys
from grosmc_mj.ground.executors import make_executor
make_executor('processes')
sys.exit('distributed' in sys.modules)
"""


def test_the_other_executors_do_not_import_dask() -> None:
    assert importlib.util.find_spec("distributed"), "the test extra brings it"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    program = subprocess.run([sys.executable, "-c", IMPORT], env=environment, check=False)
    assert program.returncode == 0
