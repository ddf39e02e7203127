"""The errors that the package raises; a message gives value, bound and valid names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any


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


class PolicyError(GrosmcError, RuntimeError):
    """A policy of the user's own that raised an error."""


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


def unknown_name(kind: str, name: object, valid: Iterable[str]) -> str:
    """One line for a name that is not known: the nearest valid one, then all of them."""
    names, said = list(valid), " ".join(repr(name).split())
    said = said if len(said) <= 60 else f"{said[:57]}..."
    near = difflib.get_close_matches(str(name), names, n=1)
    hint = f" did you mean {near[0]!r}?" if near else ""
    return f"unknown {kind} {said}:{hint} valid: {', '.join(names)}"
