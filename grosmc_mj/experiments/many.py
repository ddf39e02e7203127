"""Runs of many experiments as one table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Annotated, Any

from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.file.paths import place_of
from grosmc_mj.experiments.number import Number
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.ground.errors import ArgumentError, GrosmcError
from grosmc_mj.ground.fields import Items, checked_call


@checked_call
def run_many(
    experiments: Annotated[Sequence[Experiment], Items(Experiment, "a list of Experiments")],
    *,
    law: str | Sequence[str] | None = None,
    plant: PlantName | None = None,
) -> Any:
    """Run experiments, and return a row for each run.

    Args:
        experiments: The experiments, such as ``[experiment.changed({"laws.grosmc.k": k}) ...]``.
        law: A law or several; by default all laws of each experiment.
        plant: The plant; by default physics or, where there is none, the equations.

    Returns:
        A ``pyarrow.Table``, for pandas ``.to_pandas()``. It has the columns ``experiment`` (the
        number in the list), one for each path that ``changed`` has been given, ``case``, ``plant``,
        ``law``, ``status``, ``kept``, one for each metric and, for each requirement, its margin,
        ``margin WORDS``. The metadata of a field have its ``unit``. A run without a value has null.

    Raises:
        ArgumentError: If there is none, or one of the list is no experiment.
        GrosmcError: If there is no such law or plant, or a user's own law fails.
    """
    rows: list[dict[str, Any]] = []
    units: dict[str, str] = {}
    varied = list(dict.fromkeys(path for case in experiments for path in case.varied))
    for number, experiment in enumerate(experiments):
        numbers = {path: _number(experiment, path, units) for path in varied}
        laws = [law] if isinstance(law, str) else law
        for name in laws or experiment.controllers:
            run = experiment.run(plant, name)
            rows.append({"experiment": number, **numbers, **_row(run, units)})
    if not rows:
        raise ArgumentError("experiments: there is none: give a list of experiments")
    return _table(rows, units)


def _table(rows: Sequence[Mapping[str, Any]], units: Mapping[str, str]) -> Any:
    """Return rows as a table; a column has the same type whatever the runs came to."""
    import pyarrow as pa

    types = {"experiment": pa.int64(), "kept": pa.bool_()}
    types |= dict.fromkeys(("case", "plant", "law", "status"), pa.string())
    names = dict.fromkeys(key for row in rows for key in row)
    arrays = []
    fields = []
    for name in names:
        values = [row.get(name) for row in rows]
        kind = types.get(name, pa.float64())
        if name not in types and any(isinstance(value, str) for value in values):
            kind = pa.string()
            values = [None if value is None else str(value) for value in values]
        arrays.append(pa.array(values, kind))
        fields.append(pa.field(name, kind, metadata={"unit": units.get(name, "")}))
    return pa.table(arrays, schema=pa.schema(fields))


def _number(experiment: Experiment, path: str, units: dict[str, str]) -> float | str | None:
    """Return the value at a path in the unit of its key, and note the unit; texts as they are."""
    try:
        number = Number.of(experiment, path)
    except GrosmcError:
        return _text(experiment, path)
    units[path] = number.unit
    return number.get(experiment)


def _text(experiment: Experiment, path: str) -> str | None:
    """Return what the file has at a path that is no number; None if it has nothing there."""
    content = deepcopy(experiment.file.content)
    value: Any = place_of(content, path).table(content)
    for key in place_of(content, path).keys:
        if not isinstance(value, dict) or key not in value:
            return None
        value = value[key]
    return str(value)


def _row(run: RunResult, units: dict[str, str]) -> dict[str, Any]:
    """Return the values of a run by column, and note the units of the columns."""
    judgements = run.requirements
    row: dict[str, Any] = {
        "case": run.case.target,
        "plant": run.plant,
        "law": run.controller.name,
        "status": run.status.name.lower(),
        "kept": run.kept,
    }
    for name, metric in run.metrics.items():
        row[name] = metric.value
        units[name] = metric.unit
    for judgement in judgements:
        name = f"margin {judgement.requirement.words}"
        row[name] = judgement.margin
        units[name] = judgement.requirement.unit
    return row
