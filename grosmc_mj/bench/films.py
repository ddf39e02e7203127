"""Frames per second of films beside MuJoCo's bare renderer, as ratios within one run."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import mujoco
from loky.process_executor import ProcessPoolExecutor

from grosmc_mj.arrays import Array
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.films import CONTROLLERS, film_of
from grosmc_mj.films.film import Film, Format
from grosmc_mj.films.frames import OVERSAMPLING
from grosmc_mj.films.storyboard import film_model
from grosmc_mj.films.write import write_film

_SECONDS = 4.0
_BARE_FRAMES = 40


class FilmRate(NamedTuple):
    """One way to make frames of the same size.

    Attributes:
        what: What was made.
        rate: Median frames per second.
        ratio: Median of the film's rate over this one, in the same round; 1 for the film.
    """

    what: str
    rate: float
    ratio: float


def benchmark_films(
    backend: str,
    form: Format | None = None,
    rounds: int = 3,
    advance: Callable[[], Any] = lambda: 0,
) -> list[FilmRate]:
    """Measure a film of the pendulum, two runs side by side, against bare frames of its size.

    The film's frames are rendered by one worker a core, composed and encoded; starting the workers
    is left out, as the renderer's start is of the bare frames. Bare frames are those of one
    ``mujoco.Renderer`` in one process, which software OpenGL spreads over all cores: of the
    shipped model, and of it at the films' detail with as many samples a pixel and with one.

    Args:
        backend: Value of MUJOCO_GL.
        form: Of the film.
        rounds: How often each is measured.
        advance: Called after each measurement.
    """
    form = form or Format(stop=_SECONDS)
    experiment = find_experiment("cart_pendulum", "nominal")
    film = film_of([experiment.run("physics", name) for name in CONTROLLERS], form)
    assert film.takes[0].run.physics is not None
    states = film.takes[0].run.physics[film.rows(film.takes[0])][:_BARE_FRAMES]
    size = f"{form.width}x{form.height}"
    measured: dict[str, Callable[[], float]] = {
        f"film, {size}, two runs, composed and encoded": lambda: _film_rate(film, backend)
    }
    for name, model in _bare_models(film.model, form).items():
        measured[f"mujoco.Renderer, {size}, {name}"] = partial(
            _bare_rate, model, states, form, backend
        )
    rates: dict[str, list[float]] = {name: [] for name in measured}
    for _ in range(rounds):
        for name, measure in measured.items():
            rates[name].append(measure())
            advance()
    composed = next(iter(rates.values()))
    return [
        FilmRate(
            name,
            statistics.median(own),
            statistics.median(film / each for film, each in zip(composed, own, strict=True)),
        )
        for name, own in rates.items()
    ]


def _bare_models(model: mujoco.MjModel, form: Format) -> dict[str, mujoco.MjModel]:
    """The models whose bare frames a film is compared with."""
    single = film_model(model, form.width, form.height)
    several = film_model(model, form.width, form.height)
    several.vis.quality.offsamples = OVERSAMPLING**2
    return {
        "the shipped model": model,
        f"the films' detail, {OVERSAMPLING**2} samples a pixel as in films": several,
        "the films' detail, 1 sample a pixel": single,
    }


def _film_rate(film: Film, backend: str) -> float:
    """Frames per second of a whole film, from the first frame that is ready."""
    ticks: list[float] = []
    with TemporaryDirectory() as folder:
        write_film(
            film,
            Path(folder) / "film.mp4",
            backend=backend,
            advance=lambda: ticks.append(time.perf_counter()),
        )
    # The first frames of all workers come at once: they belong to the start.
    skipped = len(ticks) // 5
    return (len(ticks) - 1 - skipped) / (ticks[-1] - ticks[skipped])


def _bare_rate(model: mujoco.MjModel, states: Array, form: Format, backend: str) -> float:
    """Frames per second of MuJoCo's renderer, in a process of its own."""
    with ProcessPoolExecutor(1, env={"MUJOCO_GL": backend}) as executor:
        return executor.submit(_bare_frames, model, states, form.width, form.height).result()


def _bare_frames(model: mujoco.MjModel, states: Array, width: int, height: int) -> float:
    """Render each state and nothing else, in a worker."""
    data = mujoco.MjData(model)
    with mujoco.Renderer(model, height, width) as renderer:
        start = 0.0
        for index, state in enumerate(states):
            if index == 3:
                start = time.perf_counter()
            mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
            mujoco.mj_fwdPosition(model, data)
            renderer.update_scene(data, "follow")
            renderer.render()
        return (len(states) - 3) / (time.perf_counter() - start)
