"""The case file of an identified machine: fitted values, and their joint distribution."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import read_content
from grosmc_mj.experiments.file.text import text_of
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.ground.files import atomic_write
from grosmc_mj.identify.closed_loop import is_of_loop, with_closed_loop
from grosmc_mj.identify.fit import Fit
from grosmc_mj.studies.sweep.family import number_of
from grosmc_mj.studies.sweep.quantities import Quantity

# A fitted number is drawn within so many standard deviations.
_WITHIN = 5.0
# A value is written with ten digits: ends of a range that is narrower would be one number.
_WRITTEN = 1e-8
# Correlations nearer to 1 than this are left out: rounding of numbers that determine each other.
_SAME = 1e-9


def write_case(fit: Fit, log: str, path: Path, loop: Experiment | None = None) -> None:
    """Write the case with the fitted values and their covariance.

    Args:
        fit: The fit.
        log: Name of its log.
        path: The TOML file.
        loop: Case whose closed loop it takes, see ``closed_loop``; its own without.

    Raises:
        SetupError: If it cannot be written.
    """
    text = case_text(fit, log, path, loop)
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")


def case_text(fit: Fit, log: str, path: Path, loop: Experiment | None = None) -> str:
    """Return the text of the case with the fitted values, for a file at a path."""
    experiment = fit.parameters.experiment
    content = read_content(experiment.path)
    kept = _kept_tables(fit, content.get("uncertain", []))
    settings = experiment.settings
    content["title"] = f"{experiment.title}, as identified from {log}"
    if loop is not None:
        content = with_closed_loop(content, experiment, loop)
        kept = {name: table for name, table in kept.items() if not is_of_loop(table["number"])}
        settings = loop.settings
        content["title"] = f"{loop.title}, on the machine identified from {log}"
    declared = content.get("plant", {"system": experiment.system})
    content["plant"] = _plant_table(fit, declared, path)
    for table in content.get("measured", []):
        table["log"] = os.path.relpath(experiment.path.parent / table["log"], path.parent)

    for quantity, value, _ in fit.estimates:
        number = quantity.number
        as_run = number.as_run(value, settings.timestep, settings.control_period)
        number.write(content, as_run, _written)
    content["uncertain"] = [*kept.values(), *_fitted_tables(fit)]
    content["correlation"] = [
        *(table for table in content.get("correlation", []) if kept.keys() >= {*table["between"]}),
        *_correlation_tables(fit),
    ]

    return f"# Written by grosmc-mj identify from {log}.\n{text_of(content)}"


def _plant_table(fit: Fit, declared: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """The [plant] of a case file at another path, with the plants that have the fitted numbers."""
    experiment = fit.parameters.experiment
    plant = dict(declared)
    if "model" in plant and ":" not in plant["model"]:
        model = experiment.path.parent / plant["model"]
        plant["model"] = os.path.relpath(model, path.parent)

    # Equations have no friction: only the plants that can have the numbers are compared.
    declared_names = declared.get("compare") or experiment.nominal.names
    names = [name for name in declared_names if _can_have(fit, name)]
    if 0 < len(names) < len(declared_names):
        plant["compare"] = names
    return plant


def _can_have(fit: Fit, name: PlantName) -> bool:
    """Whether a plant can have the fitted numbers."""
    parameters = fit.parameters
    try:
        parameters.model(fit.values, parameters.experiment.plant(name))
    except ModelError:
        return False
    return True


def _kept_tables(fit: Fit, declared: Sequence[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """The [[uncertain]] tables of numbers that are not fitted, by their names.

    A number that was held is as uncertain as before.
    """
    names = set()
    fitted = set()
    for quantity, _, half in fit.estimates:
        if half is not None:
            names.add(quantity.name)
            # A number that --fit named by its path may have a name of its own in the file.
            fitted.add(quantity.number.steps)

    kept = {}
    experiment = fit.parameters.experiment
    for content, table in zip(declared, experiment.file.uncertain, strict=True):
        if table.called not in names and number_of(table, experiment).steps not in fitted:
            kept[table.called] = content
    return kept


def _fitted_tables(fit: Fit) -> list[dict[str, Any]]:
    """The [[uncertain]] tables of the numbers that are fitted."""
    tables = []
    deviations = iter(np.sqrt(np.diag(fit.covariance)).tolist())
    for quantity, value, half in fit.estimates:
        if half is None:
            continue
        tables.append(_uncertain(quantity, value, next(deviations)))
    return tables


def _correlation_tables(fit: Fit) -> list[dict[str, Any]]:
    """A table for each pair of fitted numbers."""
    names = [quantity.name for quantity, _, half in fit.estimates if half is not None]
    correlation = fit.correlation.tolist()
    tables = []
    for i, name in enumerate(names):
        for other, coefficient in zip(names[:i], correlation[i], strict=False):
            if 0 < abs(coefficient) < 1 - _SAME:
                tables.append({"between": [name, other], "coefficient": coefficient})
    return tables


def _written(value: float, unit: str) -> float | str:
    """A number as a case file has it."""
    if not unit:
        return value
    return f"{value:.10g} {unit}"


def _uncertain(quantity: Quantity, value: float, deviation: float) -> dict[str, Any]:
    """A normal distribution around a fitted value, cut off where the fit's bounds are.

    Args:
        quantity: The number.
        value: Its fitted value.
        deviation: Its standard deviation.
    """
    low, high = quantity.distribution.support
    spread = max(_WITHIN * deviation, _WRITTEN * abs(value))
    numbers = {
        "mean": value,
        "deviation": deviation,
        "least": max(low, value - spread),
        "most": min(high, value + spread),
    }
    values = {key: _written(number, quantity.unit) for key, number in numbers.items()}
    table = {
        "number": quantity.number.path,
        "name": quantity.name,
        "values": {"distribution": "normal", **values},
        "nominal": _written(value, quantity.unit),
    }
    new = quantity.number.place.new or {}
    if "at" in new:
        table["at"] = new["at"]
    return table
