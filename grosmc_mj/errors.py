"""The errors that the package raises; a message gives value, bound and valid names."""

from __future__ import annotations

import difflib
import numbers
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

# Between the mistakes of a message that tells several.
NEXT = "\n  - "
# Characters of a value in a message.
_SHOWN = 80


class GrosmcError(Exception):
    """Base of every error that the package raises on purpose."""


class ModelError(GrosmcError, ValueError):
    """A model, an edit of it or a name in it that cannot be used."""


class ArgumentError(GrosmcError, ValueError):
    """An argument of the wrong kind, shape, sign or size."""


class PremiseError(GrosmcError, ValueError):
    """An assumption of the theory does not hold for this plant."""


class GainError(GrosmcError, ValueError):
    """A gain that cannot be designed, for instance because G B is singular."""


class SetupError(GrosmcError, RuntimeError):
    """Something outside the package is missing or broken: a file, a library, the disk."""


class ImplausibleWarning(UserWarning):
    """A number that is allowed, far from those of any machine, and so probably a slip."""


class DivergenceError(GrosmcError, RuntimeError):
    """A simulation that could not be carried to its end.

    Attributes:
        time: Time up to which the run is valid [s].
        trajectory: What was recorded up to then, or None.
    """

    def __init__(self, message: str, time: float, trajectory: Any = None) -> None:
        super().__init__(message)
        self.time = time
        self.trajectory = trajectory


class UndefinedLawError(DivergenceError):
    """A run that reached a state where its law or its plant is not defined."""


class MistakesError(ArgumentError):
    """Several arguments, or lines of a file, that are wrong.

    Attributes:
        mistakes: What is wrong with each.
    """

    def __init__(self, mistakes: Iterable[str]) -> None:
        self.mistakes = tuple(mistakes)
        super().__init__(together(self.mistakes))


class Mistakes:
    """What is wrong with somebody's file, gathered so that all of it is told at once."""

    def __init__(self) -> None:
        self._mistakes: dict[str, None] = {}

    def note(self, *mistakes: str) -> None:
        """Some more, unless they are known already."""
        self._mistakes.update(dict.fromkeys(mistakes))

    @contextmanager
    def gathered(self, where: str = "") -> Iterator[None]:
        """Go on after what is refused within; keep what was said, after ``where``."""
        try:
            yield
        except GrosmcError as error:
            lines = error.mistakes if isinstance(error, MistakesError) else [str(error)]
            self.note(*(where + line for line in lines))

    def refuse(self) -> None:
        """Raise what was gathered.

        Raises:
            ArgumentError: If there is anything.
        """
        if self._mistakes:
            raise MistakesError(self._mistakes)


def together(mistakes: Sequence[str]) -> str:
    """One mistake as it is, or several, each on a line of its own."""
    if len(mistakes) == 1:
        return mistakes[0]
    return NEXT.join([f"{len(mistakes)} mistakes:", *mistakes])


# Names that a message lists.
_LISTED = 20


def unknown_name(kind: str, name: object, valid: Iterable[str]) -> str:
    """One line for a name that is not known: the nearest valid one, then the first of them."""
    names = list(valid)
    near = difflib.get_close_matches(str(name), names, n=1)
    hint = f" did you mean {shown(near[0])}?" if near else ""
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return f"unknown {kind} {shown(name)}:{hint} valid: {listed(names[:_LISTED])}{more}"


def listed(names: Iterable[str]) -> str:
    """Names with commas between them, in quotes where one of them has a blank or a comma itself."""
    words = list(names)
    quoted = any(" " in word or "," in word for word in words)
    return ", ".join(map(repr, words) if quoted else words)


def shown(value: Any, written: Callable[[Any], str] = repr) -> str:
    """A value for a message: on one line, without control characters, cut off if it is long.

    Args:
        value: A number is shown in short, an array as its list.
        written: How anything else is written.
    """
    try:
        if isinstance(value, numbers.Real) and not isinstance(value, bool):
            return format(value, "g")
        text = written(value.tolist() if getattr(value, "ndim", 0) else value)
    # What is wrong with a value may be that it cannot even be written.
    except Exception:
        return f"a {type(value).__name__}"
    line = one_line(text[: 2 * _SHOWN])
    return line if len(line) <= _SHOWN and len(text) <= 2 * _SHOWN else f"{line[: _SHOWN - 3]}..."


def one_line(text: str) -> str:
    """A text on one line, with escapes for what would not be printed."""
    line = " ".join(text.split())
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in line)
