"""How much gain and delay does each law tolerate?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from grosmc_mj.cli.command import Flag, Laws, Target, WholeNumber, command
from grosmc_mj.cli.study_command import StudyCommand

if TYPE_CHECKING:
    from grosmc_mj.output.results.result import Result
    from grosmc_mj.studies.margins.margins import MarginStudy
    from grosmc_mj.studies.margins.row import LawMargins


@command
class MarginsCommand(StudyCommand["MarginStudy", "LawMargins"]):
    """Find how much gain and delay each law tolerates in the loop as it is built.

    On the task: the gain of the actuators falls or grows, or a delay is added, until something
    that the target requires is no longer kept, nominally and under its edits and disturbances, or
    else those of the system's case1 and case2; a case that a law does not keep as it is does not
    count. On small signals: the sensitivity S is measured by multisines that are injected at the
    plant's inputs and at each measured state, with gain, phase, delay, modulus and disk margin and
    the bandwidth; S is shown at the lowest amplitude at which all laws can be trusted, * of a law
    at its own. Of laws that switch, where they begin to chatter. In an ideal loop, in the target's
    loop, and of a system on its machine.

    Writes margins_NAME.json, .png and .svg to --out, after Ctrl-C or SIGTERM what there is of them,
    and each finished law to the folder margins_NAME. A figure has at most six laws; the next six
    are in margins_NAME_2.png and .svg.

    Exit code: 0 if done, 1 if a law keeps the task under no condition, 2 if the command or the
    set-up is wrong.

    Attributes:
        target: A system, which means its bench and its machine, a case, or a case file, whose own
            edits and disturbances act.
        laws: Laws to study, such as lqr, implicit, "implicit, predicted" or any law of the file.
        all: Study the other laws that the system's cases share and every switching law, too.
        rivals: Study lqi, fl-pid, adrc and adaptive, too.
        injection: Largest injection at an input, rms, such as "1 A".
        period: Period of the injected signals, such as "10 s".
        draws: Runs of a task in a loop with an encoder, noise, jitter or missed samples: each has
            random numbers of its own and other phases of the encoders, and all must keep it.
    """

    target: Target
    _: KW_ONLY
    laws: Laws = ()
    all: Flag = False
    rivals: Flag = False
    injection: Annotated[str, Parameter(metavar="VALUE", show_default="a quarter of the limit")] = (
        ""
    )
    period: Annotated[str, Parameter(metavar="TIME", show_default="the length of the task")] = ""
    draws: WholeNumber = 20

    def study(self) -> MarginStudy:
        """Return the loops and machines of the target."""
        from grosmc_mj.studies.margins.margins import margin_study
        from grosmc_mj.studies.sweep.draws import require_draws

        require_draws(self.draws)
        return margin_study(
            self.target,
            self.laws,
            further=self.all,
            rivals=self.rivals,
            injection=self.injection,
            period=self.period,
            draws=self.draws,
        )

    def result(self, study: MarginStudy, rows: Sequence[LawMargins], *, complete: bool) -> Result:
        """Return the result of a study of margins."""
        from grosmc_mj.studies.margins.answer import margins_result

        return margins_result(study, rows, complete=complete)

    def draw(self, study: MarginStudy, rows: Sequence[LawMargins], path: Path) -> Sequence[Path]:
        """Draw a figure for every six laws, with a row of charts for each setup."""
        from grosmc_mj.output.charts.figure import write_chart
        from grosmc_mj.output.charts.of_results import panels_chart
        from grosmc_mj.studies.margins.answer import by_setup
        from grosmc_mj.studies.margins.figure import charts, in_figures

        title = f"{study.target}: L at the plant's input, and its delay margin"
        groups = in_figures(row.law for row in rows)
        files = []
        for number, laws in enumerate(groups, 1):
            panels = []
            for setup, of_setup in by_setup(study, rows):
                if not any(row.law in laws for row in of_setup):
                    continue
                panels.append(charts(setup, of_setup, laws))
            ending = "" if number == 1 else f"_{number}"
            figure = path.with_name(f"{path.stem}{ending}.png")
            files.append(write_chart(panels_chart(title, panels), figure))
        return files

    def keeps(self, study: MarginStudy, rows: Sequence[LawMargins]) -> bool:
        """Whether each law keeps the task under some condition."""
        return all(row.changes for row in rows)
