"""What a campaign costs: beside MuJoCo's open loop, in seconds, in memory, and by its workers."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.batches import closed_loop, open_batches
from benchmarks.timing import Throughput, measured
from grosmc_mj.errors import SetupError
from grosmc_mj.executors import make_executor
from grosmc_mj.experiments.file.shipped import campaign_files
from grosmc_mj.films.offscreen import without_graphics
from grosmc_mj.physics.mujoco_plant import Integrator
from grosmc_mj.sweep.campaign import Campaign, specification_of
from grosmc_mj.sweep.runs import meters_for, ready
from grosmc_mj.sweep.screening import Batch
from grosmc_mj.sweep.store import Folder, shards_of

_PLANTS, _STEPS = 4096, 800
_LAW = "grosmc"
# Of what is run to see its memory: as short as one likes, since nothing is recorded.
_BLINK = 0.05


class Cost(NamedTuple):
    """A whole campaign, in a process of its own.

    Attributes:
        runs: Plants under one controller.
        duration: Of each run [s].
        integrator: MuJoCo's.
        seconds: Wall time of the whole command, with its start and its statistics.
        megabytes: Largest memory of the process, its libraries included.
    """

    runs: int
    duration: float
    integrator: Integrator
    seconds: float
    megabytes: float


class Scaling(NamedTuple):
    """A number of worker processes, one thread each.

    Attributes:
        workers: How many.
        rate: Runs a second, once the workers have begun.
        efficiency: Rate of a worker over that of a single one.
    """

    workers: int
    rate: float
    efficiency: float


def benchmark_campaign(rounds: int, integrator: Integrator) -> list[Throughput]:
    """4096 plants of the pendulum's campaign under GROSMC with meters, beside the open loop.

    The open loop is ``Batch.step`` of the very same models from the same starts, undisturbed.

    Args:
        rounds: Number of rounds.
        integrator: MuJoCo's.
    """
    asked = {"runs": _PLANTS, "controllers": (_LAW,), "integrator": integrator}
    campaign = Campaign.of(specification_of("cart_pendulum", **asked))
    batch = Batch(campaign, campaign.values(range(_PLANTS)), [0] * _PLANTS)
    experiment, plants = campaign.experiment, batch.physics
    runs = [ready(experiment, batch.row(_LAW, i, plants[i])) for i in range(_PLANTS)]
    starts, laws = np.array([run.case.x0 for run in runs]), [run.law for run in runs]
    meters = meters_for(experiment, runs, campaign.requirements)
    shipped, untimed = open_batches(plants, starts, _STEPS)
    closed = closed_loop(
        "campaign: GROSMC, meters, torque",
        plants,
        laws,
        starts,
        _STEPS,
        meters=meters,
        control_period=campaign.experiment.settings.control_period,
        disturbances=[list(run.case.disturbances) for run in runs],
    )
    return measured(shipped, untimed, [closed], rounds)


def costs(sizes: Sequence[tuple[int, float, Integrator]]) -> list[Cost]:
    """Whole campaigns of the pendulum under GROSMC, each in a fresh process.

    Args:
        sizes: Runs, their duration [s] and the integrator.

    Raises:
        SetupError: If one fails.
    """
    return [_cost(*size) for size in sizes]


def whole_campaigns() -> list[tuple[int, float, Integrator]]:
    """Two that differ in the number of their runs by a factor of 100, and a long one."""
    return [
        (1000, _BLINK, "implicitfast"),
        (100_000, _BLINK, "implicitfast"),
        (10_000, 10.0, "implicitfast"),
    ]


def _cost(runs: int, duration: float, integrator: Integrator) -> Cost:
    """One of them."""
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "pendulum.toml"
        file.write_text(_text(), encoding="utf-8")
        command = [
            *(sys.executable, "-m", "grosmc_mj.cli", "campaign", str(file)),
            *("--runs", str(runs), "--duration", str(duration), "--laws", _LAW),
            *("--integrator", integrator, "--no-figures", "--out", str(Path(scratch) / "campaign")),
        ]
        began = time.perf_counter()
        with Path(os.devnull).open("w") as nowhere:
            child = subprocess.Popen(command, stdout=nowhere, stderr=subprocess.PIPE)
            said = child.stderr.read().decode() if child.stderr else ""
            _, status, used = os.wait4(child.pid, 0)
            child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode:
            raise SetupError(f"a campaign of {runs} runs failed: {said.strip()}")
        seconds = time.perf_counter() - began
    return Cost(runs, duration, integrator, seconds, used.ru_maxrss / 1024)


def _text() -> str:
    """The pendulum's campaign with a requirement that runs of any duration can keep."""
    text = campaign_files()["cart_pendulum"].read_text(encoding="utf-8")
    return text.split("[[requirement]]")[0] + '[[requirement]]\ndeviation_below = "2 mrad"\n'


def scalings(workers: Sequence[int], duration: float = 2.0) -> list[Scaling]:
    """The rate of worker processes, four parts of 256 plants for each; the first is the baseline.

    With implicitfast: the shorter a step, the more what surrounds it costs.

    Args:
        workers: Numbers of processes.
        duration: Of each run [s].
    """
    found: list[Scaling] = []
    for count in workers:
        rate = _rate(count, duration)
        alone = found[0].rate / found[0].workers if found else rate / count
        found.append(Scaling(count, rate, rate / count / alone))
    return found


def _rate(workers: int, duration: float) -> float:
    """Runs a second of some workers, after each has designed its laws in a part of its own."""
    parts, size = 5 * workers, 256
    with tempfile.TemporaryDirectory() as scratch, without_graphics():
        file = Path(scratch) / "pendulum.toml"
        file.write_text(_text(), encoding="utf-8")
        campaign = Campaign.of(
            specification_of(
                str(file),
                runs=parts * size,
                shard=size,
                controllers=(_LAW,),
                duration=duration,
                integrator="implicitfast",
            )
        )
        folder = Folder(Path(scratch) / "campaign")
        folder.begin(campaign, resume=False)
        executor = make_executor("processes", workers=workers)
        work = partial(_timed, shards_of(campaign, folder, threads=1))
        spans = [each.report for each in executor.run(work, range(parts), lambda _: None)]
    # The first part of each worker has the design and the loading of compiled code in it.
    began = max(sorted(start for start, _ in spans)[:workers])
    later = [(start, end) for start, end in spans if start > began]
    first = min(start for start, _ in later)
    return len(later) * size / (max(end for _, end in later) - first)


def _timed(shard: Callable[[int], object], index: int) -> tuple[float, float]:
    """Run a part; when it began and ended."""
    began = time.time()
    shard(index)
    return began, time.time()
