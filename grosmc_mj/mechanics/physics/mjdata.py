"""MuJoCo's C library, and an mjData to compute in."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import cache, lru_cache
from pathlib import Path

import mujoco

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import SetupError


# It searches a folder.
@cache
def mujoco_library() -> Path:
    """Path of MuJoCo's C library, which its Python package has loaded.

    Raises:
        SetupError: If it is not in that package.
    """
    folder = Path(mujoco.__file__).parent
    for pattern in ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll"):
        files = sorted(folder.glob(pattern))
        if files:
            return files[0]
    raise SetupError(f"MuJoCo's C library is not in {folder}: install mujoco again by pip")


def scratch(model: mujoco.MjModel) -> mujoco.MjData:
    """Return an mjData as new, valid until the next call for the same model in this thread.

    Its memory takes a hundred times as long to make as the dynamics of a few bodies.
    """
    data = _kept(model, threading.get_ident())
    mujoco.mj_resetData(model, data)
    return data


def forward(
    model: mujoco.MjModel,
    x: Array,
    u: Array | None = None,
    w: Array | None = None,
    bodies: Sequence[str] = (),
) -> mujoco.MjData:
    """Compute the dynamics at a state; the data are valid until the next call, as ``scratch``.

    Args:
        model: Compiled.
        x: qpos, then qvel, (n,).
        u: Controls, (m,); none by default.
        w: Wrenches, (6 * bodies,); none by default.
        bodies: Their names.
    """
    n = len(x) // 2
    data = scratch(model)
    data.qpos[:] = x[:n]
    data.qvel[:] = x[n:]
    if u is not None:
        data.ctrl[:] = u
    if w is not None:
        indices = [model.body(name).id for name in bodies]
        data.xfrc_applied[indices] = w.reshape(-1, 6)
    mujoco.mj_forward(model, data)
    return data


@lru_cache(maxsize=8)
def _kept(model: mujoco.MjModel, _thread: int) -> mujoco.MjData:
    """The mjData of a model and a thread."""
    return mujoco.MjData(model)
