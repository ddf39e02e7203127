"""Cost of campaigns: throughput beside MuJoCo's open loop, time, memory and worker processes."""

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
from grosmc_mj.experiments.file.shipped import campaign_files
from grosmc_mj.ground.errors import SetupError
from grosmc_mj.ground.executors import make_executor
from grosmc_mj.mechanics.physics.mujoco_plant import Integrator
from grosmc_mj.output.films.offscreen import without_graphics
from grosmc_mj.studies.campaign.batch import Batch
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.folder import Folder
from grosmc_mj.studies.campaign.specification import specification_of
from grosmc_mj.studies.campaign.work import part_runner
from grosmc_mj.studies.sweep.runs import measurements_of, prepare_run

_PLANTS = 4096
_STEPS = 800
_LAW = "grosmc"
# Duration of runs that show the memory [s]: it may be short, since nothing is recorded.
_BLINK = 0.05
# Plants in a part of a campaign, and parts for each worker.
_SHARD = 256
_PARTS = 5
# Requirement that runs of any duration can keep.
_REQUIREMENT = """[[requirement]]
deviation_below = "2 mrad"
"""


class Cost(NamedTuple):
    """A whole campaign, in a process of its own.

    Attributes:
        runs: Number of plants under one controller.
        duration: Duration of each run [s].
        integrator: MuJoCo's integrator.
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
        workers: Number of processes.
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
        integrator: MuJoCo's integrator.
    """
    specification = specification_of(
        "cart_pendulum",
        runs=_PLANTS,
        controllers=(_LAW,),
        integrator=integrator,
    )
    campaign = Campaign.of(specification)
    experiment = campaign.experiment

    batch = Batch(campaign, campaign.values(range(_PLANTS)), [0] * _PLANTS)
    plants = batch.physics
    runs = [prepare_run(experiment, batch.row(_LAW, i, plants[i])) for i in range(_PLANTS)]
    starts = np.array([run.case.x0 for run in runs])

    shipped, untimed = open_batches(plants, starts, _STEPS)
    closed = closed_loop(
        "campaign: GROSMC, meters, torque",
        plants,
        [run.law for run in runs],
        starts,
        _STEPS,
        accumulator=[
            item.accumulator for item in measurements_of(experiment, runs, campaign.requirements)
        ],
        control_period=experiment.settings.control_period,
        disturbances=[list(run.case.disturbances) for run in runs],
    )
    return measured(shipped, untimed, [closed], rounds)


def costs(sizes: Sequence[tuple[int, float, Integrator]]) -> list[Cost]:
    """Whole campaigns of the pendulum under GROSMC, each in a fresh process.

    Args:
        sizes: Number of runs, their duration [s] and the integrator.

    Raises:
        SetupError: If one fails.
    """
    return [_cost(*size) for size in sizes]


def whole_campaigns() -> list[tuple[int, float, Integrator]]:
    """Sizes of two campaigns, one with 100 times the runs of the other, and of a long one."""
    return [
        (1000, _BLINK, "implicitfast"),
        (100_000, _BLINK, "implicitfast"),
        (10_000, 10.0, "implicitfast"),
    ]


def _cost(runs: int, duration: float, integrator: Integrator) -> Cost:
    """Measure one campaign in a fresh process."""
    with tempfile.TemporaryDirectory() as scratch:
        command = [
            sys.executable,
            "-m",
            "grosmc_mj.cli",
            "campaign",
            str(_write_campaign(scratch)),
            "--runs",
            str(runs),
            "--duration",
            str(duration),
            "--laws",
            _LAW,
            "--integrator",
            integrator,
            "--no-figures",
            "--out",
            str(Path(scratch) / "campaign"),
        ]
        began = time.perf_counter()
        with Path(os.devnull).open("w") as nowhere:
            child = subprocess.Popen(command, stdout=nowhere, stderr=subprocess.PIPE)
            assert child.stderr is not None
            error = child.stderr.read().decode()
            # Unlike wait(), this tells the memory of the very process.
            _, status, usage = os.wait4(child.pid, 0)
            child.returncode = os.waitstatus_to_exitcode(status)
        seconds = time.perf_counter() - began

    if child.returncode:
        raise SetupError(f"a campaign of {runs} runs failed: {error.strip()}")
    return Cost(runs, duration, integrator, seconds, usage.ru_maxrss / 1024)


def _write_campaign(folder: str) -> Path:
    """Write the pendulum's campaign with a requirement that runs of any duration can keep."""
    text = campaign_files()["cart_pendulum"].read_text(encoding="utf-8")
    before_requirements, *_ = text.split("[[requirement]]")
    file = Path(folder) / "pendulum.toml"
    file.write_text(before_requirements + _REQUIREMENT, encoding="utf-8")
    return file


def scalings(workers: Sequence[int], duration: float = 2.0) -> list[Scaling]:
    """Rate of worker processes; the first number of workers is the baseline.

    With implicitfast: the shorter a step, the more the work around it costs.

    Args:
        workers: Numbers of processes.
        duration: Duration of each run [s].
    """
    rates = [_rate(count, duration) for count in workers]
    baseline = rates[0] / workers[0]
    return [
        Scaling(count, rate, rate / count / baseline)
        for count, rate in zip(workers, rates, strict=True)
    ]


class _Span(NamedTuple):
    """Start and end of a part of a campaign, in seconds of the clock."""

    start: float
    end: float


def _rate(workers: int, duration: float) -> float:
    """Runs a second of some workers, after each has designed its laws in a part of its own."""
    spans = _spans(workers, duration)
    # The first part of each worker has the design and the loading of compiled code in it.
    starts = sorted(span.start for span in spans)
    all_began = starts[workers - 1]
    later = [span for span in spans if span.start > all_began]

    first = min(span.start for span in later)
    last = max(span.end for span in later)
    return len(later) * _SHARD / (last - first)


def _spans(workers: int, duration: float) -> list[_Span]:
    """Run a campaign with some workers, a first part and four others for each."""
    parts = _PARTS * workers
    with tempfile.TemporaryDirectory() as scratch, without_graphics():
        specification = specification_of(
            str(_write_campaign(scratch)),
            runs=parts * _SHARD,
            shard=_SHARD,
            controllers=(_LAW,),
            duration=duration,
            integrator="implicitfast",
        )
        campaign = Campaign.of(specification)
        folder = Folder(Path(scratch) / "campaign")
        folder.begin(campaign, resume=False)

        executor = make_executor("processes", workers=workers)
        work = partial(_timed, part_runner(campaign, folder, threads=1))
        return [part.report for part in executor.run(work, range(parts), lambda _: None)]


def _timed(shard: Callable[[int], object], index: int) -> _Span:
    """Run a part."""
    start = time.time()
    shard(index)
    return _Span(start, time.time())
