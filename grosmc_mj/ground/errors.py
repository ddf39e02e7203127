"""Errors of the package, and how their messages are written.

A message gives the value, the bound and the valid names.
"""

from __future__ import annotations

import difflib
import numbers
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar, cast

Returned = TypeVar("Returned")

# Separator of the mistakes in a message that lists several.
MISTAKE_SEPARATOR = "\n  - "
# Largest number of characters of a value in a message.
_VALUE_LENGTH = 80
# Largest number of valid names that a message lists.
_LISTED_NAMES = 20


class GrosmcError(Exception):
    """Base of every error that the package raises on purpose."""


class ModelError(GrosmcError, ValueError):
    """A model, an edit of it or a name in it that cannot be used."""


class ArgumentError(GrosmcError, ValueError):
    """An argument of the wrong kind, shape, sign or size."""


class PremiseError(GrosmcError, ValueError):
    """An assumption of the theory that does not hold for this plant."""


class GainError(GrosmcError, ValueError):
    """A gain that cannot be designed, for instance because G B is singular."""


class SetupError(GrosmcError, RuntimeError):
    """A file, a library or another thing outside the package that is missing or broken."""


class ImplausibleWarning(UserWarning):
    """A number that is allowed, but so far from those of any machine that it may be a slip."""


class DivergenceError(GrosmcError, RuntimeError):
    """A simulation that could not be carried to its end.

    Attributes:
        time: Time up to which the run is valid [s].
        trajectory: The record up to then, or None.
    """

    def __init__(
        self,
        message: str,
        time: float,
        trajectory: Any = None,
    ) -> None:
        super().__init__(message)
        self.time = time
        self.trajectory = trajectory


class UndefinedLawError(DivergenceError):
    """A run that reached a state where its law or its plant is not defined."""


class MistakesError(ArgumentError):
    """Several arguments, or lines of a file, that are wrong.

    Attributes:
        mistakes: One line for each of them.
    """

    def __init__(self, mistakes: Iterable[str]) -> None:
        self.mistakes = tuple(mistakes)
        super().__init__(together(self.mistakes))


class Mistakes:
    """Mistakes of a file, gathered so that one error names all of them."""

    def __init__(self) -> None:
        # A dictionary for its keys: they keep their order, and none stands twice.
        self._mistakes: dict[str, None] = {}

    def note(self, *mistakes: str) -> None:
        """Add mistakes; one that is noted already is not added again."""
        for mistake in mistakes:
            self._mistakes[mistake] = None

    @contextmanager
    def gathered(self, where: str = "") -> Iterator[None]:
        """Note the errors that the block raises, with ``where`` before each, and go on."""
        try:
            yield
        except MistakesError as error:
            self.note(*[where + mistake for mistake in error.mistakes])
        except GrosmcError as error:
            self.note(f"{where}{error}")

    def each(
        self,
        kind: str,
        tables: Iterable[Any],
        make: Callable[[Any], Returned],
        base: str = "",
    ) -> list[Returned]:
        """Return what is made of each table of a kind; mistakes are noted with its number.

        Args:
            kind: Kind of the tables.
            tables: The tables.
            make: Function of one of them.
            base: Name of the file that they are taken from, if it is another one.
        """
        owner = f" of {base}" if base else ""
        made = []
        for index, table in enumerate(tables):
            with self.gathered(f"{kind} {index + 1}{owner}: "):
                made.append(make(table))
        return made

    def attempt(self, make: Callable[..., Returned], *arguments: Any, where: str = "") -> Returned:
        """Return the result of a function; None after a mistake, which is noted."""
        with self.gathered(where):
            return make(*arguments)
        return cast("Returned", None)

    def refuse(self) -> None:
        """Raise one error for all mistakes.

        Raises:
            ArgumentError: If there is a mistake.
        """
        if self._mistakes:
            raise MistakesError(self._mistakes)


@contextmanager
def placed(where: str) -> Iterator[None]:
    """Raise the errors of the block as one ``ArgumentError``, with ``where`` before the message."""
    try:
        yield
    except GrosmcError as error:
        raise ArgumentError(f"{where}{error}") from error


def together(mistakes: Sequence[str]) -> str:
    """Join mistakes: one stays as it is, several get a line each."""
    if len(mistakes) == 1:
        return mistakes[0]
    return MISTAKE_SEPARATOR.join([f"{len(mistakes)} mistakes:", *mistakes])


def unknown_name(kind: str, name: object, valid: Iterable[str]) -> str:
    """Write one line that refuses a name: the nearest valid name, then the first valid ones."""
    names = list(valid)
    line = f"unknown {kind} {value_text(name)}:"

    line += did_you_mean(name, names)
    return f"{line} valid: {first_names(names)}"


def did_you_mean(name: object, valid: Iterable[str]) -> str:
    """Return a question with the valid name that is nearest, after a blank; or nothing."""
    nearest = difflib.get_close_matches(str(name), list(valid), n=1)
    if not nearest:
        return ""
    return f" did you mean {value_text(nearest[0])}?"


def name_list(names: Iterable[str]) -> str:
    """Join names by commas; all are quoted if one of them has a blank or a comma."""
    words = list(names)
    if any(" " in word or "," in word for word in words):
        words = [repr(word) for word in words]
    return ", ".join(words)


def first_names(names: Sequence[str], most: int = _LISTED_NAMES) -> str:
    """Join names by commas: the first ones, and how many more there are."""
    line = name_list(names[:most])
    if len(names) > most:
        line += f" and {len(names) - most} more"
    return line


def value_text(value: Any, written: Callable[[Any], str] = repr) -> str:
    """Write a value for a message: on one line, without control characters, cut if it is long.

    Args:
        value: A number is written in short, an array as its list.
        written: Writes any other value.
    """
    try:
        if isinstance(value, numbers.Real) and not isinstance(value, bool):
            return format(value, "g")
        is_array = getattr(value, "ndim", 0) > 0
        text = written(value.tolist() if is_array else value)
    # A value may be refused because it cannot even be written.
    except Exception:
        return f"a {type(value).__name__}"

    # The cut before `one_line` saves the work on an endless text.
    line = one_line(text[: 2 * _VALUE_LENGTH])
    if len(line) > _VALUE_LENGTH or len(text) > 2 * _VALUE_LENGTH:
        return f"{line[: _VALUE_LENGTH - 3]}..."
    return line


def array_text(array: Any) -> str:
    """Write an array of numbers for a message, as its list with four digits of each number."""
    values = array.tolist() if hasattr(array, "tolist") else array
    if isinstance(values, list | tuple):
        return f"[{', '.join(map(array_text, values))}]"
    if isinstance(values, int | float | complex):
        return format(values, ".4g")
    # Matrices of equations have symbols.
    return str(values)


def one_line(text: str) -> str:
    """Write a text on one line, with escapes in place of characters that do not print."""
    line = " ".join(text.split())
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in line)
