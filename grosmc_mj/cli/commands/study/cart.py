"""grosmc-mj study cart."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from grosmc_mj.experiments.metrics import Metric
    from grosmc_mj.studies.cart.measure import Study

# Header, measure and factor of each column of numbers.
_COLUMNS = (
    ("angle\nsettled [s]", "angle_settling", 1.0),
    ("cart\nsettled [s]", "cart_settling", 1.0),
    ("travel\n[m]", "travel", 1.0),
    ("max |u|\n[N]", "max_input", 1.0),
    ("max|θ-θ*|\n% of start", "deviation", 1.0),
    ("var. of u\n[N/s]", "total_variation", 1.0),
    ("|p| under\nd(t) [mm]", "cart_disturbed", 1e3),
    ("|θ| under\nd(t) [mrad]", "angle_disturbed", 1e3),
)


@dataclass(frozen=True)
class CartCommand(Command):
    """Hold the pole and the cart: what the chapter's law leaves out, and what it costs.

    The cart-pendulum runs in MuJoCo for 20 or 30 s in each case under the chapter's law, which
    lets the cart go, and under three that hold both: LQR of all four states, the same with section
    2's integral sliding mode, and section 3's linearization with an outer loop on the cart. With
    four states the pole's length is not matched: a second table says what each choice of G makes of
    that, a third how much of each uncertainty the input can reach. Writes cart.json, cart.png and
    cart.svg to --out.

    Attributes:
        switching: Switching law of the sliding mode laws, as for validate.
        surface: printed or discrete, as for validate.
        out: Folder for cart.json and the figure.
    """

    switching: Annotated[str, arg(metavar="NAME")] = "implicit"
    surface: Annotated[str, arg(metavar="printed|discrete")] = "discrete"
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")

    def execute(self) -> int:
        """Run, write, print, draw."""
        from grosmc_mj.experiments.runs import Settings
        from grosmc_mj.files import cannot_write
        from grosmc_mj.report.document import write_json
        from grosmc_mj.studies.cart.figure import write_holding_figure
        from grosmc_mj.studies.cart.measure import CART_BAND, document, steps, study

        settings = Settings(
            switching=self.switching,
            surface=self.surface,  # pyright: ignore[reportArgumentType]  checked by Settings
        )
        target = self.out / "cart.json"
        try:
            self.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise cannot_write(target, error) from error
        with screen.progress(steps()) as advance:
            found = study(settings, advance)
        write_json(target, document(found))
        console = screen.console()
        _answer(console, found, full=self.verbose)
        console.print(
            f"settled: for good within 2 % of the start angle and within {100 * CART_BAND:g} cm, "
            "up to the onset of d(t); under d(t): in the second half of its time. (!): beyond the "
            f"rail of ±{found.rail:g} m. θ*: nominal optimum of each law. r: input gain on s, true "
            "over nominal.",
            style="dim",
        )
        wide = screen.wide_console()
        for table in (_runs(found), _projections(found), _parts(found)) if self.verbose else ():
            wide.print(table)
            wide.print()
        screen.say_files(console, target, write_holding_figure(found, self.out))
        return screen.DONE


def _answer(console: Console, found: Study, *, full: bool) -> None:
    """Who brings the cart to rest, and what that takes."""
    # Every law, and the cases in which it leaves the cart or the rail.
    moving: dict[str, list[str]] = {}
    rows = []
    for result, measures in found.held:
        law, case = result.controller.name, result.case.name
        if measures["cart_settling"].value is None:
            moving.setdefault(law, []).append(case)
        margin = measures["rail_margin"].value
        off = " (!)" if margin is not None and margin < 0 else ""
        cells = [_cell(measures[name], factor) for _, name, factor in _COLUMNS[:5]]
        cells[2] += off
        rows.append((case, law + (" (!)" if result.ended else ""), *cells))
    words = [f"{law} in {', '.join(cases)}" for law, cases in moving.items()]
    screen.say_verdict(
        console,
        f"Does not bring the cart to rest: {'; '.join(words)}."
        if words
        else "Every law brings the cart to rest.",
        good=not words,
    )
    endings = [
        f"{each.result.key}: {each.result.ended}" for each in found.held if each.result.ended
    ]
    screen.say_lines(console, endings, all=full)
    columns = (
        "case", "law", "angle settled [s]", "cart settled [s]", "travel [m]", "max|u| [N]",
        "max|θ-θ*| [%]",
    )  # fmt: skip
    console.print(screen.brief_table("", columns, rows, words=2))
    unmatched = max(found.projections, key=lambda row: row.amplification or 0)
    console.print(
        f"G in case1: {unmatched.name} amplifies what is unmatched most, "
        f"{unmatched.amplification or 0:.3f} times; G = B+ not at all."
    )


def _runs(found: Study) -> Table:
    """Every law in every case."""
    from rich.markup import escape

    from grosmc_mj.report.tables import empty_table

    table = empty_table(
        f"Cart-pendulum in MuJoCo from -10 degrees: {found.settings.switching} switching, "
        f"{found.settings.surface} surface"
    )
    for header in ("case", "law"):
        table.add_column(header, no_wrap=True)
    for header, _, _ in _COLUMNS:
        table.add_column(escape(header), justify="right", no_wrap=True)
    shown = ""
    for result, measures in found.held:
        if shown and shown != result.case.name:
            table.add_section()
        label = "" if shown == result.case.name else result.case.name
        shown = result.case.name
        cells = [_cell(measures[name], factor) for _, name, factor in _COLUMNS]
        margin = measures["rail_margin"].value
        if margin is not None and margin < 0:
            cells[2] += " (!)"
        law = result.controller.name + (" (!)" if result.ended else "")
        table.add_row(label, law, *cells, style="red" if result.ended else "")
    return table


def _projections(found: Study) -> Table:
    """Every G."""
    from rich.markup import escape

    from grosmc_mj.report.tables import empty_table, number

    table = empty_table("case1: what the unmatched uncertainty costs with each G")
    table.add_column("surface", no_wrap=True)
    for header in (
        "amplification of\nwhat is unmatched", "r =\nG B_t/G B", "slowest pole\non s = 0 [1/s]",
        "max|θ-θ*|\n% of start", "max |u|\n[N]",
    ):  # fmt: skip
        table.add_column(escape(header), justify="right", no_wrap=True)
    for row in found.projections:
        table.add_row(
            row.name if row.G is None else escape(f"G = {row.name}"),
            "-" if row.amplification is None else f"{row.amplification:.3f}",
            "-" if row.gain_ratio is None else f"{row.gain_ratio:.3f}",
            number(row.pole),
            _cell(row.deviation),
            _cell(row.max_input),
        )
    return table


def _parts(found: Study) -> Table:
    """What the input reaches of each uncertainty."""
    from rich.markup import escape

    from grosmc_mj.report.tables import empty_table

    table = empty_table("Norms of what is added to A - B K")
    table.add_column("uncertainty of the pole", no_wrap=True)
    for header in ("matched", "unmatched"):
        table.add_column(escape(header), justify="right", no_wrap=True)
    for row in found.parts:
        # What is left of zero is rounding of MuJoCo's differences.
        table.add_row(row.name, f"{row.matched:.3f}", f"{row.unmatched:.3f}")
    return table


def _cell(metric: Metric, factor: float = 1.0) -> str:
    """A measure in a table."""
    from grosmc_mj.report.tables import number

    if metric.value is None:
        return "never" if metric.note == "not reached" else "-"
    return number(factor * metric.value)
