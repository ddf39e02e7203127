"""grosmc-mj study switching."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.targets import TARGET

if TYPE_CHECKING:
    from rich.console import Console

    from grosmc_mj.studies.switching.measure import Benchmark, CaseRow


@dataclass(frozen=True)
class SwitchingCommand(Command):
    """Measure accuracy and chattering of six switching laws against sample time.

    On a scalar with a sine disturbance, whose input gain is right or wrong by a factor, and on the
    chapter's cases in MuJoCo under GROSMC, or on a case of your own, with the printed and with the
    discrete-time surface: largest |s|, distance from the optimal trajectory, zero crossings, total
    variation of the input, J of its continuous part over J* and what the rest costs a second.
    switching.json and the figure,
    switching.png and switching.svg, go to --out.

    Attributes:
        target: servo, cart_pendulum or arm for the chapter's cases of it, one case, or a case file
            with one input and a law that switches.
        out: Folder for switching.json and the figure.
    """

    target: Annotated[
        Positional[str | None],
        arg(metavar=f"[{TARGET}]", name="target", help_behavior_hint="(default: the chapter's)"),
    ] = None
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")

    def execute(self) -> int:
        """Measure, write, print, draw."""
        from grosmc_mj.results.document import write_json
        from grosmc_mj.studies.switching import measure as chattering
        from grosmc_mj.studies.switching.figure import write_chattering_figure
        from grosmc_mj.studies.switching.report import SHOWN, switching_document, switching_tables

        planned = chattering.experiments(chattering.cases_of(self.target))
        swept = len(chattering.LAWS) * (len(chattering.SAMPLE_TIMES) + len(chattering.GAIN_RATIOS))
        by_time: list[Benchmark] = []
        by_ratio: list[Benchmark] = []
        cases: list[CaseRow] = []
        with screen.progress(swept + len(planned), "runs") as advance:
            for row in chattering.sample_time_sweep():
                by_time.append(row)
                advance(f"scalar/{row.law} {row.h:g} s")
            for row in chattering.gain_ratio_sweep():
                by_ratio.append(row)
                advance(f"scalar/{row.law} r = {row.gain_ratio:g}")
            for run in planned:
                cases.append(chattering.measure_case(run))
                advance(run.key)
        target = self.out / "switching.json"
        write_json(target, switching_document(by_time, by_ratio, cases))
        console = screen.console()
        _answer(console, by_time, by_ratio, cases, full=self.verbose)
        wide = screen.wide_console()
        for table in switching_tables(by_time, by_ratio, cases) if self.verbose else ():
            wide.print(table)
            wide.print()
        figure = write_chattering_figure(by_time, by_ratio, cases, self.out)
        console.print(f"Tables at {1e3 * SHOWN:g} ms; the files have every sample time.")
        screen.say_files(console, target, figure)
        return screen.DONE


def _answer(
    console: Console,
    by_time: Sequence[Benchmark],
    by_ratio: Sequence[Benchmark],
    cases: Sequence[CaseRow],
    *,
    full: bool,
) -> None:
    """How accurate each law is and how much it chatters, the worst first."""
    from grosmc_mj.results.tables import number
    from grosmc_mj.studies.switching.measure import OWN_VARIATION, orders
    from grosmc_mj.studies.switching.report import is_shown

    endings = [f"{row.run.key}: {row.ended}" for row in cases if row.ended]
    words = f"All {len(cases)} runs in MuJoCo completed."
    if endings:
        words = f"{len(endings)} of {len(cases)} runs in MuJoCo ended early."
    screen.say_verdict(console, words, good=not endings)
    screen.say_lines(console, endings, all=full)
    found = orders(by_time)
    shown = [row for row in by_time if is_shown(row.h)]
    rows = []
    for row in sorted(shown, key=lambda row: -row.total_variation):
        diverging = [
            each.gain_ratio
            for each in by_ratio
            if each.law == row.law and not math.isfinite(each.max_sliding)
        ]
        own = [
            each for each in cases if each.run.law == row.law and is_shown(each.run.control_period)
        ]
        worst = max(own, key=lambda each: each.cost_rate)
        rows.append(
            (
                row.law,
                number(row.max_sliding),
                f"{found[row.law]:.2f}",
                number(row.total_variation / OWN_VARIATION),
                f"{min(diverging):.2f}" if diverging else "-",
                number(worst.cost_rate),
                f"{worst.run.system}/{worst.run.case}",
            )
        )
    columns = (
        "law", "max|s|", "order", "variation u / w", "diverges from r", "u_d per s / J*", "in",
    )  # fmt: skip
    title = "Scalar s' = r u + 0.5 sin 2πt, and the cases in MuJoCo; the most chatter first"
    console.print(screen.brief_table(title, columns, rows))
