"""What the comparison of equations and MuJoCo found, as a document and a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table

from grosmc_mj.report.document import origin
from grosmc_mj.report.tables import empty_table
from grosmc_mj.studies.agreement.measure import AGREEMENT_BOUND, Agreement


def agreement_table(rows: Sequence[Agreement]) -> Table:
    """Analytic plants against MuJoCo."""
    table = empty_table()
    for header in ("system", "equations", "model"):
        table.add_column(header, no_wrap=True)
    for header in ("acceleration difference\nover largest term", "trajectory difference\n[m, rad]"):
        table.add_column(escape(header), justify="right", no_wrap=True)
    for row in rows:
        numbers = (f"{row.acceleration:.1e}", f"{row.trajectory:.1e}")
        table.add_row(row.system, row.variant, row.edit, *numbers)
    return table


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
