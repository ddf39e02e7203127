"""The result of an identification: its document, tables and figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.identify.fit import Fit, Quality
from grosmc_mj.identify.log import Log
from grosmc_mj.plants import System
from grosmc_mj.results.figure import figure_written
from grosmc_mj.results.palette import BLUE, VERMILION
from grosmc_mj.results.result import MEASURED, OPEN, Answer, Sheet, Value, result
from grosmc_mj.results.tables import Table, names, number, numbers, table, text, words

# A value this near to an end of its range, as a share of that, is at the end.
_NEAR = 1e-3


def values_table(fit: Fit) -> Table:
    """The parameters with their intervals."""
    rows = []
    for quantity, value, half in fit.estimates:
        support = quantity.distribution.support
        at_end = np.abs(np.array(support) - value).min() < _NEAR * np.ptp(support)
        note = "at the end of its range: widen it, or check the log" if at_end else ""
        interval = "-" if half is None else f"{value - half:.4g} to {value + half:.4g}"
        if half is None:
            note = "held: not visible in this log"
        nominal = f"{quantity.nominal:.4g}"
        rows.append((quantity.name, f"{value:.4g}", interval, quantity.unit, nominal, note))
    return table(
        "Parameters",
        [*names("parameter"), *numbers("value", "95 % interval"), *words("unit"),
         *numbers("in the case"), *text()],
        rows,
    )  # fmt: skip


def quality_table(rows: Sequence[Quality]) -> Table:
    """How well the held-out part is predicted."""
    cells = [
        (row.state, f"{number(row.rms)} {row.unit}", number(100 * row.fit),
         number(row.steps), "white" if row.white else "correlated in time")
        for row in rows
    ]  # fmt: skip
    return table(
        "Prediction of the held-out part",
        [*names("state"), *numbers("RMS", "fit %", "RMS in steps"), *words("residual")],
        cells,
        legend="Fit: 1 - |residual| / |deviation from the mean|. In steps of the sensor, or in "
        "standard deviations of its noise. A residual that is correlated in time means that the "
        "model lacks something, and that the intervals are too narrow.",
    )


def identification(
    fit: Fit, rows: Sequence[Quality], log: str, horizon: float, hold_out: float
) -> dict[str, Any]:
    """The content of the result's JSON file."""
    experiment, white = fit.parameters.experiment, all(row.white for row in rows)
    least = min(rows, key=lambda row: row.fit)
    words = f"{int(fit.fitted.sum())} of {len(fit.fitted)} parameters fitted; "
    words += f"{least.state} of the held-out part predicted to {100 * least.fit:.3g} %"
    values = [
        {"name": quantity.name, "value": value, "unit": quantity.unit,
         "in_the_case": quantity.nominal, "half_width": half}
        for quantity, value, half in fit.estimates
    ]  # fmt: skip
    return result(
        "identify",
        {"case": str(experiment.path), "log": log, "horizon": horizon, "hold_out": hold_out},
        answers=[
            Answer(
                question=f"Parameters of {experiment.path.stem} from {log}",
                verdict=MEASURED if white else OPEN,
                words=words,
                more="; ".join(row.words for row in fit.unseen),
            )
        ],
        sheets=[Sheet(table=values_table(fit)), Sheet(table=quality_table(rows))],
        values=[
            Value(name=f"{log}: {row['name']}", value=row["value"], unit=row["unit"],
                  relative=1e-3)
            for row in values
        ],
        parameters=values,
        covariance=fit.covariance.tolist(),
        unseen=[row._asdict() for row in fit.unseen],
        held_out=[row._asdict() for row in rows],
    )  # fmt: skip


def draw(
    parts: Mapping[str, Sequence[tuple[slice, Array]]], log: Log, system: System, path: Path
) -> None:
    """Draw measured and fitted states of a log, and their difference, by ``fit.residuals``."""
    units = {state.name: state.unit for state in system.states}
    size = 9.0, 2.2 * 2 * len(parts) + 0.6
    with figure_written(path, size, [".png"]) as figure:
        axes = figure.subplots(2 * len(parts), 1, sharex=True)
        for row, (name, pieces) in enumerate(parts.items()):
            above, below = axes[2 * row], axes[2 * row + 1]
            for index, (samples, error) in enumerate(pieces):
                time, measured = log.time[samples], log.outputs[name][samples]
                label = ("measured", "fitted", "residual") if index == 0 else (None, None, None)
                above.plot(time, measured, color="#888888", lw=2.4, alpha=0.6, label=label[0])
                above.plot(time, measured - error, color=BLUE, lw=1.0, label=label[1])
                below.plot(time, error, color=VERMILION, lw=0.8, label=label[2])
            above.set_ylabel(f"{name} [{units[name]}]")
            below.set_ylabel(f"residual [{units[name]}]")
            above.legend(loc="upper right")
        axes[-1].set_xlabel("time [s]")
