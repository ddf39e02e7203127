"""Films of the cases: the results of runs as films, and what lies beside each film."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.errors import ArgumentError, listed
from grosmc_mj.experiments.case import Case, case_document, seed_of
from grosmc_mj.films.film import MOST_TAKES, Film, Format, Take
from grosmc_mj.films.frames import Storyboard
from grosmc_mj.films.frames import __file__ as drawing_code
from grosmc_mj.films.pool import RenderingPool
from grosmc_mj.films.scene import camera_names
from grosmc_mj.films.storyboard import storyboard
from grosmc_mj.films.write import Written, write_film
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.results.document import origin, write_json
from grosmc_mj.results.palette import law_styles
from grosmc_mj.simulation.trajectory import Status

if TYPE_CHECKING:
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.runs import RunResult, Settings

# What validate shows of every case; smaller than a single film, since there are many.
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


def check_request(experiment: Experiment, controllers: Sequence[str], form: Format) -> None:
    """Refuse a film that cannot be made, before anything is run for it.

    Raises:
        ArgumentError: If there are no controllers, too many or unknown ones, or the format does not
            fit the case.
    """
    if not 1 <= len(controllers) <= MOST_TAKES:
        raise ArgumentError(
            f"a film shows 1 to {MOST_TAKES} controllers, not {len(controllers)}; valid: "
            f"{listed(experiment.controllers)}"
        )
    physics = experiment.nominal.plant
    if not isinstance(physics, MujocoPlant):
        raise ArgumentError(
            f"{experiment.path}: its plant is equations alone, and a film shows a model in MuJoCo"
        )
    for name in controllers:
        experiment.law("physics", name)
    form.check(camera_names(physics.model), experiment.case.duration)


def film_of(
    results: Sequence[RunResult], form: Format | None = None, names: Sequence[str] = ()
) -> Film:
    """The film of one case: its runs in MuJoCo, side by side.

    The ghost is the nominal optimal trajectory of each law or, where the reference moves, the
    reference.

    Args:
        results: Runs of one case on physics.
        form: How it is cut.
        names: What the controllers were asked for as; by default their own names.

    Raises:
        ArgumentError: If the runs are not of one case on physics.
    """
    cases = {(result.case.system, result.case.name) for result in results}
    if len(cases) != 1 or any(result.plant != "physics" for result in results):
        raise ArgumentError("a film shows runs of one case on physics")
    case, system, physics = results[0].case, results[0].trajectory.system, results[0].true
    assert isinstance(physics, MujocoPlant)
    spans = [np.ptp(result.comparison.reference, axis=0).max() for result in results]
    moving = max(spans) > _STILL
    errors = [result.controller.designed.error for result in results]
    # A law of the whole state holds more than the controlled coordinates: the first of these is
    # shown in place of s.
    of_states = any(isinstance(error, StateCoordinates) for error in errors)
    others = [i for i in range(len(system.states)) if i not in system.controlled]
    takes, names = [], names or [result.controller.name for result in results]
    styles = law_styles(names)
    for result, name in zip(results, names, strict=True):
        ended, until = _ENDED[result.status], float(result.trajectory.valid_until)
        takes.append(
            Take(
                label=styles[name].label,
                colour=styles[name].colour,
                run=result.trajectory,
                ghost=_ghost(result, moving=moving),
                sliding_unit=result.controller.designed.sliding_unit,
                ended=ended and f"{ended} at {until:.2f} s",
            )
        )
    return Film(
        title=f"{system.title}, {case.name}: {case.title}",
        model=physics.model,
        takes=tuple(takes),
        format=form or Format(),
        ghost_label="reference" if moving else "nominal optimum",
        ghost_symbol="yᵣ" if moving else "x*",
        beside=others[0] if of_states else None,
    )


def _ghost(result: RunResult, *, moving: bool) -> Array:
    """Where the controlled coordinates should have been, (N + 1, controlled).

    That is the reference, if it moves, or the optimum: as they are where outputs are coordinates,
    else as the coordinates that have these outputs.
    """
    comparison, law = result.comparison, result.controller
    error, controlled = law.designed.error, list(result.trajectory.system.controlled)
    if not isinstance(error, ErrorCoordinates) or error.outputs is None:
        return comparison.reference if moving else comparison.optimum
    z = np.zeros_like(comparison.optimal) if moving else comparison.optimal
    # As the true plant has them: an arm whose links are longer than believed is drawn longer too.
    true = replace(law.parameters, plant=result.plant_parameters)
    rows, last = [], None
    for t, row in zip(comparison.time, z, strict=True):
        last = error.place(t, row, true, last)
        rows.append(last[controlled])
    return np.array(rows)


def films_of(results: Sequence[RunResult], form: Format = SMALL) -> list[tuple[Case, Film]]:
    """One film for each case whose runs under ``CONTROLLERS`` are there."""
    runs = {
        (result.case, result.controller.name): result
        for result in results
        if result.plant == "physics"
    }
    films = []
    for case in dict.fromkeys(result.case for result in results):
        shown = [runs[case, name] for name in CONTROLLERS if (case, name) in runs]
        if len(shown) == len(CONTROLLERS):
            films.append((case, film_of(shown, form)))
    return films


def write_case_film(
    case: Case,
    film: Film,
    path: Path,
    *,
    settings: Settings,
    backend: str | None = None,
    workers: int | None = None,
    pool: RenderingPool | None = None,
    gif: bool = False,
    advance: Callable[[], object] = lambda: None,
) -> Written:
    """Write a film and, beside it, a JSON file with all that it was made from.

    Args:
        case: What was run.
        film: Of its runs.
        path: The MP4.
        settings: How it was run.
        backend: As for ``write_film``.
        workers: As for ``write_film``.
        pool: As for ``write_film``.
        gif: As for ``write_film``.
        advance: As for ``write_film``.

    Raises:
        SetupError: If it cannot be rendered or written.
    """
    written = write_film(
        film, path, backend=backend, workers=workers, pool=pool, gif=gif, advance=advance
    )
    write_json(
        path.with_suffix(".json"),
        {
            **origin(seed_of(case)),
            "configuration": {
                **asdict(settings),
                "case": case_document(case),
                "controllers": [take.label for take in film.takes],
                "film": {**asdict(film.format), "camera": film.camera_name, "stop": film.stop},
                "backend": written.backend,
                "ffmpeg": {"version": written.ffmpeg.version},
            },
            "frames": written.frames,
            "duration": {"value": written.frames / film.format.fps, "unit": "s"},
            "drawn_from": film_digest(written.board),
            "sha256": _sha256(path),
        },
    )
    return written


def is_current(film: Film, path: Path) -> bool:
    """Whether this very film is there, whole: drawn from the same data by the same code."""
    try:
        beside = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        there = path.with_suffix(".png").is_file() and beside["sha256"] == _sha256(path)
        return there and beside["drawn_from"] == film_digest(storyboard(film))
    except (OSError, ValueError, KeyError, TypeError):
        return False


def film_digest(board: Storyboard) -> str:
    """Hash of all that a film's frames depend on: states, model, format and drawing code."""
    digest, model = hashlib.sha256(), np.zeros(mujoco.mj_sizeModel(board.model), np.uint8)
    mujoco.mj_saveModel(board.model, None, model)
    parts: list[Any] = [model, board.times, *board.chart, board.camera, board.placement]
    parts += [board.speed, board.largest, mujoco.__version__]
    for scene in board.scenes:
        parts += scene
    parts += [path.read_bytes() for path in sorted(Path(drawing_code).parent.glob("*.py"))]
    for part in parts:
        digest.update(part.tobytes() if isinstance(part, np.ndarray) else repr(part).encode())
    return digest.hexdigest()


def _sha256(path: Path) -> str:
    """Hash of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
