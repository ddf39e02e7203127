"""Where mjData keeps its arrays, for compiled code that MuJoCo calls or that calls MuJoCo."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import mujoco
import numpy as np


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
    offsets, offset = {}, 0
    # Every array's pointer is a field of the struct, so the search ends inside it.
    while wanted:
        word = ctypes.c_uint64.from_address(data._address + offset).value
        if word in wanted:
            offsets[wanted.pop(word)] = offset
        offset += 8
    formats = [np.int64] * len(offsets)
    return np.dtype({"names": list(offsets), "formats": formats, "offsets": list(offsets.values())})
