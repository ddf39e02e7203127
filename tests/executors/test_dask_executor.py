"""The executor `dask`: workers of this machine, and of a real scheduler on loopback."""

import json
import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import executor_work
import pytest
from commands import Patch

pytest.importorskip("distributed")

from distributed import Client, LocalCluster, Security

from grosmc_mj.errors import SetupError
from grosmc_mj.executors import dask_cluster, make_executor
from grosmc_mj.executors.dask_cluster import cluster_client

# Each starts a cluster or waits for one that does not answer.
pytestmark = [pytest.mark.slow, pytest.mark.apart]


@pytest.fixture
def cluster() -> Iterator[Any]:
    """A scheduler and two workers, which anybody may use."""
    options: Any = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with LocalCluster(**options) as cluster:
        yield cluster


def ran(scheduler: object, work: Callable[[int], Any], shards: Any = range(4)) -> list[Any]:
    """Index and report of each shard, sorted."""
    executor = make_executor("dask", scheduler=str(scheduler))
    assert executor.threads_per_worker == 1
    return sorted((one.index, one.report) for one in executor.run(work, shards, print))


def test_a_running_cluster_reports_each_shard_once(
    cluster: LocalCluster, tmp_path: Path, monkeypatch: Patch
) -> None:
    file = tmp_path / "scheduler.json"
    file.write_text(json.dumps({"address": cluster.scheduler_address}))
    for scheduler in (file, cluster.scheduler_address):
        # More than are ever under way at once.
        squares = [(i, i * i) for i in range(100)]
        assert ran(scheduler, executor_work.square, range(100)) == squares
    for work, index, error, words in executor_work.REFUSALS:
        with pytest.raises(error, match=words):
            ran(cluster.scheduler_address, work, [index])
    # A worker of another version is refused.
    here = dask_cluster.decisive_versions()
    monkeypatch.setattr(dask_cluster, "decisive_versions", lambda: {**here, "mujoco": "3.99.0"})
    with pytest.raises(SetupError, match=socket.gethostname()) as refusal:
        ran(cluster.scheduler_address, executor_work.square)
    assert f"has mujoco {here['mujoco']} instead of 3.99.0" in str(refusal.value)


def test_a_killed_worker_is_replaced_and_a_killed_scheduler_is_not(
    cluster: LocalCluster, tmp_path: Path
) -> None:
    work, done = partial(executor_work.leave_pid, tmp_path, 0.2), []
    executor = make_executor("dask", scheduler=cluster.scheduler_address)
    for one in executor.run(work, range(24), print):
        if not done:
            os.kill(int(next(tmp_path.iterdir()).suffix[1:]), signal.SIGKILL)
        done.append((one.index, one.report))
    assert sorted(done) == [(i, i * i) for i in range(24)]
    left = executor.run(work, range(100), print)
    next(left)
    cluster.close()
    with pytest.raises(SetupError, match=r"^the Dask scheduler at tcp://127\.0\.0\.1.* has gone: "):
        list(left)


def test_a_scheduler_out_of_reach_is_one_line_in_seconds(
    tmp_path: Path, monkeypatch: Patch
) -> None:
    assert dask_cluster._PATIENCE <= 10.0
    monkeypatch.setattr(dask_cluster, "_PATIENCE", 1.0)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        for address in (f"tcp://127.0.0.1:{silent.getsockname()[1]}", "nonsense", "foo://a:1"):
            begin = time.monotonic()
            with pytest.raises(SetupError) as refusal:
                ran(address, executor_work.square)
            assert str(refusal.value) == (
                f"no Dask scheduler answers at {address}: start one with `dask scheduler`, "
                "or leave --scheduler out for workers on this machine"
            )
            # A second and some for a busy machine.
            assert time.monotonic() - begin < 6.0
    with pytest.raises(SetupError, match=r"none\.json is not a file"):
        ran(tmp_path / "none.json", executor_work.square)


def test_a_local_worker_is_replaced_and_a_deadly_shard_ends_the_run(tmp_path: Path) -> None:
    executor = make_executor("dask", workers=2)
    done = executor.run(partial(executor_work.die_once, tmp_path), range(8), print)
    assert sorted((one.index, one.report) for one in done) == [(i, i * i) for i in range(8)]
    with pytest.raises(SetupError, match=r"^shard 1 failed: KilledWorker: .* on 3 diff"):
        list(executor.run(executor_work.exit_always, [1], print))


def test_workers_of_this_machine_are_closed_to_its_other_users() -> None:
    """Loopback is everybody's: a scheduler that anybody may use runs anybody's code as us."""
    with cluster_client(1, None) as client:
        address = client.scheduler_info()["address"]
        (worker,) = client.scheduler_info()["workers"]
        assert address.startswith("tls://127.0.0.1:")
        assert worker.startswith("tls://127.0.0.1:")
        for reached, security in (
            (address.replace("tls", "tcp"), None), (worker.replace("tls", "tcp"), None),
            (address, Security.temporary()),
        ):  # fmt: skip
            with pytest.raises(OSError, match=r"TLS|SSL|Timed out|closed"):
                Client(reached, security=security, timeout=3, set_as_default=False)
        assert client.submit(executor_work.square, 3).result() == 9
