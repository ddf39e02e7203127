"""grosmc-mj switching."""

from __future__ import annotations

from typing import TYPE_CHECKING

from grosmc_mj.cli import screen
from grosmc_mj.cli.commands import Switching

if TYPE_CHECKING:
    from grosmc_mj.studies.switching.measure import Benchmark, CaseRow


def switching(command: Switching) -> int:
    """Measure, print, write, draw."""
    from grosmc_mj.report.document import write_json
    from grosmc_mj.studies.switching import measure as chattering
    from grosmc_mj.studies.switching.figure import write_chattering_figure
    from grosmc_mj.studies.switching.report import SHOWN, switching_document, switching_tables

    planned = chattering.experiments(command.system)
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
    target = command.out / "switching.json"
    write_json(target, switching_document(by_time, by_ratio, cases))
    console = screen.console()
    for number, table in enumerate(switching_tables(by_time, by_ratio, cases)):
        if number:
            console.print()
        console.print(table)
    for row in cases:
        if row.ended:
            console.print(f"{row.experiment.key}: {row.ended}", style="red", soft_wrap=True)
    figure = write_chattering_figure(by_time, by_ratio, cases, command.out)
    console.print(
        f"Tables at {1e3 * SHOWN:g} ms; {target} and {figure} have every sample time.",
        style="dim", soft_wrap=True,
    )  # fmt: skip
    return screen.DONE
