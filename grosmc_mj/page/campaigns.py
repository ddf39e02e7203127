"""The runs of a campaign for the page: counts of all of them, and some thousands as points."""

from __future__ import annotations

import itertools
import math
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from grosmc_mj.arrays import Array
from grosmc_mj.page.documents import StoredCampaignResults
from grosmc_mj.page.reading import Document

# Of each law: points, half of them the worst; bins of margins and of a plane; columns.
_POINTS, _BINS, _CELLS, _COLUMNS = 1500, 60, 32, 10
# Rows that are read; and bytes, because a small file may claim to have very many.
_MOST_ROWS, _MOST_BYTES = 4_000_000, 2**30
# What is wanted of a run, in units of its limit: negative if something is not kept.
_RELATIVE, _MARGIN = "relative", "margin "


def campaign_data(document: Document, content: StoredCampaignResults) -> dict[str, Any]:
    """Columns, histograms, planes and points of each law of a campaign.

    Raises:
        OSError, ValueError: If its parts cannot be read (``pa.ArrowException`` is a ValueError or
            has one of its own).
    """
    folder = document.path.parent
    laws = list(dict.fromkeys(each.controller for each in content.pass_rates))
    files = sorted((folder / "parts").glob("part-*.parquet"))
    names = _columns(files, content)
    found = {law: _Points(names) for law in laws}
    for law, ids, values in _rows(files, names):
        if law in found:
            found[law].add(ids, values)
    command = shlex.join(["grosmc-mj", "campaign", str(folder), "--replay"])
    return {
        "columns": names,
        "units": [content.units.get(name, "") for name in names],
        "command": command.encode("utf-8", "replace").decode(),
        "laws": {law: each.data() for law, each in found.items() if each.runs},
    }


def _columns(files: list[Path], content: StoredCampaignResults) -> list[str]:
    """What is uncertain, and margins, that every part has as numbers."""
    if not files:
        return []
    schemas = [pq.read_schema(file) for file in files]
    real = [
        {field.name for field in schema if pa.types.is_floating(field.type)} for schema in schemas
    ]
    there = set.intersection(*real)
    margins = [name for name in schemas[0].names if name.startswith(_MARGIN)]
    wanted = dict.fromkeys([_RELATIVE, *content.units, *margins])
    return [name for name in wanted if name in there][:_COLUMNS]


def _rows(files: list[Path], names: list[str]) -> Iterator[tuple[str, Array, Array]]:
    """Law, ids and values (runs, columns) of each part."""
    left = _MOST_ROWS
    for file in files:
        with pq.ParquetFile(file) as opened:
            metadata = opened.metadata
            sizes = [metadata.row_group(i).total_byte_size for i in range(metadata.num_row_groups)]
            left -= metadata.num_rows
            if left < 0 or sum(sizes) > _MOST_BYTES:
                raise ValueError(f"{file.name} and what follows has too many rows for a page")
            table = opened.read(["id", "controller", *names])
        law = np.array(table["controller"].to_pylist(), dtype=object)
        ids = table["id"].to_numpy().astype(float)
        values = np.column_stack([table[name].to_numpy().astype(float) for name in names] or [ids])
        for own in dict.fromkeys(law):
            rows = law == own
            yield str(own), ids[rows], values[rows]


class _Points:
    """The runs of one law."""

    def __init__(self, names: list[str]) -> None:
        self._names = names
        self._ids: list[Array] = []
        self._values: list[Array] = []
        self.runs = 0

    def add(self, ids: Array, values: Array) -> None:
        """Note some more."""
        self._ids.append(ids)
        self._values.append(values)
        self.runs += len(ids)

    def data(self) -> dict[str, Any]:
        """Histograms and planes of all, and the worst of them and others as points."""
        ids, values = np.concatenate(self._ids), np.concatenate(self._values)
        values = values[:, : len(self._names)]
        index = _shown(values[:, 0] if values.shape[1] else ids)
        return {
            "runs": self.runs,
            "ids": ids[index].tolist(),
            "points": [_short(column[index]) for column in values.T],
            "histograms": [_histogram(column) for column in values.T],
            "planes": self._planes(values) if len(index) < self.runs else {},
        }

    def _planes(self, values: Array) -> dict[str, Any]:
        """How many runs lie in each cell of each pair of columns."""
        edges = [_edges(column, _CELLS) for column in values.T]
        found = {}
        for i, j in itertools.combinations(range(values.shape[1]), 2):
            finite = np.isfinite(values[:, [i, j]]).all(axis=1)
            x, y = values[finite, i], values[finite, j]
            counts, *_ = np.histogram2d(x, y, bins=(edges[i], edges[j]))
            found[f"{i},{j}"] = {
                "x": _short(_middles(edges[i])),
                "y": _short(_middles(edges[j])),
                "counts": counts.T.astype(int).ravel().tolist(),
            }
        return found


def _shown(worst_first: Array) -> np.ndarray[Any, np.dtype[np.intp]]:
    """Which runs are points: all, or half of them the worst and half evenly among the others."""
    if len(worst_first) <= _POINTS:
        return np.arange(len(worst_first))
    # NaN is of a run that did not complete: nothing is worse.
    order = np.argsort(np.where(np.isnan(worst_first), -np.inf, worst_first), kind="stable")
    half = _POINTS // 2
    others = np.sort(order[half:])
    return np.concatenate([order[:half], others[:: max(1, len(others) // half)]])


def _histogram(values: Array) -> dict[str, Any]:
    """Counts of what is finite, and how many are not."""
    edges = _edges(values, _BINS)
    finite = values[np.isfinite(values)]
    counts, _ = np.histogram(finite, edges)
    return {
        "x": _short(_middles(edges)),
        "counts": counts.tolist(),
        "endless": len(values) - len(finite),
    }


def _edges(values: Array, bins: int) -> Array:
    """Of bins over what is finite."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return np.linspace(0.0, 1.0, bins + 1)
    # Halves first: the difference of two numbers may have no end.
    least, most = float(finite.min()), float(finite.max())
    width = max(most / 2 - least / 2, 1e-9 * max(abs(least), abs(most)), 1e-300)
    middle = least / 2 + most / 2
    return middle + width * np.linspace(-1.0, 1.0, bins + 1)


def _middles(edges: Array) -> Array:
    return edges[:-1] / 2 + edges[1:] / 2


def _short(values: Array) -> list[float | str | None]:
    """Numbers with six digits; null stands for what has no lower end, or is no number."""
    return [
        float(f"{x:.6g}") if math.isfinite(x) else "∞" if x > 0 else None for x in values.tolist()
    ]
