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

        studied = margin_study(
            self.target,
            self.laws,
            rivals=self.rivals,
            injection=self.injection,
            period=self.period,
        )
        rows: list[LawMargins] = []
        with screen.partial_results_kept(
            lambda: self._write(studied, rows, complete=False),
            "interrupted; the same command with --resume runs what is missing",
        ):
            self._measure(studied, rows)
        try:
            files = self._write(studied, rows, complete=True)
        finally:
            self._print_answer(studied, rows)
        screen.say_files(screen.console(), *files)
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

    def _write(
        self, studied: MarginStudy, rows: list[LawMargins], *, complete: bool
    ) -> tuple[Path, ...]:
        """Write document and figure; returns their paths, none without a row."""
        from grosmc_mj.results.charts import write_panels
        from grosmc_mj.results.document import write_json
        from grosmc_mj.studies import margins_answer as answer
        from grosmc_mj.studies.margins_figure import charts

        if not rows:
            return ()
        path = self._path(studied)
        write_json(path, answer.margins_document(studied, rows, complete=complete))
        panels = [charts(setup, of_setup) for setup, of_setup in answer.by_setup(studied, rows)]
        title = f"{studied.target}: L at the plant's input, and its delay margin"
        return path, write_panels(path.with_suffix(".png"), title, panels)

    def _print_answer(self, studied: MarginStudy, rows: list[LawMargins]) -> None:
        """Print the margins in each setup and, on request, every table."""
        from grosmc_mj.studies import margins_answer as answer

        console = screen.console()
        console.print(answer.verdict(rows), style="bold", markup=False)
        measured = list(answer.by_setup(studied, rows))
        # One screen has no room for all: those nearest to the machine.
        for setup, of_setup in measured if self.verbose else measured[-2:]:
            console.print(answer.margin_table(setup, of_setup))
            screen.say_lines(console, answer.notes(of_setup), "dim", full=self.verbose)
        if self.verbose:
            for sheet in answer.sheets(studied, rows):
                screen.wide_console().print(sheet.table)
        console.print(answer.LEGEND, style="dim", markup=False)
