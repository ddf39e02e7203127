"""Films of the cases: results of runs as films, and the document beside each film."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.experiments.case_document import case_document, seed_of
from grosmc_mj.experiments.requirements.measured_run import MeasuredRun
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.output.films.film import Film, Format, Take
from grosmc_mj.output.films.frames import Storyboard
from grosmc_mj.output.films.frames import __file__ as drawing_code
from grosmc_mj.output.films.storyboard import storyboard
from grosmc_mj.output.films.write import WrittenFilm, write_film
from grosmc_mj.output.palette import law_colours
from grosmc_mj.output.results.document import origin, write_json
from grosmc_mj.simulation.trajectory import Status
from grosmc_mj.theory.control.coordinates.state import StateCoordinates
from grosmc_mj.theory.control.coordinates.symbolic import ErrorCoordinates

# Controllers and format of the films of validate: smaller than a single film, since there are many.
CONTROLLERS = ("lqr", "grosmc")
SMALL = Format(width=800, height=450, fps=15)

# A reference that moves by less has only been rounded.
_STILL = 1e-9

_ENDED = {
    Status.COMPLETED: "",
    Status.UNDEFINED_LAW: "law undefined",
    Status.SINGULAR_PLANT: "plant singular",
    Status.DIVERGED: "diverged",
    Status.UNDEFINED_INPUT: "input undefined",
}


def film_of(
    results: Sequence[MeasuredRun],
    form: Format | None = None,
    names: Sequence[str] = (),
) -> Film:
    """Film of one case: its runs on one plant, side by side; equations show their curves alone.

    The ghost is the nominal optimal trajectory of each law or, where the reference moves, the
    reference.

    Args:
        results: Runs of one case on one plant.
        form: Format of the film.
        names: Names of the controllers in the film; by default their own.

    Raises:
        ArgumentError: If the runs are not of one case on one plant.
    """
    _refuse_several_cases(results)
    case = results[0].case
    system = results[0].trajectory.system
    plant = results[0].true

    moving = _reference_moves(results)
    names = names or [result.controller.name for result in results]
    colours = law_colours(names)
    takes = []
    for result, name in zip(results, names, strict=True):
        take = Take(
            label=name,
            colour=colours[name],
            run=result.trajectory,
            ghost=_ghost(result, moving=moving),
            sliding_unit=result.controller.designed.sliding_unit,
            ended=_early_end(result),
        )
        takes.append(take)

    return Film(
        title=f"{system.title}, {case.name}: {case.title}",
        model=plant.model if isinstance(plant, MujocoPlant) else None,
        takes=tuple(takes),
        format=form or Format(),
        ghost_label="reference" if moving else "nominal optimum",
        ghost_symbol="yᵣ" if moving else "x*",
        one_ghost=moving,
        beside=_coordinate_beside(results),
    )


def _refuse_several_cases(results: Sequence[MeasuredRun]) -> None:
    """Raise an ArgumentError if the runs are not of one case on one plant."""
    cases = {(result.case.system, result.case.name) for result in results}
    plants = {result.plant for result in results}
    if len(cases) != 1 or len(plants) != 1:
        raise ArgumentError("a film shows runs of one case on one plant")


def _reference_moves(results: Sequence[MeasuredRun]) -> bool:
    """True if the reference of any run moves."""
    spans = [np.ptp(result.comparison.reference, axis=0).max() for result in results]
    return bool(max(spans) > _STILL)


def _early_end(result: MeasuredRun) -> str:
    """Words for the end of a run that ended early, empty for one that did not."""
    reason = _ENDED[result.status]
    if not reason:
        return ""
    until = float(result.trajectory.valid_until)
    return f"{reason} at {until:.2f} s"


def _coordinate_beside(results: Sequence[MeasuredRun]) -> int | None:
    """First coordinate that is not controlled, to be shown in place of s.

    None if a law has s, unless there is a law of the whole state, which holds more than the
    controlled coordinates.
    """
    designs = [result.controller.designed for result in results]
    of_whole_state = any(isinstance(design.error, StateCoordinates) for design in designs)
    if not of_whole_state and any(design.sliding_unit for design in designs):
        return None
    system = results[0].trajectory.system
    others = [i for i in range(len(system.states)) if i not in system.controlled]
    return others[0] if others else None


def _ghost(result: MeasuredRun, *, moving: bool) -> Array:
    """Controlled coordinates of the reference, if it moves, or of the optimum, (N + 1, controlled).

    Where outputs are no coordinates, the coordinates that have these outputs.
    """
    comparison = result.comparison
    error = result.controller.designed.error
    if not isinstance(error, ErrorCoordinates) or error.outputs is None:
        return comparison.reference if moving else comparison.optimum

    z = comparison.optimal
    if moving:
        z = np.zeros_like(z)
    # With the true plant's numbers: an arm whose links are longer than believed is drawn longer.
    p = replace(result.controller.parameters, plant=result.true.parameters)
    controlled = list(result.trajectory.system.controlled)
    rows = []
    state = None
    for t, z_t in zip(comparison.time, z, strict=True):
        state = error.place(t, z_t, p, state)
        rows.append(state[controlled])
    return np.array(rows)


def films_of(results: Sequence[MeasuredRun], form: Format = SMALL) -> list[tuple[Any, Film]]:
    """Films of the cases that have runs on physics under all of ``CONTROLLERS``."""
    on_physics = [result for result in results if result.plant == "physics"]
    runs = {(result.case.key, result.controller.name): result for result in on_physics}
    films = []
    for key in dict.fromkeys(result.case.key for result in results):
        if all((key, name) in runs for name in CONTROLLERS):
            filmed = [runs[key, name] for name in CONTROLLERS]
            films.append((filmed[0].case, film_of(filmed, form)))
    return films


def write_case_film(
    case: Any,
    film: Film,
    path: Path,
    **rendering: Any,
) -> WrittenFilm:
    """Write a film and, beside it, a JSON file with all that it was made from.

    Args:
        case: Experiment of the film.
        film: Film of runs of the case.
        path: Path of the MP4.
        rendering: Further arguments of ``write_film``.

    Raises:
        SetupError: If it cannot be rendered or written.
    """
    written = write_film(film, path, **rendering)
    configuration = {
        **asdict(case.settings),
        "case": case_document(case),
        "controllers": [take.label for take in film.takes],
        "film": {**asdict(film.format), "camera": film.camera_name, "stop": film.stop},
        "backend": written.backend,
        "ffmpeg": {"version": written.ffmpeg.version},
    }
    document = {
        "kind": "film",
        **origin(seed_of(case)),
        "configuration": configuration,
        "frames": written.frames,
        "duration": {"value": written.frames / film.format.fps, "unit": "s"},
        "drawn_from": film_digest(written.board),
        "sha256": _sha256(path),
    }
    write_json(path.with_suffix(".json"), document)
    return written


def is_current(film: Film, path: Path) -> bool:
    """Whether this very film is there, whole: drawn from the same data by the same code."""
    try:
        if not path.with_suffix(".png").is_file():
            return False
        document = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        if document["sha256"] != _sha256(path):
            return False
        return document["drawn_from"] == film_digest(storyboard(film))
    except (OSError, ValueError, KeyError, TypeError):
        return False


def film_digest(board: Storyboard) -> str:
    """Hash of all that a film's frames depend on: states, model, format and drawing code."""
    parts: list[Any] = [board.times, *board.chart, board.speed, mujoco.__version__]
    if board.stage is not None:
        stage = board.stage
        model = np.zeros(mujoco.mj_sizeModel(stage.model), np.uint8)
        mujoco.mj_saveModel(stage.model, None, model)
        parts += [model, stage.camera, stage.placement, stage.surroundings, stage.largest]
        for scene in stage.scenes:
            parts += scene
    for path in sorted(Path(drawing_code).parent.glob("*.py")):
        parts.append(path.read_bytes())

    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            digest.update(part.tobytes())
        else:
            digest.update(repr(part).encode())
    return digest.hexdigest()


def _sha256(path: Path) -> str:
    """Hash of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
