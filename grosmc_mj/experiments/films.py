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

import grosmc_mj.films
from grosmc_mj.arrays import Array
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.document import case_document, seed_of
from grosmc_mj.films.board import Storyboard
from grosmc_mj.films.film import MOST_TAKES, Film, Format, Take, camera_names
from grosmc_mj.films.marks import trace_site
from grosmc_mj.films.storyboard import storyboard
from grosmc_mj.films.write import Written, write_film
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.report.document import origin, write_json
from grosmc_mj.report.palette import law_styles
from grosmc_mj.robots.coordinates import RobotCoordinates
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
            f"{', '.join(experiment.controllers)}"
        )
    for name in controllers:
        experiment.law("physics", name)
    physics = experiment.nominal.plant
    if not isinstance(physics, MujocoPlant):
        raise ArgumentError(f"{experiment.path}: it does not run in MuJoCo: there is no film of it")
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
    physics = results[0].true
    assert isinstance(physics, MujocoPlant)
    case = results[0].case
    spans = [np.ptp(result.comparison.reference, axis=0).max() for result in results]
    moving = max(spans) > _STILL
    names = names or [result.controller.name for result in results]
    takes, styles = [], law_styles(names)
    for result, name in zip(results, names, strict=True):
        run = result.trajectory
        ended = _ENDED[result.status]
        takes.append(
            Take(
                label=styles[name].label,
                colour=styles[name].colour,
                run=run,
                ghost=_ghost(result, moving=moving),
                sliding_unit=result.controller.designed.sliding_unit,
                ended=ended and f"{ended} at {float(run.valid_until):.2f} s",
            )
        )
    return Film(
        title=f"{results[0].trajectory.system.title}, {case.name}: {case.title}",
        model=physics.model,
        takes=tuple(takes),
        format=form or Format(),
        ghost_label="reference" if moving else "nominal optimum",
        ghost_symbol="yᵣ" if moving else "x*",
        beside=_held_beside(results),
        trace=_trace(results),
    )


def _trace(results: Sequence[RunResult]) -> int:
    """The site whose path is drawn: the tip of a robot, if its model names one."""
    physics = results[0].true
    assert isinstance(physics, MujocoPlant)
    errors = [result.controller.designed.error for result in results]
    robots = all(isinstance(error, RobotCoordinates) for error in errors)
    return trace_site(physics.model) if robots else -1


def _held_beside(results: Sequence[RunResult]) -> int | None:
    """The first state that a law of the whole state holds beside the controlled ones, if any."""
    errors = [result.controller.designed.error for result in results]
    if not any(isinstance(error, StateCoordinates) for error in errors):
        return None
    system = results[0].trajectory.system
    return next(i for i in range(len(system.states)) if i not in system.controlled)


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
    films = []
    for case in dict.fromkeys(result.case for result in results):
        shown = [
            result
            for name in CONTROLLERS
            for result in results
            if (result.case, result.plant, result.controller.name) == (case, "physics", name)
        ]
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
    gif: bool = False,
    advance: Callable[[], object] = lambda: None,
) -> Written:
    """Write a film and, beside it, a JSON file with all that it was made from.

    Raises:
        SetupError: If it cannot be rendered or written.
    """
    digest = film_digest(storyboard(film))
    written = write_film(film, path, backend=backend, workers=workers, gif=gif, advance=advance)
    write_json(
        path.with_suffix(".json"),
        {
            **origin(seed_of(case)),
            "configuration": {
                **asdict(settings),
                "case": case_document(case),
                "controllers": [take.label for take in film.takes],
                "film": {
                    **asdict(film.format),
                    "camera": film.camera_name,
                    "stop": film.end if film.format.stop is None else film.format.stop,
                },
                "backend": written.backend,
                "ffmpeg": {"origin": written.ffmpeg.origin, "version": written.ffmpeg.version},
            },
            "frames": written.frames,
            "duration": {"value": written.frames / film.format.fps, "unit": "s"},
            "drawn_from": digest,
            "sha256": _sha256(path),
        },
    )
    return written


def is_current(film: Film, path: Path) -> bool:
    """Whether this very film is there, whole: drawn from the same data by the same code."""
    try:
        beside = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        recorded = (beside["drawn_from"], beside["sha256"])
        there = path.with_suffix(".png").is_file()
        return there and recorded == (film_digest(storyboard(film)), _sha256(path))
    except (OSError, ValueError, KeyError, TypeError):
        return False


def film_digest(board: Storyboard) -> str:
    """Hash of all that a film's frames depend on: states, model, format and drawing code."""
    digest = hashlib.sha256()
    size = mujoco.mj_sizeModel(board.model)
    model = np.zeros(size, np.uint8)
    mujoco.mj_saveModel(board.model, None, model)
    parts: list[Any] = [model, board.times, board.chart.empty, board.chart.drawn]
    for scene in board.scenes:
        parts += [*scene[:5], *(scene.trace or ())]
    parts += [board.camera, board.placement, board.speed, board.largest, mujoco.__version__]
    home = Path(grosmc_mj.films.__file__).parent
    parts += [path.read_bytes() for path in sorted(home.glob("*.py"))]
    for part in parts:
        digest.update(part.tobytes() if isinstance(part, np.ndarray) else repr(part).encode())
    return digest.hexdigest()


def _sha256(path: Path) -> str:
    """Hash of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
