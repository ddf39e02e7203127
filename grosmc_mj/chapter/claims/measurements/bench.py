"""The chapter's promises in the loop as built: its cases on the systems' benches."""

from __future__ import annotations

import numpy as np

from grosmc_mj.chapter.claims.claim import Measured
from grosmc_mj.chapter.claims.measurements.measures import from_optimum, of
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import RunResult


def bench_deviation(
    lab: Laboratory, plant: PlantName, *, system: str, case: str, controller: str
) -> Measured:
    """max |x1 - x1*| of a case on the bench, in percent of the initial error."""
    result = _run(lab, plant, system, case, controller)
    ideal = {"sign": "as printed, without a loop"}.get(controller, "")
    note = ""
    if ideal:
        without = from_optimum(lab.case(system, case, plant, "grosmc").comparison)
        note = f"{without:.3g} % {ideal}"
    return of(result, from_optimum(result.comparison), note)


def bench_off_surface(
    lab: Laboratory, plant: PlantName, *, system: str, case: str, controller: str
) -> Measured:
    """Largest |s| that the law sees on the bench over that without a loop."""
    built = _run(lab, plant, system, case, controller).trajectory
    ideal = lab.case(system, case, plant, "grosmc")
    if built.sliding is None or ideal.trajectory.sliding is None:
        return of(ideal, None, "the law has no surface")
    largest = [float(np.abs(run.sliding).max()) for run in (built, ideal.trajectory)]
    return of(ideal, largest[0] / largest[1], f"{largest[0]:.3g} against {largest[1]:.3g}")


def on_bench(system: str, case: str) -> Experiment:
    """What a case changes, in the loop of its system's bench."""
    bench, changed = find_experiment(system, "bench"), find_experiment(system, case).case
    return bench.varied(
        name=f"bench, {case}",
        title=f"{changed.title}, on the bench",
        x0=changed.x0,
        duration=changed.duration,
        edits=changed.edits,
        disturbances=changed.disturbances,
    )


def _run(lab: Laboratory, plant: PlantName, system: str, case: str, controller: str) -> RunResult:
    return lab.run(on_bench(system, case), plant, controller)
