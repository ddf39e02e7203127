"""The case file of an identified machine: fitted values, and their joint distribution."""

from __future__ import annotations

import contextlib
import os
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from grosmc_mj.errors import ModelError
from grosmc_mj.experiments.file.reading import resolved_text
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.files import written_aside
from grosmc_mj.identify.fit import Fit
from grosmc_mj.sweep.family import Quantity

# A fitted number is drawn within so many standard deviations.
_WITHIN = 5.0
# The key by which a table says what it is of, where that is not the owner's own name.
_OF = {"sensor": "of", "actuator": "of", "estimator": "of", "motor": "input",
       "transmission": "joint", "lugre": "joint", "stop": "joint"}  # fmt: skip


def write_case(fit: Fit, log: str, path: Path) -> None:
    """Write the case with the fitted values and their covariance.

    Args:
        fit: The fit.
        log: Name of its log.
        path: The TOML file.

    Raises:
        SetupError: If it cannot be written.
    """
    experiment = fit.parameters.experiment
    content: dict[str, Any] = tomllib.loads(resolved_text(experiment.path))
    content["title"] = f"{experiment.case.title}, as identified from {log}"
    content["plant"] = dict(content.get("plant", {"system": experiment.case.system}))
    if "model" in content["plant"] and ":" not in content["plant"]["model"]:
        model = experiment.path.parent / content["plant"]["model"]
        content["plant"]["model"] = os.path.relpath(model, path.parent)
    names = {quantity.name for quantity in fit.parameters.quantities}
    own = zip(content.get("uncertain", []), experiment.file.uncertain, strict=False)
    kept = [table for table, read in own if read.called not in names]
    settings, deviations = experiment.settings, iter(np.sqrt(np.diag(fit.covariance)).tolist())
    fitted: list[Quantity] = []
    for quantity, value, half in fit.estimates:
        _set(content, quantity, quantity.as_run(value, settings.timestep, settings.control_period))
        if half is not None:
            kept.append(_uncertain(quantity, value, next(deviations)))
            fitted.append(quantity)
    content["uncertain"] = kept
    rho = fit.correlation
    content["correlation"] = [
        {"between": [fitted[i].name, fitted[j].name], "coefficient": float(rho[i, j])}
        for i in range(len(fitted))
        for j in range(i)
        if abs(rho[i, j]) < 1 - 1e-9
    ]
    if able := _able(fit):
        content["plant"]["compare"] = able
    with written_aside(path) as part:
        part.write_text(
            f"# Written by grosmc-mj identify from {log}.\n{tomli_w.dumps(content)}",
            encoding="utf-8",
        )


def _able(fit: Fit) -> list[PlantName]:
    """The plants that have the fitted numbers, if others have not: equations have no friction."""
    experiment, able = fit.parameters.experiment, list[PlantName]()
    for name in experiment.plant_names:
        with contextlib.suppress(ModelError):
            fit.parameters.plant(fit.values, experiment.plant(name))
            able.append(name)
    return able if len(able) < len(experiment.plant_names) else []


def _written(value: float, unit: str) -> float | str:
    return f"{value:.10g} {unit}" if unit else value


def _set(content: dict[str, Any], quantity: Quantity, value: float) -> None:
    """Bring a value into the table that has it."""
    written = _written(value, quantity.unit)
    if quantity.owner == "computing":
        content["computing"] = content.get("computing", {}) | {quantity.quantity: written}
        return
    edited = quantity.owner in ("body", "joint", "parameter")
    name, key = ("edit", quantity.owner) if edited else (quantity.owner, _OF[quantity.owner])
    tables = [dict(table) for table in content.get(name, [])]
    table = next((row for row in tables if row.get(key) == quantity.of), None)
    if table is None:
        tables.append(table := {key: quantity.of})
    table[quantity.quantity] = written
    content[name] = tables


def _uncertain(quantity: Quantity, value: float, deviation: float) -> dict[str, Any]:
    """A normal distribution around a fitted value, cut off where the fit's bounds are."""
    low, high = quantity.distribution.support
    spread = _WITHIN * deviation
    numbers = {
        "mean": value, "deviation": deviation,
        "least": max(low, value - spread), "most": min(high, value + spread),
    }  # fmt: skip
    of: Any = True if quantity.owner == "computing" else quantity.of
    distribution = {key: _written(number, quantity.unit) for key, number in numbers.items()}
    return {
        quantity.owner: of,
        "name": quantity.name,
        quantity.quantity: {"distribution": "normal", **distribution},
        "nominal": _written(value, quantity.unit),
    }
