"""MuJoCo's process-wide hooks: warnings are counted and not printed, foreign callbacks refused."""

from __future__ import annotations

import ctypes
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

from grosmc_mj.ground.errors import SetupError
from grosmc_mj.mechanics.physics.mjdata import mujoco_library

_lock = threading.Lock()
# Number of blocks in all threads in which MuJoCo's warnings are not printed.
_silent = 0
# Number of blocks in all threads in which MuJoCo's clock is suspended.
_suspensions = 0
# Address of the clock that was suspended.
_clock: int | None = None

# MuJoCo's callbacks that have a part in the motion.
_CALLBACKS = ("control", "passive", "act_dyn", "act_gain", "act_bias", "contactfilter", "sensor")


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
        if ours:
            with _lock:
                _silent -= 1
                if _silent == 0:
                    mujoco.set_mju_user_warning(None)


@contextmanager
def clock_suspended() -> Iterator[None]:
    """Suspend MuJoCo's clock in this block; of a small model it takes almost half of a step.

    The Python package of MuJoCo has every stage of every step timed, for ``mjData.timer``, by a
    clock of its own that ``mujoco.set_mjcb_time(None)`` leaves installed. States do not depend on
    it. Blocks may be nested and may overlap in several threads: the last one that ends restores the
    clock, which may be one that the user has installed. Meanwhile ``mjData.timer`` means nothing in
    any thread. Other threads may step models: MuJoCo 3.17 loads the pointer once before each call
    of the clock, tests it and calls it.
    """
    global _suspensions, _clock
    pointer = ctypes.c_void_p.in_dll(ctypes.CDLL(str(mujoco_library())), "mjcb_time")
    with _lock:
        _suspensions += 1
        # None inside another block, unless somebody has installed a clock since that one began.
        if pointer.value is not None:
            _clock = pointer.value
            pointer.value = None
    try:
        yield
    finally:
        with _lock:
            _suspensions -= 1
            if _suspensions == 0 and pointer.value is None:
                pointer.value = _clock


@contextmanager
def warnings_ignored() -> Iterator[None]:
    """Read or compile a model without warnings of MuJoCo: its mistakes are errors."""
    with warnings_counted_only(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _ignore(_message: str) -> None:
    """Say nothing."""


def refuse_foreign_callback() -> None:
    """Refuse to run while somebody else's callback would set the control or add forces.

    Raises:
        SetupError: If one is installed.
    """
    for kind in _CALLBACKS:
        if getattr(mujoco, f"get_mjcb_{kind}")() is not None:
            effect = "overrule the law" if kind == "control" else "change the plant"
            raise SetupError(
                f"a MuJoCo {kind} callback is already installed in this process and would "
                f"{effect}: remove it with mujoco.set_mjcb_{kind}(None)"
            )
