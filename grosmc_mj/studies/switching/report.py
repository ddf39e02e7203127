"""Accuracy and chattering of the switching laws, as a document and as tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from grosmc_mj.results.document import origin
from grosmc_mj.results.tables import Table, number, numbers, table, words
from grosmc_mj.studies.switching.measure import (
    OWN_VARIATION,
    TIMESTEP,
    Benchmark,
    CaseRow,
    orders,
)

# The sample time of the tables; the figure and the file have them all.
SHOWN = 1e-3
_RATIOS = (0.3, 0.5, 1.0, 1.3, 1.4, 1.9, 2.1)


def switching_document(
    by_time: Sequence[Benchmark], by_ratio: Sequence[Benchmark], cases: Sequence[CaseRow]
) -> dict[str, Any]:
    """The content of switching.json; what diverged has null for its numbers."""
    return {
        **origin(None),
        "configuration": {
            "timestep": {"value": TIMESTEP, "unit": "s"},
            "slopes": {row.run.system: row.run.experiment.slope for row in cases},
        },
        "benchmark": {
            "equation": "s' = r phi + 0.5 sin(2 pi t), rho = 1, phi held",
            "own_total_variation": {"value": OWN_VARIATION, "unit": "1/s"},
            "orders": orders(by_time),
            "sample_times": [row._asdict() for row in by_time],
            "gain_ratios": [row._asdict() for row in by_ratio],
        },
        "cases": [_case(row) for row in cases],
    }


def _case(row: CaseRow) -> dict[str, Any]:
    """What was run, and what was measured."""
    run, measured = row.run, {k: v for k, v in row._asdict().items() if k != "run"}
    names = ("system", "case", "law", "surface", "control_period")
    return {**{name: getattr(run, name) for name in names}, **measured}


def switching_tables(
    by_time: Sequence[Benchmark], by_ratio: Sequence[Benchmark], cases: Sequence[CaseRow]
) -> list[Table]:
    """The scalar benchmark, what a wrong input gain does, and the cases of each system."""
    systems = dict.fromkeys(row.run.system for row in cases)
    return [
        _benchmark_table(by_time),
        _limits_table(by_ratio),
        *(_cases_table([row for row in cases if row.run.system == each]) for each in systems),
    ]


def is_shown(period: float) -> bool:
    """Whether the tables show this sample time."""
    return math.isclose(period, SHOWN)


def _benchmark_table(rows: Sequence[Benchmark]) -> Table:
    """The scalar benchmark with the nominal input gain."""
    found = orders(rows)
    return table(
        "Scalar s' = u + 0.5 sin 2πt",
        [
            *words("law"),
            *numbers(
                "order of\nmax|s|", "max|s|", "RMS s", "zeros\nper s", "variation of u\nover w's"
            ),
        ],
        [
            (
                row.law,
                f"{found[row.law]:.2f}",
                *map(number, (row.max_sliding, row.rms_sliding, row.crossings)),
                number(row.total_variation / OWN_VARIATION),
            )
            for row in rows
            if is_shown(row.h)
        ],
    )


def _limits_table(rows: Sequence[Benchmark]) -> Table:
    """What a wrong input gain does."""
    cells = []
    for law in dict.fromkeys(row.law for row in rows):
        found = {round(row.gain_ratio, 6): row.max_sliding for row in rows if row.law == law}
        values = (found[ratio] for ratio in _RATIOS)
        cells.append((law, *(number(x) if math.isfinite(x) else "diverges" for x in values)))
    return table(
        "Scalar s' = r u + 0.5 sin 2πt, true over nominal input gain r: max|s|",
        [*words("law"), *numbers(*(f"r = {ratio:g}" for ratio in _RATIOS))],
        cells,
    )


def _cases_table(rows: Sequence[CaseRow]) -> Table:
    """The cases of one system."""
    system = rows[0].run.experiment.nominal.system
    output, u = system.positions[system.output].unit, system.input.unit
    return table(
        f"{system.title}, in MuJoCo",
        [
            *words("case", "law", "surface"),
            *numbers(
                f"max|x1-x1*|\n[{output}]", "max|s|", "RMS s", "zeros\nper s",
                f"variation of u\n[{u}/s]", "J of u_c\nover J*", "u_d costs\nper s, over J*",
            ),
        ],
        [
            (
                row.run.case, row.run.law, row.run.surface,
                number(row.deviation), number(row.max_sliding), number(row.rms_sliding),
                number(row.crossings), number(row.total_variation),
                f"{row.cost_continuous:.4g}", number(row.cost_rate),
            )
            for row in rows
            if is_shown(row.run.control_period)
        ],
        grouped=True,
    )  # fmt: skip
