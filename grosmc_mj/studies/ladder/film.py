"""A film of one law on some rungs, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.films import film_of
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.films.film import MOST_TAKES, Film, Format
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.studies.ladder.answers import first_failed, of_law
from grosmc_mj.studies.ladder.measure import Ladder, Standing, run_of
from grosmc_mj.studies.ladder.rungs import Rung
from grosmc_mj.studies.studied import StudiedLaw


def ladder_film(
    studied: Ladder, law: StudiedLaw, rows: Sequence[Standing], form: Format | None = None
) -> Film:
    """A law on MuJoCo's ideal plant, around where it breaks first, and on the whole machine.

    What is drawn is the rigid machine: motors behind their transmissions are not seen.

    Args:
        studied: The target.
        law: One of its laws.
        rows: How it stands.
        form: How the film is cut.

    Raises:
        ArgumentError: If nothing of it runs in MuJoCo.
    """
    condition = studied.conditions[0]
    rungs = _telling(studied.climbing, of_law(rows, law.name, condition.name))
    results = [_rigid(run_of(studied, law, rung, condition)) for rung in rungs]
    return film_of(results, form, [rung.name for rung in rungs])


def _telling(climbing: Sequence[Rung], way: Sequence[Standing]) -> list[Rung]:
    """Rungs in MuJoCo: the first, the one before the first that fails, that one, the last."""
    physics = [rung for rung in climbing if rung.plant == "physics"]
    if not physics:
        raise ArgumentError("a film is of runs in MuJoCo: this target has none")
    failed = first_failed(way)
    at = physics.index(failed.rung) if failed and failed.rung in physics else len(physics) - 1
    chosen = sorted({0, max(at - 1, 0), at, len(physics) - 1})
    return [physics[i] for i in chosen[:MOST_TAKES]]


def _rigid(result: RunResult) -> RunResult:
    """The same run, without the states that the rigid plant does not have."""
    plant, run = result.true, result.trajectory
    assert isinstance(plant, MujocoPlant)
    assert run.physics is not None
    n, model = plant.system.degrees_of_freedom, plant.undrawn_model
    columns = [0, *range(1, 1 + n), *range(1 + model.nq, 1 + model.nq + n)]
    rigid = plant.rigid
    size = mujoco.mj_stateSize(rigid.undrawn_model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    assert len(columns) == size
    seen = np.ascontiguousarray(run.physics[:, columns])
    return replace(result, true=rigid, trajectory=replace(run, physics=seen))
