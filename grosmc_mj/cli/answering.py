"""Base classes of the commands that answer: measure, write the result, print it, draw it."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.exit_codes import DIFFERS, DONE
from grosmc_mj.ground.errors import SetupError, first_names
from grosmc_mj.ground.files import require_writable

if TYPE_CHECKING:
    from grosmc_mj.output.results.result import Result


class Question:
    """Question of a command: what is measured for it, and what is shown.

    It is measured piece by piece, so that an interrupt or an error leaves what is finished.

    Attributes:
        path: JSON file of the result.
    """

    path: Path

    @property
    def files(self) -> Sequence[Path]:
        """Further files that are written."""
        return ()

    def measure(self) -> None:
        """Do the work.

        Raises:
            GrosmcError: If it cannot be done.
        """
        raise NotImplementedError

    def result(self, *, complete: bool) -> Result | None:
        """Return the result of what is finished, or None if nothing is; ``complete`` if all is."""
        raise NotImplementedError

    @property
    def missing(self) -> Sequence[str]:
        """Names of what is not finished, such as laws: the headline of a part names them."""
        return ()

    def draw(self) -> Sequence[Path]:
        """Draw the figures and write other files beside the result; returns their paths."""
        return ()

    def show(self, result: Result, *, full: bool, among: bool) -> None:
        """Write and print the result, see ``screen.say_result``."""
        screen.say_result(result, self.path, self.draw, full=full, among=among)

    def close(self) -> None:
        """Do what follows the complete answer, such as films."""

    @property
    def kept(self) -> bool:
        """True for exit code 0."""
        return True

    @property
    def advice(self) -> str:
        """How to go on after an interrupt."""
        return screen.AGAIN


@dataclass(frozen=True, kw_only=True)
class AnsweringCommand(Command):
    """Command that answers questions, one after the other.

    All that is wrong is refused before the first measurement. An interrupt leaves the result of
    what is finished, and a line that says how to go on.
    """

    # Whether each of several answers is a line or a few.
    in_brief: ClassVar[bool] = False

    def questions(self) -> Sequence[Question]:
        """Return the questions that the options ask.

        Raises:
            GrosmcError: If an option does not fit.
        """
        raise NotImplementedError

    def execute(self) -> int:
        """Measure, write, print and draw the answer to each question; returns the exit code."""
        questions = self.questions()
        for question in questions:
            require_writable(question.path, *question.files)

        among = self.in_brief and len(questions) > 1
        kept = []
        for index, question in enumerate(questions):
            later = [other.path.stem for other in questions[index + 1 :]]
            kept.append(self._answer(question, later, among=among))
        return DONE if all(kept) else DIFFERS

    def _answer(self, question: Question, later: Sequence[str], *, among: bool) -> bool:
        """Answer a question; returns True if it keeps what is required.

        Args:
            question: The question.
            later: Names of the questions after it, which an interrupt leaves unanswered.
            among: True if several answers follow each other.
        """
        try:
            question.measure()
        except (Exception, KeyboardInterrupt) as end:
            # The error that ended the work is the one to report, not a second one here.
            with contextlib.suppress(SetupError):
                self._show(question, complete=False, among=among)
            if isinstance(end, KeyboardInterrupt):
                advice = str(end) or question.advice
                if later:
                    advice += f"; not begun: {first_names(later)}"
                raise KeyboardInterrupt(advice) from None
            raise

        self._show(question, complete=True, among=among)
        question.close()
        return question.kept

    def _show(self, question: Question, *, complete: bool, among: bool) -> None:
        result = question.result(complete=complete)
        if result is None:
            return
        if not complete:
            result = result.unfinished(question.missing)
        question.show(result, full=self.verbose, among=among)
