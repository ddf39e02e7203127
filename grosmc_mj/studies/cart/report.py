"""What holding the cart costs, as a document and as tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from rich.table import Table

from grosmc_mj.experiments.document import case_document
from grosmc_mj.experiments.tables import metric_cell
from grosmc_mj.report.document import origin
from grosmc_mj.report.tables import number, numbers, table, words
from grosmc_mj.studies.cart.measure import CART_BAND, HORIZONS, Held, Study, holding_case

# Header, measure and factor of each column of numbers.
COLUMNS = (
    ("angle\nsettled [s]", "angle_settling", 1.0),
    ("cart\nsettled [s]", "cart_settling", 1.0),
    ("travel\n[m]", "travel", 1.0),
    ("max |u|\n[N]", "max_input", 1.0),
    ("max|θ-θ*|\n% of start", "deviation", 1.0),
    ("var. of u\n[N/s]", "total_variation", 1.0),
    ("|p| under\nd(t) [mm]", "cart_disturbed", 1e3),
    ("|θ| under\nd(t) [mrad]", "angle_disturbed", 1e3),
)


def cart_document(found: Study) -> dict[str, Any]:
    """The content of cart.json."""
    return {
        **origin(None),
        "configuration": {
            **asdict(found.settings),
            "cases": [case_document(holding_case(name).case) for name in HORIZONS],
            "rail_half_length": {"value": found.rail, "unit": "m"},
            "cart_band": {"value": CART_BAND, "unit": "m"},
        },
        "runs": [
            {
                "case": each.result.case.name,
                "plant": each.result.plant,
                "controller": each.result.controller.name,
                "equations": each.result.controller.designed.source,
                "gains": dict(each.result.controller.designed.gains),
                "declared": each.result.controller.designed.declared,
                "status": each.result.status.name.lower(),
                "ended": each.result.ended,
                "measures": {name: metric._asdict() for name, metric in each.measures.items()},
            }
            for each in found.held
        ],
        "projections": [
            {
                "name": row.name,
                "G": None if row.G is None else row.G[0].tolist(),
                "amplification": row.amplification,
                "gain_ratio": row.gain_ratio,
                "pole": {"value": row.pole, "unit": "1/s"},
                "deviation": row.deviation._asdict(),
                "max_input": row.max_input._asdict(),
            }
            for row in found.projections
        ],
        "uncertainties": [row._asdict() for row in found.parts],
    }


def cart_tables(found: Study) -> list[Table]:
    """Every law in every case, every G, and what the input reaches of each uncertainty."""
    return [_runs(found), _projections(found), _parts(found)]


def legend(found: Study) -> str:
    """What the words of the tables mean."""
    return (
        f"settled: for good within 2 % of the start angle and within {100 * CART_BAND:g} cm, up to "
        "the onset of d(t); under d(t): in the second half of its time. (!): beyond the rail of "
        f"±{found.rail:g} m. θ*: nominal optimum of each law. r: input gain on s, true over "
        "nominal."
    )


def run_cells(held: Held, columns: Sequence[tuple[str, str, float]] = COLUMNS) -> tuple[str, ...]:
    """A run's row: its case, its law, and so many of the columns; (!) is what went wrong."""
    result, measures = held
    cells = {name: metric_cell(measures[name], factor) for _, name, factor in columns}
    margin = measures["rail_margin"].value
    if margin is not None and margin < 0:
        cells["travel"] += " (!)"
    law = result.controller.name + (" (!)" if result.ended else "")
    return (result.case.name, law, *cells.values())


def _runs(found: Study) -> Table:
    """Every law in every case."""
    return table(
        f"Cart-pendulum in MuJoCo from -10 degrees: {found.settings.switching} switching, "
        f"{found.settings.surface} surface",
        [*words("case", "law"), *numbers(*(header for header, _, _ in COLUMNS))],
        [run_cells(each) for each in found.held],
        styles=["red" if each.result.ended else "" for each in found.held],
        grouped=True,
    )


def _projections(found: Study) -> Table:
    """Every G."""
    return table(
        "case1: what the unmatched uncertainty costs with each G",
        [
            *words("surface"),
            *numbers(
                "amplification of\nwhat is unmatched", "r =\nG B_t/G B",
                "slowest pole\non s = 0 [1/s]", "max|θ-θ*|\n% of start", "max |u|\n[N]",
            ),
        ],
        [
            (
                row.name if row.G is None else f"G = {row.name}",
                "-" if row.amplification is None else f"{row.amplification:.3f}",
                "-" if row.gain_ratio is None else f"{row.gain_ratio:.3f}",
                number(row.pole),
                metric_cell(row.deviation),
                metric_cell(row.max_input),
            )
            for row in found.projections
        ],
    )  # fmt: skip


def _parts(found: Study) -> Table:
    """What the input reaches of each uncertainty."""
    return table(
        "Norms of what is added to A - B K",
        [*words("uncertainty of the pole"), *numbers("matched", "unmatched")],
        # What is left of zero is rounding of MuJoCo's differences.
        [(row.name, f"{row.matched:.3f}", f"{row.unmatched:.3f}") for row in found.parts],
    )
