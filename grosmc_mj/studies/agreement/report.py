"""What the comparison of equations and MuJoCo found, as a document and a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.table import Table

from grosmc_mj.report.document import origin
from grosmc_mj.report.tables import numbers, table, words
from grosmc_mj.studies.agreement.measure import AGREEMENT_BOUND, Agreement


def agreement_table(rows: Sequence[Agreement]) -> Table:
    """Analytic plants against MuJoCo."""
    return table(
        "",
        [
            *words("system", "equations", "model"),
            *numbers(
                "acceleration difference\nover largest term", "trajectory difference\n[m, rad]"
            ),
        ],
        [
            (row.system, row.variant, row.edit, f"{row.acceleration:.1e}", f"{row.trajectory:.1e}")
            for row in rows
        ],
    )


def comparison_document(
    agreements: Sequence[Agreement], found: Sequence[str], seed: int
) -> dict[str, Any]:
    """The content of agreement_SYSTEM.json: the comparisons, and which are beyond the bound."""
    return {
        **origin(seed),
        "bound": AGREEMENT_BOUND,
        "disagreements": list(found),
        "agreement": [agreement._asdict() for agreement in agreements],
    }
