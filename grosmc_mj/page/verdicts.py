"""What one document answers, and in which words."""

from __future__ import annotations

from typing import NamedTuple

KEPT, BROKEN, OPEN, MEASURED = "kept", "not kept", "open", "measured"
VERDICTS = (BROKEN, OPEN, KEPT, MEASURED)


class Answer(NamedTuple):
    """What one document answers.

    Attributes:
        asked: What was asked.
        verdict: KEPT, BROKEN, OPEN, or MEASURED where nothing was to be kept.
        words: The answer.
        number: That tells most; empty for none.
    """

    asked: str
    verdict: str
    words: str
    number: str = ""
