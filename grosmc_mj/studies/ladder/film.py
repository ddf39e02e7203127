"""Film of a law: MuJoCo's ideal plant, the rungs about its first failure, and the top."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from grosmc_mj.experiments.experiment import RunResult
from grosmc_mj.experiments.films import film_of
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.output.films.film import MOST_TAKES, Film, Format
from grosmc_mj.output.results.verdicts import Verdict, first_failed
from grosmc_mj.studies.ladder.climb import climbs
from grosmc_mj.studies.ladder.ladder import Ladder, trial_of
from grosmc_mj.studies.target import StudiedLaw
from grosmc_mj.studies.trials import Trials


def ladder_film(
    studied: Ladder,
    law: StudiedLaw,
    rows: Sequence[Verdict],
    form: Format | None = None,
) -> Film:
    """Return a film of a law on MuJoCo's ideal plant, where it breaks first, and at the top.

    The rigid machine is drawn: motors behind their transmissions are not seen.

    Args:
        studied: The target.
        law: One of its laws.
        rows: Its rows.
        form: Format of the film.

    Raises:
        ArgumentError: If no rung runs in MuJoCo.
    """
    condition = studied.conditions[0]
    rungs = [rung for rung in studied.climbing if rung.plant == "physics"]
    if not rungs:
        raise ArgumentError("a film is of runs in MuJoCo: this target has none")

    last = len(rungs) - 1
    breaks_at = last
    failed = first_failed(climbs(rows, condition.name).get(law.name, []))
    for index, rung in enumerate(rungs):
        if failed is not None and rung.name == failed.step:
            breaks_at = index

    # The ideal plant, the rung before the law breaks, that rung, and the complete machine.
    indices = sorted({0, max(breaks_at - 1, 0), breaks_at, last})
    chosen = [rungs[index] for index in indices[:MOST_TAKES]]
    trials = Trials("physics", lambda *_: ())
    runs = [trials.record(trial_of(law, rung, condition)) for rung in chosen]
    results = [_rigid(run) for run in runs]
    return film_of(results, form, [rung.name for rung in chosen])


def _rigid(run: RunResult) -> RunResult:
    """The run without the states that the rigid plant does not have."""
    plant = run.true
    trajectory = run.trajectory
    assert isinstance(plant, MujocoPlant)
    assert trajectory.physics is not None

    # Time, positions and velocities of the rigid joints, which come first.
    n = plant.system.degrees_of_freedom
    velocities = 1 + plant.undrawn_model.nq
    columns = [0, *range(1, 1 + n), *range(velocities, velocities + n)]
    rigid = plant.rigid
    size = mujoco.mj_stateSize(rigid.undrawn_model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    assert len(columns) == size
    physics = np.ascontiguousarray(trajectory.physics[:, columns])
    return replace(run, true=rigid, trajectory=replace(trajectory, physics=physics))
