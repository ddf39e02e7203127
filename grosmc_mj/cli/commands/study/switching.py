"""grosmc-mj study switching."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.targets import TARGET

if TYPE_CHECKING:
    from grosmc_mj.studies.switching import Benchmark, CaseRow


@dataclass(frozen=True)
class SwitchingCommand(Command):
    """Measure accuracy and chattering of six switching laws against sample time.

    On a scalar with a sine disturbance, whose input gain is right or wrong by a factor, and on the
    chapter's cases in MuJoCo under GROSMC, or on a case of your own, with the printed and with the
    discrete-time surface: largest |s|, distance from the optimal trajectory, zero crossings, total
    variation of the input, J of its continuous part over J* and what the rest costs a second.
    switching.json and the figure, switching.png and switching.svg, go to --out.

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
        from grosmc_mj.studies import switching

        planned = switching.experiments(switching.cases_of(self.target))
        swept = len(switching.LAWS) * (len(switching.SAMPLE_TIMES) + len(switching.GAIN_RATIOS))
        rows: tuple[list[Benchmark], list[Benchmark], list[CaseRow]] = [], [], []
        by_time, by_ratio, cases = rows
        with screen.progress(swept + len(planned), "runs") as advance:
            for row in switching.sample_time_sweep():
                by_time.append(row)
                advance(f"scalar/{row.law} {row.h:g} s")
            for row in switching.gain_ratio_sweep():
                by_ratio.append(row)
                advance(f"scalar/{row.law} r = {row.gain_ratio:g}")
            for run in planned:
                cases.append(switching.measure_case(run))
                advance(run.key)
        target = self.out / "switching.json"
        write_json(target, switching.switching_document(*rows))
        figure = switching.write_switching_figure(*rows, target.with_suffix(".png"))
        console = screen.console()
        endings = [f"{row.run.key}: {row.ended}" for row in cases if row.ended]
        words = f"All {len(cases)} runs in MuJoCo completed."
        if endings:
            words = f"{len(endings)} of {len(cases)} runs in MuJoCo ended early."
        screen.say_verdict(console, words, good=not endings)
        screen.say_lines(console, endings, all=self.verbose)
        console.print(switching.scalar_table(by_time, by_ratio))
        if self.verbose:
            screen.wide_console().print(switching.cases_table(cases))
        console.print(f"Tables at {1e3 * switching.SHOWN:g} ms; the files have every sample time.")
        screen.say_files(console, target, figure)
        return screen.DONE
