"""grosmc-mj study switching."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.targets import CASES, system_cases
from grosmc_mj.errors import ArgumentError, unknown_name

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from grosmc_mj.studies.switching.measure import Benchmark, CaseRow, SwitchingRun

# The sample time of the tables; the figure and the file have them all.
_SHOWN = 1e-3


@dataclass(frozen=True)
class SwitchingCommand(Command):
    """Measure accuracy and chattering of six switching laws against sample time.

    On a scalar with a sine disturbance, whose input gain is right or wrong by a factor, and on the
    chapter's cases in MuJoCo under GROSMC, with the printed and with the discrete-time surface:
    largest |s|, distance from the optimal trajectory, zero crossings, total variation of the
    input, J of the whole input over J*. switching.json and the figure, switching.png and
    switching.svg, go to --out.

    Attributes:
        target: servo, cart_pendulum or arm, or one of their cases that the study has.
        out: Folder for switching.json and the figure.
    """

    target: Annotated[
        Positional[str | None],
        arg(metavar=f"[{CASES}]", name="target", help_behavior_hint="(default: all of them)"),
    ] = None
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")

    def execute(self) -> int:
        """Measure, write, print, draw."""
        from grosmc_mj.report.document import write_json
        from grosmc_mj.studies.switching import measure as chattering
        from grosmc_mj.studies.switching.figure import write_chattering_figure

        planned = self._planned()
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
            for experiment in planned:
                cases.append(chattering.measure_case(experiment))
                advance(experiment.key)
        target = self.out / "switching.json"
        write_json(target, document(by_time, by_ratio, cases))
        console = screen.console()
        _answer(console, by_time, by_ratio, cases, full=self.verbose)
        if self.verbose:
            wide = screen.wide_console()
            wide.print(_benchmark_table(by_time))
            wide.print()
            wide.print(_limits_table(by_ratio))
            for system in dict.fromkeys(row.experiment.system for row in cases):
                wide.print()
                wide.print(_cases_table([row for row in cases if row.experiment.system == system]))
        figure = write_chattering_figure(by_time, by_ratio, cases, self.out)
        console.print(f"Tables at {1e3 * _SHOWN:g} ms; the files have every sample time.")
        screen.say_files(console, target, figure)
        return screen.DONE

    def _planned(self) -> list[SwitchingRun]:
        """The runs that are asked for."""
        from grosmc_mj.studies.switching import measure as chattering

        if self.target is None:
            return chattering.experiments()
        found = system_cases(self.target, "study switching")
        planned = chattering.experiments(found[0].system)
        names = [case.name for case in found]
        chosen = [each for each in planned if each.case in names]
        if not chosen:
            valid = chattering.CASES[found[0].system]
            raise ArgumentError(
                unknown_name(f"case of {found[0].system} in this study", names[0], valid)
            )
        return chosen


def _answer(
    console: Console,
    by_time: Sequence[Benchmark],
    by_ratio: Sequence[Benchmark],
    cases: Sequence[CaseRow],
    *,
    full: bool,
) -> None:
    """How accurate each law is and how much it chatters, the worst first."""
    from grosmc_mj.report.tables import number
    from grosmc_mj.studies.switching.measure import OWN_VARIATION, orders

    endings = [f"{row.experiment.key}: {row.ended}" for row in cases if row.ended]
    words = f"All {len(cases)} runs in MuJoCo completed."
    if endings:
        words = f"{len(endings)} of {len(cases)} runs in MuJoCo ended early."
    screen.say_verdict(console, words, good=not endings)
    screen.say_lines(console, endings, all=full)
    found = orders(by_time)
    shown = [row for row in by_time if _shown(row.h)]
    rows = []
    for row in sorted(shown, key=lambda row: -row.total_variation):
        diverging = [
            each.gain_ratio
            for each in by_ratio
            if each.law == row.law and not math.isfinite(each.max_sliding)
        ]
        own = [
            each
            for each in cases
            if each.experiment.law == row.law and _shown(each.experiment.control_period)
        ]
        worst = max(own, key=lambda each: each.cost_ratio)
        rows.append(
            (
                row.law,
                number(row.max_sliding),
                f"{found[row.law]:.2f}",
                number(row.total_variation / OWN_VARIATION),
                f"{min(diverging):.2f}" if diverging else "-",
                f"{worst.cost_ratio:.4g}",
                f"{worst.experiment.system}/{worst.experiment.case}",
            )
        )
    columns = (
        "law", "max|s|", "order", "variation u / w", "diverges from r", "J / J*, worst", "in",
    )  # fmt: skip
    title = "Scalar s' = r u + 0.5 sin 2πt, and the cases in MuJoCo; the most chatter first"
    console.print(screen.brief_table(title, columns, rows))


def document(
    by_time: Sequence[Benchmark], by_ratio: Sequence[Benchmark], cases: Sequence[CaseRow]
) -> dict[str, Any]:
    """The content of switching.json; what diverged has null for its numbers."""
    from grosmc_mj.experiments.designs import DESIGNS
    from grosmc_mj.report.document import origin
    from grosmc_mj.studies.switching import measure as chattering

    return {
        **origin(None),
        "configuration": {
            "timestep": {"value": chattering.TIMESTEP, "unit": "s"},
            "slopes": {name: DESIGNS[name].slope for name in chattering.CASES},
        },
        "benchmark": {
            "equation": "s' = r phi + 0.5 sin(2 pi t), rho = 1, phi held",
            "own_total_variation": {"value": chattering.OWN_VARIATION, "unit": "1/s"},
            "orders": chattering.orders(by_time),
            "sample_times": [_finite(row._asdict()) for row in by_time],
            "gain_ratios": [_finite(row._asdict()) for row in by_ratio],
        },
        "cases": [_finite({**asdict(row.experiment), **_measured(row)}) for row in cases],
    }


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    """The same with null for numbers without bound, which JSON has not."""
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in values.items()
    }


def _measured(row: CaseRow) -> dict[str, Any]:
    """What was measured on a case."""
    return {name: value for name, value in row._asdict().items() if name != "experiment"}


def _table(title: str, columns: Sequence[str], words: int) -> Table:
    """An empty table: so many columns of words, the others of numbers."""
    from grosmc_mj.report.tables import empty_table

    table = empty_table(title)
    for i, name in enumerate(columns):
        table.add_column(name, justify="left" if i < words else "right", no_wrap=True)
    return table


def _shown(period: float) -> bool:
    """Whether the tables show this sample time."""
    return math.isclose(period, _SHOWN)


def _benchmark_table(rows: Sequence[Benchmark]) -> Table:
    """The scalar benchmark with the nominal input gain."""
    from grosmc_mj.report.tables import number
    from grosmc_mj.studies.switching.measure import OWN_VARIATION, orders

    columns = (
        "law",
        "order of\nmax|s|",
        "max|s|",
        "RMS s",
        "zeros\nper s",
        "variation of u\nover w's",
    )
    table = _table("Scalar s' = u + 0.5 sin 2πt", columns, 1)
    found = orders(rows)
    for row in (row for row in rows if _shown(row.h)):
        values = (row.max_sliding, row.rms_sliding, row.crossings)
        ratio = number(row.total_variation / OWN_VARIATION)
        table.add_row(row.law, f"{found[row.law]:.2f}", *map(number, values), ratio)
    return table


def _limits_table(rows: Sequence[Benchmark]) -> Table:
    """What a wrong input gain does."""
    from grosmc_mj.report.tables import number

    ratios = (0.3, 0.5, 1.0, 1.3, 1.4, 1.9, 2.1)
    title = "Scalar s' = r u + 0.5 sin 2πt, true over nominal input gain r: max|s|"
    table = _table(title, ("law", *(f"r = {ratio:g}" for ratio in ratios)), 1)
    for law in dict.fromkeys(row.law for row in rows):
        found = {round(row.gain_ratio, 6): row.max_sliding for row in rows if row.law == law}
        values = [found[ratio] for ratio in ratios]
        table.add_row(law, *(number(x) if math.isfinite(x) else "diverges" for x in values))
    return table


def _cases_table(rows: Sequence[CaseRow]) -> Table:
    """The cases of one system."""
    from grosmc_mj.plants import find_system
    from grosmc_mj.report.tables import number

    system = find_system(rows[0].experiment.system)
    output, u = system.positions[system.output].unit, system.input.unit
    columns = (
        "case", "law", "surface", f"max|x1-x1*|\n[{output}]", "max|s|", "RMS s", "zeros\nper s",
        f"variation of u\n[{u}/s]", "J of all u\nover J*",
    )  # fmt: skip
    table, shown = _table(f"{system.title}, in MuJoCo", columns, 3), ""
    for row in (row for row in rows if _shown(row.experiment.control_period)):
        experiment = row.experiment
        if shown and shown != experiment.case:
            table.add_section()
        label = "" if shown == experiment.case else experiment.case
        shown = experiment.case
        values = (
            row.deviation, row.max_sliding, row.rms_sliding, row.crossings, row.total_variation,
        )  # fmt: skip
        numbers = [*map(number, values), f"{row.cost_ratio:.4g}"]
        table.add_row(label, experiment.law, experiment.surface, *numbers)
    return table
