"""From a film's value to its storyboard; nothing is rendered yet."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import matplotlib as mpl
import mujoco
import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.films.board import OVERSAMPLING, Scene, Storyboard, Trace, pose
from grosmc_mj.films.camera import place
from grosmc_mj.films.chart import draw_chart
from grosmc_mj.films.film import Film, Take
from grosmc_mj.films.layout import Layout
from grosmc_mj.films.marks import site_path

# Poses at which the camera's place is decided.
_LOOKS = 60
# A film's pictures are small: this is all the detail that can be seen in them.
_QUALITY = {"offsamples": 0, "shadowsize": 2048, "numslices": 48, "numstacks": 16, "numquads": 1}

_AMBIENT, _DIFFUSE = 0.4, 0.6


@lru_cache(maxsize=1)
def storyboard(film: Film) -> Storyboard:
    """Prepare a film; nothing is rendered yet. The last one is kept."""
    form = film.format
    layout = Layout(form.width, form.height, len(film.takes))
    system = film.takes[0].run.system
    scenes = tuple(_scene(film, index) for index in range(len(film.takes)))
    model = film_model(film.model, layout.picture(0).width, layout.picture(0).height)
    box = layout.picture(0)
    wrenches = [scene.wrench for scene in scenes if scene.wrench is not None]
    force, torque = (
        max((float(np.linalg.norm(w[..., part], axis=-1).max()) for w in wrenches), default=0.0)
        for part in (slice(0, 3), slice(3, 6))
    )
    joints = [model.joint(system.joints[index]) for index in system.controlled]
    return Storyboard(
        model=model,
        camera=film.camera,
        placement=place(model, film.camera, _poses(model, scenes), box.width / box.height),
        layout=layout,
        chart=draw_chart(film, layout),
        times=film.times,
        speed=form.speed,
        scenes=scenes,
        bodies=tuple(model.body(name).id for name in system.bodies),
        controlled=tuple(int(joint.qposadr[0]) for joint in joints),
        largest=(force, torque),
        telling=_telling(film),
        fonts=Path(mpl.get_data_path()) / "fonts" / "ttf",
    )


def film_model(model: mujoco.MjModel, width: int, height: int) -> mujoco.MjModel:
    """A copy of a model with the detail and the off-screen buffer that its pictures need."""
    own = copy.copy(model)
    for name, value in _QUALITY.items():
        setattr(own.vis.quality, name, value)
    if own.nlight == 0:
        # MuJoCo's own lamp at the camera is too dim to be the only one.
        own.vis.headlight.ambient[:], own.vis.headlight.diffuse[:] = _AMBIENT, _DIFFUSE
    # MuJoCo's cameras are pairs of eyes; a picture of one would show the mean of two.
    own.cam_ipd[:] = 0
    own.vis.global_.offwidth = OVERSAMPLING * width
    own.vis.global_.offheight = OVERSAMPLING * height
    return own


def _scene(film: Film, index: int) -> Scene:
    """The recorded rows of one run that the frames show."""
    take = film.takes[index]
    run, rows = take.run, film.rows(take)
    assert run.physics is not None
    last = float(run.time[-1])
    wrench = None
    if run.wrench is not None:
        held = run.wrench.reshape(len(run.wrench), len(run.system.bodies), 6)
        # A run that ended at its start has no interval in which anything acted.
        held = held if len(held) else np.zeros((1, *held.shape[1:]))
        wrench = held[np.minimum(rows, len(held) - 1)]
    over = len(film.times)
    if take.ended:
        over = min(int(np.searchsorted(film.times, last)), len(film.times) - 1)
    ghost = None if take.ghost is None else take.ghosts[rows]
    physics = run.physics[rows]
    trace = None if film.trace < 0 else _traced(film, take, physics, ghost)
    return Scene(physics, ghost, wrench, over, take.ended, trace)


def _traced(film: Film, take: Take, physics: Array, ghost: Array | None) -> Trace:
    """Where the traced site is in each frame, and where the ghost has it."""
    model, system = film.model, take.run.system
    positions = physics[:, 1 : 1 + model.nq]
    wanted = None
    if ghost is not None:
        posed = positions.copy()
        posed[:, list(system.controlled)] = ghost
        wanted = site_path(model, film.trace, posed)
    return Trace(site_path(model, film.trace, positions), wanted, take.colour)


def _telling(film: Film) -> int:
    """The frame in which a run is furthest from its ghost; without ghosts, the middle one.

    The first sixth does not count: a poster shall show some of the curves.
    """
    furthest = np.zeros(len(film.times))
    for take in film.takes:
        if take.ghost is not None:
            there = take.run.state[:, list(take.run.system.controlled)]
            distance = np.abs(there - take.ghosts).max(axis=1)
            furthest = np.maximum(furthest, distance[film.rows(take)])
    early = len(film.times) // 6
    return early + int(furthest[early:].argmax()) if furthest.any() else len(film.times) // 2


def _poses(model: mujoco.MjModel, scenes: tuple[Scene, ...]) -> Iterator[mujoco.MjData]:
    """Some poses of each run, spread over the film."""
    data = mujoco.MjData(model)
    for scene in scenes:
        count = min(_LOOKS, len(scene.physics))
        for frame in np.linspace(0, len(scene.physics) - 1, count).astype(int):
            pose(model, data, scene.physics[frame])
            yield data
