"""Errors of MuJoCo's in compiled code: caught, where they else end the process."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import mujoco

from grosmc_mj.errors import ModelError
from grosmc_mj.physics.mjdata import mujoco_library


class Guard:
    """Catches errors of MuJoCo's, which else end the process, in one thread at a time.

    MuJoCo's batch leaves a simulation at its error. This one has a single and empty simulation,
    beside which another function runs.
    """

    def __init__(self) -> None:
        self._library, error = _library(), ctypes.create_string_buffer(1000)
        model = mujoco.MjModel.from_xml_string("<mujoco><size memory='1k'/></mujoco>")
        config = (ctypes.c_int * 2)(1, 0)
        batch = self._library.mjb_makeBatch(model._address, 1, config, error, len(error))
        if not batch:
            raise ModelError(f"MuJoCo makes no batch: {error.value.decode()}")
        self._batch, self._first = batch, (ctypes.c_int * 1)(0)

    def call(self, function: int, argument: int) -> None:
        """Call a C function of an mjModel, an mjData, an integer and a pointer.

        Args:
            function: Its address.
            argument: The pointer.

        Raises:
            ModelError: If MuJoCo raised an error in it.
        """
        batch, first = self._batch, self._first
        if self._library.mjb_apply(batch, first, 1, function, argument, False):
            raise cannot_step(self._library.mjb_error(batch, 0).decode(errors="replace"))

    def __del__(self) -> None:
        if batch := getattr(self, "_batch", None):
            self._library.mjb_deleteBatch(batch)


def cannot_step(reason: str) -> ModelError:
    """Error for a message of MuJoCo's."""
    return ModelError(f"MuJoCo cannot step the model: {' '.join(reason.split())}")


_idle: list[Guard] = []


@contextmanager
def guard() -> Iterator[Guard]:
    """A guard for this thread, kept for the next one."""
    own = _idle.pop() if _idle else Guard()
    yield own
    _idle.append(own)


@cache
def _library() -> Any:
    """MuJoCo's C functions that guards call."""
    library, pointer = ctypes.CDLL(str(mujoco_library())), ctypes.c_void_p
    make, apply = library.mjb_makeBatch, library.mjb_apply
    make.restype, library.mjb_error.restype = pointer, ctypes.c_char_p
    make.argtypes = (pointer, ctypes.c_int, pointer, ctypes.c_char_p, ctypes.c_int)
    apply.argtypes = (pointer, pointer, ctypes.c_int, pointer, pointer, ctypes.c_bool)
    library.mjb_error.argtypes = (pointer, ctypes.c_int)
    library.mjb_deleteBatch.argtypes = (pointer,)
    return library


@cache
def c_address(name: str) -> int:
    """Of a C function of MuJoCo's."""
    address = ctypes.cast(getattr(_library(), name), ctypes.c_void_p).value
    assert address is not None
    return address
