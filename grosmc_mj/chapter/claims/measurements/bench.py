"""The chapter's promises in the loop as built: its cases on the systems' benches."""

from __future__ import annotations

from dataclasses import replace

from grosmc_mj.chapter.claims.claim import Measured
from grosmc_mj.chapter.claims.measurements.measures import from_optimum, of
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.plants import PlantName


def bench_deviation(
    lab: Laboratory, plant: PlantName, *, system: str, case: str, controller: str, bandwidth: float
) -> Measured:
    """max |x1 - x1*| of a case on the bench, in percent of the initial error.

    Its observers have this bandwidth [rad/s].
    """
    result = lab.run(on_bench(system, case, bandwidth), plant, controller)
    return of(result, from_optimum(result.comparison))


def on_bench(system: str, case: str, bandwidth: float) -> Experiment:
    """What a case changes, in the loop of its system's bench, with observers as fast as that."""
    bench, changed = find_experiment(system, "bench"), find_experiment(system, case).case
    loop = bench.case.loop
    assert loop is not None
    faster = tuple(replace(each, bandwidth=bandwidth) for each in loop.estimators)
    return bench.varied(
        name=f"bench, {case}",
        title=f"{changed.title}, on the bench",
        x0=changed.x0,
        duration=changed.duration,
        edits=changed.edits,
        disturbances=changed.disturbances,
        loop=replace(loop, estimators=faster),
    )
