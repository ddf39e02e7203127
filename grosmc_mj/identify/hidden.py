"""Parameters that a log does not show, alone or together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.identify.parameters import Parameters

# A direction whose standard deviation is more than this share of the parameters is not visible.
_WEAK = 0.5
# A parameter belongs to that direction if its change or effect is above this share of the largest.
_PART = 0.3
# Changes that agree to this share are alike: derivatives of a log with noise are no better.
_ALIKE = 0.03


class HiddenParameter(NamedTuple):
    """Parameters that the log does not show.

    Attributes:
        held: The one that is held at its value in the case.
        others: Those that it cannot be told apart from; empty if it has no effect of its own.
        words: Which combination of them is visible, and which log would show them.
    """

    held: str
    others: tuple[str, ...]
    words: str


@dataclass(frozen=True)
class _Member:
    """A parameter of a direction that the log does not show.

    Attributes:
        name: Its name.
        unit: Its unit.
        value: Its value at the fit.
        change: Its change in that direction, in its unit.
    """

    name: str
    unit: str
    value: float
    change: float

    @property
    def share(self) -> float:
        """Its change as a share of its value; infinite of 0."""
        if self.value == 0:
            return math.inf
        return self.change / self.value


def hidden_parameter(
    parameters: Parameters, free: NDArray[np.bool_], jacobian: Array, values: Array
) -> HiddenParameter | None:
    """The parameters that are the least visible, if that is not enough; None if all are.

    Args:
        parameters: The parameters.
        free: Which are fitted, (d,).
        jacobian: Derivatives of the residual by shares of their ranges, and by the starts, (r, p).
        values: Of all parameters, at which the derivatives are taken, (d,).
    """
    count = int(free.sum())
    low, high = parameters.bounds
    scales = parameters.scales[free]
    by_size = jacobian[:, :count] * (scales / (high - low)[free])

    # A residual that other starts of the windows could explain counts for no parameter.
    by_start = jacobian[:, count:]
    by_start = by_start[:, np.abs(by_start).max(axis=0) > 0]
    by_size = by_size - by_start @ np.linalg.lstsq(by_start, by_size, rcond=None)[0]

    # The least singular value is the inverse of the largest standard deviation of a direction.
    _, s, v = np.linalg.svd(by_size, full_matrices=False)
    if s[-1] * _WEAK >= 1.0:
        return None

    direction = v[-1]
    quantities = [parameters.quantities[i] for i in np.flatnonzero(free).tolist()]
    members = []
    for i in _members(direction, np.linalg.norm(by_size, axis=0)):
        quantity = quantities[i]
        change = float(direction[i] * scales[i])
        members.append(_Member(quantity.name, quantity.unit, float(values[free][i]), change))
    held, *others = members
    return HiddenParameter(held.name, tuple(row.name for row in others), _unseen_words(members))


def _members(direction: Array, effects: Array) -> list[int]:
    """Indices of the parameters that belong to a hidden direction, that with the largest first.

    Args:
        direction: In sizes of the parameters, (d,).
        effects: Norms of the residual that a size of each one makes, (d,).
    """
    sizes = np.abs(direction)
    order: list[int] = np.argsort(-sizes, kind="stable").tolist()
    if effects[order[0]] * _WEAK < 1.0:
        return order[:1]
    # A small change may have a large effect, which cancels those of the others.
    parts = sizes * effects
    belongs = np.maximum(sizes / sizes.max(), parts / parts.max()) > _PART
    return [index for index in order if belongs[index]]


def _unseen_words(members: Sequence[_Member]) -> str:
    """Words on a held parameter, the first one, and those that it cannot be told apart from."""
    name = members[0].name
    if len(members) == 1:
        return f"{name} is not visible in this log: give it a run that moves it more, or faster"

    listed = " and ".join(member.name for member in members)
    if len(members) == 2:
        words = f"{listed}: only {_visible_words(*members)} is visible in this log"
    else:
        words = f"{listed}: a change of all of them is not visible in this log, {_changes(members)}"
    return (
        f"{words}; {name} is held at its value in the case. A run with a known load, or a "
        "measurement of one of them, tells them apart"
    )


def _visible_words(first: _Member, second: _Member) -> str:
    """Words on the combination of two parameters that their common change leaves as it is."""
    factor = abs(first.change / second.change)
    differ = first.change * second.change > 0
    # Of equal numbers with a unit, such as two delays, sum and product agree: it is the sum.
    if first.unit and first.unit == second.unit and math.isclose(factor, 1.0, rel_tol=_ALIKE):
        return "their difference" if differ else "their sum"

    same_share = math.isclose(abs(first.share), abs(second.share), rel_tol=_ALIKE)
    if same_share and math.isfinite(first.share):
        return "their ratio" if first.share * second.share > 0 else "their product"
    return f"{first.name} {'-' if differ else '+'} {factor:.3g} times {second.name}"


def _changes(members: Sequence[_Member]) -> str:
    """Changes that cancel each other, the first one by 1."""
    unit = 1 / members[0].change
    changes = [
        f"{member.name} by {member.change * unit:.3g}{unit_after(member.unit)}"
        for member in members
    ]
    return ", ".join(change.rstrip() for change in changes)
