"""Weights and gains of a law by the names of states, outputs and inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.theory.control.controller import Design, gain_keys


def named_weights(design: Design) -> dict[str, dict[str, float]]:
    """Return Q and R of a law by the names of what they weigh.

    An entry beside the diagonal has the names of both: ``angle and speed``. A law whose weights
    nobody has chosen has none.
    """
    if not design.weighed:
        return {}
    return {
        "Q": _by_name(design.lqr.Q, design.error.names),
        "R": _by_name(design.lqr.R, _input_names(design)),
    }


def named_gains(design: Design) -> dict[str, float]:
    """Return the gains of a law with names in the place of numbers: ``K of torque, angle``."""
    names = _names_of_gains(design)
    return {_full_name(key, names): value for key, value in design.gains.items()}


def weights_in_words(design: Design) -> str:
    """Return Q and R of a law, entry by entry."""
    return "; ".join(f"{key}: {_listed(entries)}" for key, entries in named_weights(design).items())


def gains_in_words(design: Design) -> str:
    """Return the gains of a law; of several inputs the entries that are not zero."""
    names = _names_of_gains(design)
    several = design.error.inputs > 1
    rows: dict[str, dict[str, float]] = {}
    numbers: dict[str, float] = {}
    for key, value in design.gains.items():
        if key not in names:
            numbers[key] = value
        elif value or not several:
            symbol, row, column = names[key]
            title = f"{symbol} of {row}" if several else symbol
            rows.setdefault(title, {})[column] = value

    parts = [f"{title}: {_listed(entries)}" for title, entries in rows.items()]
    if numbers:
        parts.append(", ".join(f"{key} = {value:.4g}" for key, value in numbers.items()))
    return "; ".join(parts)


def _by_name(matrix: Array, names: Sequence[str]) -> dict[str, float]:
    """Return the diagonal of a symmetric matrix, and entries beside it that are not zero."""
    entries = {name: float(matrix[i, i]) for i, name in enumerate(names)}
    for i, j in np.argwhere(np.triu(matrix, 1)).tolist():
        entries[f"{names[i]} and {names[j]}"] = float(matrix[i, j])
    return entries


def _input_names(design: Design) -> Sequence[str]:
    """Return the names of what R weighs."""
    return design.error.input_names(linearizing=design.linearizing)


def _names_of_gains(design: Design) -> dict[str, tuple[str, str, str]]:
    """Return symbol, row and column in names of each entry of the gains K and Ki, by its key."""
    rows = _input_names(design)
    outputs = [design.error.names[row] for row in design.error.output_rows]
    columns: dict[str, Sequence[str]] = {"K": design.error.names, "Ki": outputs}

    names = {}
    for symbol, columns_of_symbol in columns.items():
        keys = gain_keys(symbol, len(rows), len(columns_of_symbol))
        for (i, j), key in keys.items():
            names[key] = (symbol, rows[i], columns_of_symbol[j])
    return names


def _full_name(key: str, names: Mapping[str, tuple[Any, ...]]) -> str:
    """Return the name of a gain; one that is no entry of a matrix keeps its own."""
    if key not in names:
        return key
    symbol, row, column = names[key]
    return f"{symbol} of {row}, {column}"


def _listed(entries: Mapping[str, float]) -> str:
    """Return numbers with their names before them."""
    return ", ".join(f"{name} {value:.4g}" for name, value in entries.items())
