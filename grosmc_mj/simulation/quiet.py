"""MuJoCo's own warnings, counted but not printed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco


@contextmanager
def warnings_counted_only() -> Iterator[None]:
    """Keep MuJoCo from printing its warnings and from writing MUJOCO_LOG.TXT, in this block only.

    They are counted in mjData all the same, and a run that they end says so itself. Somebody
    else's handler is left alone.
    """
    if mujoco.get_mju_user_warning() is not None:
        yield
        return
    mujoco.set_mju_user_warning(_ignore)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(None)


def _ignore(_message: str) -> None:
    """Say nothing."""
