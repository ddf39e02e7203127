"""Runs of many experiments as one table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.ground.errors import ArgumentError
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
        number in the list), ``case``, ``plant``, ``law``, ``status``, ``kept``, a column for each
        metric and, for each requirement, its margin, ``margin WORDS``. The metadata of a field have
        its ``unit``. A run without a value has null.

    Raises:
        ArgumentError: If there is none, or one of the list is no experiment.
        GrosmcError: If there is no such law or plant, or a user's own law fails.
    """
    import pyarrow as pa

    rows: list[dict[str, Any]] = []
    units: dict[str, str] = {}
    for number, experiment in enumerate(experiments):
        laws = [law] if isinstance(law, str) else law
        for name in laws or experiment.controllers:
            run = experiment.run(plant, name)
            rows.append({"experiment": number, **_row(run, units)})
    if not rows:
        raise ArgumentError("experiments: there is none: give a list of experiments")

    names = dict.fromkeys(key for row in rows for key in row)
    columns = {name: [row.get(name) for row in rows] for name in names}
    table = pa.table(columns)
    fields = [field.with_metadata({"unit": units.get(field.name, "")}) for field in table.schema]
    return table.cast(pa.schema(fields))


def _row(run: RunResult, units: dict[str, str]) -> dict[str, Any]:
    """Return the values of a run by column, and note the units of the columns."""
    judgements = run.requirements
    row: dict[str, Any] = {
        "case": run.case.target,
        "plant": run.plant,
        "law": run.controller.name,
        "status": run.status.name.lower(),
        "kept": all(judgement.kept for judgement in judgements) if judgements else None,
    }
    for name, metric in run.metrics.items():
        row[name] = metric.value
        units[name] = metric.unit
    for judgement in judgements:
        name = f"margin {judgement.requirement.words}"
        row[name] = judgement.margin
        units[name] = judgement.requirement.unit
    return row
