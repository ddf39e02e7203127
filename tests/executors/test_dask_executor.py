"""The executor `dask`: workers of this machine, and of a real scheduler on loopback."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import executor_work
import pytest
from executor_work import REFUSALS

pytest.importorskip("distributed")

from distributed import Client, Security

from grosmc_mj.errors import SetupError
from grosmc_mj.executors import dask_cluster, make_executor
from grosmc_mj.executors.dask_cluster import cluster_client

# Each starts a cluster or waits for one that does not answer.
pytestmark = [pytest.mark.slow, pytest.mark.apart]

# A scheduler that has not started by then never will [s].
SOON = 60.0


class Cluster:
    """A scheduler and two workers, as a user starts them by hand.

    Args:
        folder: For the scheduler's file and the logs.
    """

    def __init__(self, folder: Path) -> None:
        self.file = folder / "scheduler.json"
        self._folder = folder
        options = ["--no-dashboard", "--scheduler-file", str(self.file)]
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0", *options)
        one_thread = ["--nthreads", "1", "--no-nanny"]
        self.workers = [self._start("worker", *one_thread, *options) for _ in range(2)]
        end = time.monotonic() + SOON
        # It is there before it is written.
        while not (self.file.exists() and self.file.read_text().strip()):
            assert time.monotonic() < end, "no scheduler"
            time.sleep(0.05)

    @property
    def address(self) -> str:
        """Where the scheduler listens."""
        return json.loads(self.file.read_text())["address"]

    def stop(self) -> None:
        """End all."""
        for process in (self.scheduler, *self.workers):
            process.kill()
            process.wait()

    def _start(self, program: str, *options: str) -> subprocess.Popen:
        """One of Dask's programs; workers find the module of the tests' work."""
        paths = [str(Path(__file__).parents[1]), *filter(None, sys.path)]
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.dask_{program}", *options],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            cwd=self._folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A cluster that no test harms."""
    cluster = Cluster(tmp_path_factory.mktemp("cluster"))
    yield cluster
    cluster.stop()


@pytest.fixture
def fragile(tmp_path: Path) -> Iterator[Cluster]:
    """A cluster of the test's own."""
    cluster = Cluster(tmp_path)
    yield cluster
    cluster.stop()


def refused(work: Any, scheduler: str) -> SetupError:
    """The error of a run that must fail."""
    with pytest.raises(SetupError) as caught:
        list(make_executor("dask", scheduler=scheduler).run(work, range(4), print))
    return caught.value


# ---- a scheduler that is running already


@pytest.mark.parametrize("by", ["file", "address"])
def test_a_running_cluster_gives_each_report_once(running: Cluster, by: str) -> None:
    executor = make_executor("dask", scheduler=str(getattr(running, by)))
    told: list[str] = []
    # More than are ever under way at once.
    done = list(executor.run(executor_work.square, range(100), told.append))
    expected = make_executor("batch").run(executor_work.square, range(100), print)
    assert sorted((each.index, each.report) for each in done) == [
        (each.index, each.report) for each in expected
    ]
    assert executor.threads_per_worker == 1


@pytest.mark.parametrize(("work", "index", "error", "words"), REFUSALS)
def test_errors_travel_with_their_type_and_message(
    running: Cluster, work: Any, index: int, error: type[Exception], words: str
) -> None:
    executor = make_executor("dask", scheduler=running.address)
    with pytest.raises(error, match=words):
        list(executor.run(work, [index], print))


def test_a_worker_of_another_version_is_refused(
    running: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = dask_cluster.decisive_versions()
    monkeypatch.setattr(dask_cluster, "decisive_versions", lambda: {**here, "mujoco": "3.99.0"})
    message = str(refused(executor_work.square, running.address))
    assert f"has mujoco {here['mujoco']} instead of 3.99.0" in message
    assert socket.gethostname() in message


def test_a_worker_that_is_killed_is_replaced_and_its_shards_are_run_elsewhere(
    fragile: Cluster, tmp_path: Path
) -> None:
    folder = tmp_path / "begun"
    folder.mkdir()
    told: list[str] = []
    victim = fragile.workers[1]
    done = []
    executor = make_executor("dask", scheduler=fragile.address)
    for each in executor.run(partial(executor_work.leave_pid, folder, 0.2), range(24), told.append):
        done.append(each)
        if victim.poll() is None and list(folder.glob(f"*.{victim.pid}")):
            victim.send_signal(signal.SIGKILL)
            victim.wait()
    assert {each.index: each.report for each in done} == {i: i * i for i in range(24)}
    assert len(done) == 24


def test_a_scheduler_that_goes_is_one_line(fragile: Cluster, tmp_path: Path) -> None:
    folder = tmp_path / "begun"
    folder.mkdir()
    work = partial(executor_work.leave_pid, folder, 0.1)
    done = make_executor("dask", scheduler=fragile.address).run(work, range(100), print)
    next(done)
    fragile.scheduler.kill()
    with pytest.raises(SetupError, match=r"^the Dask scheduler at tcp://127\.0\.0\.1.* has gone: "):
        list(done)


# ---- none


def test_a_scheduler_that_cannot_be_reached_is_one_line_within_seconds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert dask_cluster._PATIENCE <= 10.0
    monkeypatch.setattr(dask_cluster, "_PATIENCE", 1.0)
    with socket.socket() as silent, socket.socket() as closed:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        closed.bind(("127.0.0.1", 0))
        addresses = [f"tcp://127.0.0.1:{each.getsockname()[1]}" for each in (silent, closed)]
        for address in (*addresses, "nonsense", "foo://a:1"):
            begin = time.monotonic()
            assert str(refused(executor_work.square, address)) == (
                f"no Dask scheduler answers at {address}: start one with `dask scheduler`, "
                "or leave --scheduler out for workers on this machine"
            )
            # A second and some for a busy machine.
            assert time.monotonic() - begin < 6.0
    missing = tmp_path / "none.json"
    assert str(refused(executor_work.square, str(missing))).startswith(f"{missing} is not a file")


# ---- workers of this machine


def test_a_local_worker_that_dies_is_replaced_and_one_shard_too_deadly_ends_the_run(
    tmp_path: Path,
) -> None:
    told: list[str] = []
    executor = make_executor("dask", workers=2)
    done = list(executor.run(partial(executor_work.die_once, tmp_path), range(8), told.append))
    assert {each.index: each.report for each in done} == {i: i * i for i in range(8)}
    assert len(done) == 8
    with pytest.raises(SetupError, match=r"^shard 1 failed: KilledWorker: .* on 3 diff"):
        list(executor.run(executor_work.die_always, [1], told.append))


def test_workers_of_this_machine_are_closed_to_its_other_users() -> None:
    """Loopback is everybody's: a scheduler that anybody may use runs anybody's code as us."""
    with cluster_client(1, None) as client:
        address = client.scheduler_info()["address"]
        assert address.startswith("tls://127.0.0.1:")
        (worker,) = client.scheduler_info()["workers"]
        assert worker.startswith("tls://127.0.0.1:")
        strangers = [
            (address.replace("tls", "tcp"), None),
            (worker.replace("tls", "tcp"), None),
            (address, Security.temporary()),
        ]
        for reached, security in strangers:
            with pytest.raises(OSError, match=r"TLS|SSL|Timed out|closed"):
                Client(reached, security=security, timeout=3, set_as_default=False)
        assert client.submit(executor_work.square, 3).result() == 9
