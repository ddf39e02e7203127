"""The executor `dask`: workers of this machine, and of a real scheduler on loopback."""

import json
import os
import signal
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import executor_work
import pytest
from commands import Patch

pytest.importorskip("distributed")

from distributed import Client, LocalCluster, Security

from grosmc_mj.ground.errors import SetupError
from grosmc_mj.ground.executors import dask_cluster, make_executor
from grosmc_mj.ground.executors.dask_cluster import cluster_client

# Each starts a cluster or waits for one that does not answer.
pytestmark = [pytest.mark.slow, pytest.mark.apart]


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    """Yield a scheduler with two workers, which anybody may use."""
    with local_cluster() as cluster:
        yield cluster


def local_cluster() -> Any:
    # None would take port 8787, which one cluster has already.
    return LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0")


@pytest.fixture
def scheduler_file(cluster: LocalCluster, tmp_path: Path) -> Path:
    path = tmp_path / "scheduler.json"
    path.write_text(json.dumps({"address": cluster.scheduler_address}))
    return path


def reports(
    scheduler: str | Path, work: Callable[[int], Any], shards: Sequence[int] = range(4)
) -> dict[int, Any]:
    """Run shards on the workers of a scheduler; return the report of each."""
    executor = make_executor("dask", scheduler=str(scheduler))
    assert executor.threads_per_worker == 1
    finished = list(executor.run(work, shards, print))
    assert len(finished) == len({part.index for part in finished})
    return {part.index: part.report for part in finished}


def squares(count: int) -> dict[int, int]:
    return {index: index**2 for index in range(count)}


def test_a_running_cluster_reports_each_shard_once(cluster: LocalCluster) -> None:
    # More shards than are ever under way at once.
    finished = reports(cluster.scheduler_address, executor_work.square, range(100))
    assert finished == squares(100)


def test_a_scheduler_is_found_by_its_file(scheduler_file: Path) -> None:
    assert reports(scheduler_file, executor_work.square) == squares(4)


@pytest.mark.parametrize(("work", "index", "error", "words"), executor_work.REFUSALS)
def test_an_error_is_the_same_in_every_executor(
    cluster: LocalCluster, work: Any, index: int, error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        reports(cluster.scheduler_address, work, [index])


def test_a_worker_of_another_version_is_refused(cluster: LocalCluster, monkeypatch: Patch) -> None:
    versions = dask_cluster.decisive_versions()
    needed = {**versions, "mujoco": "3.99.0"}
    monkeypatch.setattr(dask_cluster, "decisive_versions", lambda: needed)
    with pytest.raises(SetupError, match=socket.gethostname()) as refusal:
        reports(cluster.scheduler_address, executor_work.square)
    assert f"has mujoco {versions['mujoco']} instead of 3.99.0" in str(refusal.value)


def test_a_killed_worker_is_replaced(cluster: LocalCluster, tmp_path: Path) -> None:
    work = partial(executor_work.leave_pid, tmp_path, 0.2)
    executor = make_executor("dask", scheduler=cluster.scheduler_address)
    parts = executor.run(work, range(24), print)

    first = next(parts)
    pid = int(next(tmp_path.iterdir()).suffix[1:])
    os.kill(pid, signal.SIGKILL)
    finished = [first, *parts]
    assert sorted((part.index, part.report) for part in finished) == list(squares(24).items())


def test_a_scheduler_that_closes_is_one_line(tmp_path: Path) -> None:
    work = partial(executor_work.leave_pid, tmp_path, 0.2)
    with local_cluster() as cluster:
        executor = make_executor("dask", scheduler=cluster.scheduler_address)
        parts = executor.run(work, range(100), print)
        next(parts)
    with pytest.raises(SetupError, match=r"^the Dask scheduler at tcp://127\.0\.0\.1.* has gone: "):
        list(parts)


@pytest.fixture
def silent() -> Iterator[str]:
    """Yield an address where nobody answers."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        yield f"tcp://127.0.0.1:{listener.getsockname()[1]}"


@pytest.mark.parametrize("address", ["silent", "nonsense", "foo://a:1"])
def test_a_scheduler_out_of_reach_is_one_line_in_seconds(
    address: str, silent: str, monkeypatch: Patch
) -> None:
    if address == "silent":
        address = silent
    assert dask_cluster._PATIENCE <= 10.0
    monkeypatch.setattr(dask_cluster, "_PATIENCE", 1.0)
    begin = time.monotonic()
    with pytest.raises(SetupError) as refusal:
        reports(address, executor_work.square)
    assert str(refusal.value) == (
        f"no Dask scheduler answers at {address}: start one with `dask scheduler`, "
        "or leave --scheduler out for workers on this machine"
    )
    # A second, and some for a busy machine.
    assert time.monotonic() - begin < 6.0


def test_a_file_that_is_no_scheduler_s_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match=r"none\.json is not a file"):
        reports(tmp_path / "none.json", executor_work.square)


def test_a_local_worker_is_replaced(tmp_path: Path) -> None:
    executor = make_executor("dask", workers=2)
    finished = executor.run(partial(executor_work.die_once, tmp_path), range(8), print)
    assert sorted((part.index, part.report) for part in finished) == list(squares(8).items())


def test_a_shard_that_always_kills_its_worker_ends_the_run() -> None:
    executor = make_executor("dask", workers=1)
    with pytest.raises(SetupError, match=r"^shard 1 failed: KilledWorker: .* on 3 diff"):
        list(executor.run(executor_work.exit_always, [1], print))


# Workers of this machine. Loopback is open to all its users: a scheduler that anybody may use would
# run anybody's code.


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    with cluster_client(1, None) as client:
        yield client


@pytest.fixture(scope="module")
def scheduler(client: Client) -> str:
    return client.scheduler_info()["address"]


@pytest.fixture(scope="module")
def worker(client: Client) -> str:
    (address,) = client.scheduler_info()["workers"]
    return address


def require_refused(address: str, security: Security | None = None) -> None:
    with pytest.raises(OSError, match=r"TLS|SSL|Timed out|closed"):
        Client(address, security=security, timeout=3, set_as_default=False)


def test_a_local_cluster_has_certificates(scheduler: str, worker: str) -> None:
    assert scheduler.startswith("tls://127.0.0.1:")
    assert worker.startswith("tls://127.0.0.1:")


def test_a_client_without_a_certificate_is_refused(scheduler: str, worker: str) -> None:
    require_refused(scheduler.replace("tls", "tcp"))
    require_refused(worker.replace("tls", "tcp"))


def test_a_client_with_another_certificate_is_refused(scheduler: str) -> None:
    require_refused(scheduler, Security.temporary())


def test_the_client_of_a_local_cluster_has_its_workers(client: Client) -> None:
    assert client.submit(executor_work.square, 3).result() == 9
