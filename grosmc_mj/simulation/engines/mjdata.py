"""mjData: where it keeps its arrays, for compiled code, and one to compute in."""

from __future__ import annotations

import ctypes
import threading
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.errors import SetupError


@cache
def mujoco_library() -> Path:
    """MuJoCo's C library, which its Python package has loaded.

    Raises:
        SetupError: If it is not where that has it.
    """
    folder = Path(mujoco.__file__).parent
    names = ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
    found = [file for name in names for file in sorted(folder.glob(name))]
    if not found:
        raise SetupError(f"MuJoCo's C library is not in {folder}: install mujoco again by pip")
    return found[0]


@cache
def mjdata_dtype(*names: str) -> np.dtype[Any]:
    """mjData as a structure whose members are the addresses of these of its arrays.

    The offsets are read off a live mjData, so that they are those of the installed MuJoCo.

    Args:
        names: Such as ``qpos``.
    """
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><size nuserdata='1'/><worldbody><body><joint name='j'/><geom size='1'/></body>"
        "</worldbody><actuator><motor joint='j'/></actuator></mujoco>"
    )
    data = mujoco.MjData(model)
    wanted = {getattr(data, name).ctypes.data: name for name in names}
    last, offsets, offset, word = data.cfrc_ext.ctypes.data, {}, 0, 0
    # Every array's pointer is a field of the struct, so the search for the last ends inside it.
    while word != last:
        word = ctypes.c_uint64.from_address(data._address + offset).value
        if word in wanted:
            # An empty array, and the buffer of all, share the address of the array after them.
            offsets[wanted[word]] = offset
        offset += 8
    offsets = dict(sorted(offsets.items(), key=lambda item: item[1]))
    formats = [np.int64] * len(offsets)
    return np.dtype({"names": list(offsets), "formats": formats, "offsets": list(offsets.values())})


def scratch(model: mujoco.MjModel) -> mujoco.MjData:
    """An mjData as new, to compute in until the next call for the same model in this thread.

    Its memory takes a hundred times as long to make as the dynamics of a few bodies.
    """
    data = _kept(model, threading.get_ident())
    mujoco.mj_resetData(model, data)
    return data


@lru_cache(maxsize=8)
def _kept(model: mujoco.MjModel, _thread: int) -> mujoco.MjData:
    """The mjData of a model and a thread."""
    return mujoco.MjData(model)
