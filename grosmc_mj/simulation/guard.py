"""Errors of MuJoCo in compiled code become exceptions; without a guard they end the process."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import mujoco

from grosmc_mj.ground.errors import ModelError
from grosmc_mj.mechanics.physics.mjdata import mujoco_library


class Guard:
    """Turns errors of MuJoCo into exceptions, in one thread at a time.

    MuJoCo's batch survives an error in a simulation. The batch here has a single empty simulation,
    and runs another function in its place.
    """

    def __init__(self) -> None:
        self._library = _library()
        error = ctypes.create_string_buffer(1000)
        model = mujoco.MjModel.from_xml_string("<mujoco><size memory='1k'/></mujoco>")
        config = (ctypes.c_int * 2)(1, 0)
        batch = self._library.mjb_makeBatch(model._address, 1, config, error, len(error))
        if not batch:
            raise ModelError(f"MuJoCo makes no batch: {error.value.decode()}")
        self._batch = batch
        self._first = (ctypes.c_int * 1)(0)

    def call(self, function: int, argument: int) -> None:
        """Call a C function of an mjModel, an mjData, an integer and a pointer.

        Args:
            function: Address of the function.
            argument: Address that the pointer holds.

        Raises:
            ModelError: If MuJoCo raised an error in it.
        """
        if self._library.mjb_apply(self._batch, self._first, 1, function, argument, False):
            message = self._library.mjb_error(self._batch, 0)
            raise cannot_step(message.decode(errors="replace"))

    def __del__(self) -> None:
        # Missing where the constructor raised an error.
        batch = getattr(self, "_batch", None)
        if batch:
            self._library.mjb_deleteBatch(batch)


def cannot_step(reason: str) -> ModelError:
    """Error with a message of MuJoCo."""
    return ModelError(f"MuJoCo cannot step the model: {' '.join(reason.split())}")


_idle: list[Guard] = []


@contextmanager
def guard() -> Iterator[Guard]:
    """Guard for this thread; later threads use it again."""
    idle = _idle.pop() if _idle else Guard()
    yield idle
    _idle.append(idle)


# Loading the library and its signatures takes 0.3 ms, which a run of a few steps would notice.
@cache
def _library() -> Any:
    """MuJoCo's C library with the signatures of the functions of a batch."""
    library = ctypes.CDLL(str(mujoco_library()))
    pointer = ctypes.c_void_p
    library.mjb_makeBatch.restype = pointer
    library.mjb_makeBatch.argtypes = (
        pointer,
        ctypes.c_int,
        pointer,
        ctypes.c_char_p,
        ctypes.c_int,
    )
    library.mjb_apply.argtypes = (
        pointer,
        pointer,
        ctypes.c_int,
        pointer,
        pointer,
        ctypes.c_bool,
    )
    library.mjb_error.restype = ctypes.c_char_p
    library.mjb_error.argtypes = (pointer, ctypes.c_int)
    library.mjb_deleteBatch.argtypes = (pointer,)
    return library


def c_address(name: str) -> int:
    """Address of a C function of MuJoCo."""
    address = ctypes.cast(getattr(_library(), name), ctypes.c_void_p).value
    assert address is not None
    return address
