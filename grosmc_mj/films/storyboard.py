"""From a film's value to its storyboard; nothing is rendered yet."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import mujoco
import numpy as np
from matplotlib.colors import to_rgb

from grosmc_mj.films.camera import place
from grosmc_mj.films.chart import draw_chart
from grosmc_mj.films.film import Film, Take
from grosmc_mj.films.frames import OVERSAMPLING, Scene, Storyboard, pose
from grosmc_mj.films.layout import Layout
from grosmc_mj.films.marks import Trace, site_path

# Poses at which the camera's place is decided.
_LOOKS = 60
# A film's pictures are small: this is all the detail that can be seen in them.
_QUALITY = {"offsamples": 0, "shadowsize": 2048, "numslices": 48, "numstacks": 16, "numquads": 1}
_AMBIENT, _DIFFUSE = 0.4, 0.6


def storyboard(film: Film) -> Storyboard:
    """Prepare a film; nothing is rendered yet."""
    layout = Layout(film.format.width, film.format.height, len(film.takes))
    box, scenes = layout.picture(0), tuple(_scene(film, take) for take in film.takes)
    model = film_model(film.model, box.width, box.height)
    wrenches = [scene.wrench for scene in scenes if scene.wrench is not None]
    halves = np.concatenate([np.zeros((1, 6)), *(w.reshape(-1, 6) for w in wrenches)])
    return Storyboard(
        model=model,
        camera=film.camera,
        placement=place(model, film.camera, _poses(model, scenes), box.width / box.height),
        layout=layout,
        chart=draw_chart(film, layout),
        times=film.times,
        speed=film.format.speed,
        scenes=scenes,
        largest=np.linalg.norm(halves.reshape(-1, 2, 3), axis=2).max(axis=0),
        poster=_poster(film),
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


def _scene(film: Film, take: Take) -> Scene:
    """The recorded rows of one run that the frames show."""
    run, rows, model = take.run, film.rows(take), film.model
    physics, over = np.asarray(run.physics)[rows], len(film.times)
    if take.ended:
        over = min(int(np.searchsorted(film.times, run.time[-1])), len(film.times) - 1)
    wrench = ghost = trace = None
    if run.wrench is not None:
        bodies = [model.body(name).id for name in run.system.bodies]
        wrench = np.zeros((len(rows), model.nbody, 6))
        # There is one interval less than instants, and none in a run that ended at its start.
        held = np.concatenate([run.wrench, run.wrench[-1:], np.zeros((1, 6 * len(bodies)))])[rows]
        wrench[:over, bodies] = held.reshape(len(rows), -1, 6)[:over]
    positions = physics[:, 1 : 1 + model.nq]
    if take.ghost is not None:
        joints = [model.joint(run.system.joints[index]) for index in run.system.controlled]
        ghost = positions.copy()
        ghost[:, [int(joint.qposadr[0]) for joint in joints]] = take.ghosts[rows]
    if film.trace >= 0:
        reference = None if ghost is None else site_path(model, film.trace, ghost)
        trace = Trace(site_path(model, film.trace, positions), reference, to_rgb(take.colour))
    return Scene(physics, ghost, wrench, over, take.ended, trace)


def _poster(film: Film) -> int:
    """The frame in which a run is furthest from its ghost; without ghosts, the middle one.

    The first sixth does not count: a poster shall show some of the curves.
    """
    furthest, early = np.zeros(len(film.times)), len(film.times) // 6
    for take in film.takes:
        if take.ghost is not None:
            errors = take.run.state[:, list(take.run.system.controlled)] - take.ghosts
            furthest = np.maximum(furthest, np.abs(errors).max(axis=1)[film.rows(take)])
    return early + int(furthest[early:].argmax()) if furthest.any() else len(film.times) // 2


def _poses(model: mujoco.MjModel, scenes: tuple[Scene, ...]) -> Iterator[mujoco.MjData]:
    """Some poses of each run, spread over the film."""
    data = mujoco.MjData(model)
    for scene in scenes:
        last = len(scene.physics) - 1
        for frame in np.linspace(0, last, min(_LOOKS, last + 1)).astype(int):
            pose(model, data, scene.physics[frame])
            yield data
