"""MuJoCo's process-wide hooks: warnings are counted and not printed, foreign callbacks refused."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

from grosmc_mj.errors import SetupError


@contextmanager
def warnings_counted_only() -> Iterator[None]:
    """Keep MuJoCo from printing its warnings and from writing MUJOCO_LOG.TXT, in this block only.

    They are counted in mjData all the same, and a run that they end says so itself. Somebody
    else's handler is left alone.
    """
    global _silent
    with _lock:
        ours = _silent > 0 or mujoco.get_mju_user_warning() is None
        if ours:
            _silent += 1
            mujoco.set_mju_user_warning(_ignore)
    try:
        yield
    finally:
        with _lock:
            _silent -= ours
            if ours and _silent == 0:
                mujoco.set_mju_user_warning(None)


@contextmanager
def quiet_reading() -> Iterator[None]:
    """Read or compile a model without warnings of MuJoCo: its mistakes are errors."""
    with warnings_counted_only(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _ignore(_message: str) -> None:
    """Say nothing."""


_lock = threading.Lock()
# Blocks without MuJoCo's warnings that are under way, in any thread.
_silent = 0

# MuJoCo's callbacks that have a part in the motion.
_CALLBACKS = ("control", "passive", "act_dyn", "act_gain", "act_bias", "contactfilter", "sensor")


def refuse_foreign_callback() -> None:
    """Refuse to run while somebody else's callback would set the control or add forces.

    Raises:
        SetupError: If one is installed.
    """
    for kind in _CALLBACKS:
        if getattr(mujoco, f"get_mjcb_{kind}")() is not None:
            does = "overrule the law" if kind == "control" else "change the plant"
            raise SetupError(
                f"a MuJoCo {kind} callback is already installed in this process and would "
                f"{does}: remove it with mujoco.set_mjcb_{kind}(None)"
            )
