"""grosmc-mj study margins."""

from __future__ import annotations

from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command, Flag, Out, StudiedLaws, Target, command
from grosmc_mj.cli.exit_codes import DIFFERS, DONE
from grosmc_mj.cli.targets import result_name

if TYPE_CHECKING:
    from grosmc_mj.studies.law_margins import LawMargins
    from grosmc_mj.studies.margins import MarginStudy


@command
class MarginsCommand(Command):
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
    and each finished law to the folder margins_NAME.

    Exit code: 0 if done, 1 if a law keeps the task under no condition, 2 if the command or the
    set-up is wrong.

    Attributes:
        target: A system, which means its bench and its machine, a case, or a case file, whose own
            edits and disturbances act.
        laws: Laws to study, such as lqr, implicit, "implicit, predicted" or any law of the file.
        rivals: Study lqi, fl-pid, adrc and adaptive, too.
        injection: Largest injection at an input, rms, such as "1 A".
        period: Period of the injected signals, such as "10 s".
        resume: Run only what is missing in margins_NAME, the folder in --out to which every
            finished law is written, of the same file and versions.
        out: Folder for margins_NAME.json and the figure.
    """

    target: Target
    _: KW_ONLY
    laws: StudiedLaws = ()
    rivals: Flag = False
    injection: Annotated[str, Parameter(metavar="VALUE", show_default="a quarter of the limit")] = (
        ""
    )
    period: Annotated[str, Parameter(metavar="TIME", show_default="the length of the task")] = ""
    resume: Flag = False
    out: Out = Path("renders")

    def execute(self) -> int:
        """Measure each law, write, draw and print the margins."""
        from grosmc_mj.studies.margins import margin_study
        from grosmc_mj.studies.margins_answer import margins_result

        studied = margin_study(
            self.target,
            self.laws,
            rivals=self.rivals,
            injection=self.injection,
            period=self.period,
        )
        rows: list[LawMargins] = []
        with screen.answered(
            self._path(studied),
            lambda complete: margins_result(studied, rows, complete=complete),
            rows,
            lambda: self._draw(studied, rows),
            full=self.verbose,
            advice=screen.RESUME,
        ):
            self._measure(studied, rows)
        return DONE if all(row.task for row in rows) else DIFFERS

    def _measure(self, studied: MarginStudy, rows: list[LawMargins]) -> None:
        """Measure each law, or read it if it is finished and --resume is given.

        Args:
            studied: The study.
            rows: Filled law by law: an interrupt leaves the first ones.
        """
        from grosmc_mj.studies.law_margins import cells_of, law_margins

        cells = cells_of(studied, self._path(studied).with_suffix(""))
        with screen.progress(len(studied.steps), "laws") as advance:
            for setup, law in studied.steps:
                name = f"{setup.name}: {law.name}"
                row = cells.read(setup.name, law.name) if self.resume else None
                if row is None:
                    row = law_margins(
                        studied, setup, law, lambda text, name=name: advance(f"{name}: {text}", 0)
                    )
                    cells.write(row)
                rows.append(row)
                advance(name, 1)

    def _path(self, studied: MarginStudy) -> Path:
        """Return the path of the result."""
        return self.out / f"margins_{result_name(studied.setups[0].case.path)}.json"

    def _draw(self, studied: MarginStudy, rows: list[LawMargins]) -> tuple[Path, ...]:
        """Draw the figure; returns its path."""
        from grosmc_mj.results.charts import write_panels
        from grosmc_mj.studies.margins_answer import by_setup
        from grosmc_mj.studies.margins_figure import charts

        panels = [charts(setup, of_setup) for setup, of_setup in by_setup(studied, rows)]
        title = f"{studied.target}: L at the plant's input, and its delay margin"
        return (write_panels(self._path(studied).with_suffix(".png"), title, panels),)
