"""What the executor `dask` says of workers and shards, to a client that plays a cluster."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any, cast

import executor_work
import pytest

pytest.importorskip("distributed")

from distributed import Future, KilledWorker

from grosmc_mj.errors import SetupError
from grosmc_mj.executors import dask_workers
from grosmc_mj.executors.interface import Finished


class Answer(Future):
    """A shard that is done, or that Dask gave up."""

    def __init__(self, key: Any, error: Exception | None, outcome: Any, called: Any) -> None:
        self.key, self.error, self.outcome, self.called = key, error, outcome, called

    def __del__(self) -> None:
        """There is nobody to tell."""

    @property
    def status(self) -> Any:
        return "error" if self.error else "finished"

    def exception(self, *_: Any, **__: Any) -> Any:
        return self.error

    def add_done_callback(self, fn: Any) -> None:
        self.called(fn)


class Cluster:
    """A worker that answers once it has all shards, and is lost just before if told so."""

    status, scheduler = "running", SimpleNamespace(address="tcp://here")

    def __init__(
        self, shards: int, *, threads: int = 1, lost: bool = False, error: Exception | None = None
    ) -> None:
        self.shards, self.threads, self.lost, self.error = shards, threads, lost, error
        self.under_way: list[Answer] = []

    def nthreads(self) -> dict[str, int]:
        return {"tcp://worker": self.threads}

    def subscribe_topic(self, _topic: str, hear: Callable[[Any], Any]) -> None:
        self.hear = hear

    def unsubscribe_topic(self, _topic: str) -> None:
        """Nothing is heard any more."""

    def submit(self, function: Any, *arguments: Any, key: Any, **_: Any) -> Answer:
        self.under_way.append(Answer(key, self.error, function(*arguments), self.called))
        return self.under_way[-1]

    def called(self, fn: Callable[[Any], Any]) -> None:
        if len(self.under_way) < self.shards:
            return
        if self.lost:
            keys = {each.key for each in self.under_way}
            gone = {"action": "remove-worker", "worker": "tcp://worker", "processing-tasks": keys}
            self.hear((0.0, {**gone, "lost-computed-tasks": set()}))
        for each in self.under_way:
            fn(each)

    def gather(self, answers: list[Answer]) -> list[Any]:
        return [each.outcome for each in answers]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Callable[[Cluster], tuple[list[Finished], list[str]]]:
    """The shards of a cluster that are done, and what was said meanwhile."""

    def run_on(cluster: Cluster) -> tuple[list[Finished], list[str]]:
        monkeypatch.setattr(dask_workers, "cluster_client", lambda *_: nullcontext(cluster))
        told: list[str] = []
        executor = dask_workers.DaskWorkers(1, "tcp://here")
        assert executor.threads_per_worker == 1
        done = list(executor.run(executor_work.square, range(cluster.shards), told.append))
        return done, told

    return run_on


@pytest.mark.parametrize(
    ("shards", "said"),
    [
        (1, "had shard 0: Dask runs it again, a few times at most"),
        (3, "had shards 0, 1, 2: Dask runs them again, a few times at most"),
    ],
)
def test_a_lost_worker_is_told_with_its_shards(run: Any, shards: int, said: str) -> None:
    done, told = run(Cluster(shards, lost=True))
    assert told == [f"Dask worker tcp://worker was lost while it {said}"]
    assert [(each.index, each.report, each.attempts) for each in done] == [
        (i, i * i, 2) for i in range(shards)
    ]


def test_workers_of_several_threads_are_warned_of_once(run: Any) -> None:
    """Though they are counted again when one is lost."""
    _, told = run(Cluster(2, threads=2, lost=True))
    assert ["start workers with --nthreads 1" in each for each in told] == [True, False]


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (KilledWorker("shard", cast(Any, None), 3), "shard 0 was with 4 Dask workers that died"),
        (TypeError("no pickle"), r"could not hand out shard 0 \(.*no pickle\): install the same"),
    ],
)
def test_why_dask_gave_a_shard_up_is_told(run: Any, error: Exception, said: str) -> None:
    with pytest.raises(SetupError, match=said):
        run(Cluster(1, error=error))
