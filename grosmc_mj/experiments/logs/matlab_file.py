"""MATLAB files: their vectors as columns, read in a process of their own."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import BrokenExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from grosmc_mj.experiments.logs.columns import LogColumn
from grosmc_mj.experiments.logs.limits import LARGEST_LOG, require_few_columns, too_large
from grosmc_mj.ground.child_processes import call_in_child
from grosmc_mj.ground.errors import ArgumentError

# Memory for reading a log [bytes]: its numbers as they are, without empty axes, and as floats.
_MEMORY = 4 * LARGEST_LOG


def matlab_columns(path: Path) -> dict[str, LogColumn]:
    """The vectors of a MATLAB file, and those in its structures, such as ``out.signals.values``.

    A damaged file can make SciPy's reader write where it must not, which ends its process.

    Raises:
        ArgumentError: If it cannot be read, or is too large.
    """
    try:
        vectors = call_in_child(_read, path, memory=_MEMORY, library="scipy.io")
    except BrokenExecutor:
        raise ArgumentError("it is damaged: the process that read it died") from None
    except MemoryError:
        raise too_large(None) from None

    columns = {}
    for name, values in vectors.items():
        written = pa.chunked_array([pa.array(values)])
        short = name.rpartition(".")[2]
        columns[name] = LogColumn(name, values.astype(float), short, written=written)
    return columns


def _read(path: Path) -> dict[str, NDArray[Any]]:
    """The vectors of a MATLAB file by their paths.

    Raises:
        ArgumentError: If it is of a kind that is not read, or too large.
    """
    # Imported where it is needed: few logs are MATLAB's.
    from scipy.io import loadmat

    try:
        content = loadmat(path, struct_as_record=False, squeeze_me=True)
    except NotImplementedError:
        raise ArgumentError("it is of MATLAB 7.3: save it with save(..., '-v7')") from None

    vectors = {}
    size = 0
    for key, value in content.items():
        if key.startswith("__"):
            continue
        for name, values in _vectors(key, value):
            size += values.nbytes
            if size > LARGEST_LOG:
                raise too_large(None)
            require_few_columns(len(vectors) + 1)
            # In the order of bytes of this machine.
            vectors[name] = values.astype(values.dtype.newbyteorder("="))
    return vectors


def _vectors(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """The vectors of a MATLAB value, with the paths to them; columns of a matrix count from 1."""
    for key in getattr(value, "_fieldnames", ()):
        yield from _vectors(f"{name}.{key}", getattr(value, key))
    if not isinstance(value, np.ndarray):
        return

    if value.dtype == object:
        for index, part in enumerate(value.ravel(), start=1):
            yield from _vectors(f"{name}({index})", part)
    elif value.dtype.kind in "biuf" and value.ndim == 1:
        yield name, value
    elif value.dtype.kind in "biuf" and value.ndim == 2:
        for index, column in enumerate(value.T, start=1):
            yield f"{name}({index})", column
