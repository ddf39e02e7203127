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

    from grosmc_mj.studies.cart.measure import Study

# Of the columns of all tables, those of the answer.
_BRIEF = 5


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
        from grosmc_mj.studies.cart.measure import steps, study
        from grosmc_mj.studies.cart.report import cart_document, cart_tables, legend

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
        write_json(target, cart_document(found))
        console = screen.console()
        _answer(console, found, full=self.verbose)
        console.print(legend(found), style="dim")
        wide = screen.wide_console()
        for table in cart_tables(found) if self.verbose else ():
            wide.print(table)
            wide.print()
        screen.say_files(console, target, write_holding_figure(found, self.out))
        return screen.DONE


def _answer(console: Console, found: Study, *, full: bool) -> None:
    """Who brings the cart to rest, and what that takes."""
    from grosmc_mj.studies.cart.report import COLUMNS, run_cells

    # The laws that never bring the cart to rest, and in which cases.
    moving: dict[str, list[str]] = {}
    for result, measures in found.held:
        if measures["cart_settling"].value is None:
            moving.setdefault(result.controller.name, []).append(result.case.name)
    rows = [run_cells(each, COLUMNS[:_BRIEF]) for each in found.held]
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
