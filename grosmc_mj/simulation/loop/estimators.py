"""Estimators of rates, at each sample of the law.

``eso`` is after H. K. Khalil, "High-gain observers in nonlinear feedback control", 2017, and
Z. Gao, "Scaling and bandwidth-parameterization based controller tuning", ACC 2003, as a current
observer with all poles at exp(-w T).
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, get_args

from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.fields import Check, Flag, Known, Range, checked
from grosmc_mj.ground.refusals import refusal
from grosmc_mj.simulation.loop.prediction import move_by_a_period
from grosmc_mj.simulation.loop.rows import numbers_dtype
from grosmc_mj.theory.control.matrices import copy
from grosmc_mj.theory.plants.owner_units import FIRST_INPUT

EstimatorLaw = Literal["difference", "filtered", "eso", "kalman"]
KINDS = get_args(EstimatorLaw)
# Kinds in a row, by their place in ``KINDS``.
_FILTERED = 1.0
ESO = 2.0
# Name of the number that tunes an estimator.
TUNED_BY: dict[str, str] = {
    "filtered": "time_constant",
    "eso": "bandwidth",
    "kalman": "load",
}


class _States(Check):
    """Names of states, one or several; none of them twice."""

    def __call__(self, value: Any) -> tuple[str, ...]:
        names = (value,) if isinstance(value, str) else value
        wanted = refusal("names of states, at least one, each of them once")
        if not isinstance(names, (list, tuple)) or not names:
            raise wanted
        for name in names:
            if not isinstance(name, str) or not name or names.count(name) > 1:
                raise wanted
        return tuple(names)


@checked()
class Estimator:
    """Estimation of states that are not measured.

    Attributes:
        of: Names of the states. ``kalman`` estimates any state; the others estimate rates, from
            the position that the law gets.
        law: ``difference`` of two samples; ``filtered``, the same through a lag; ``eso``, a
            critically damped observer of the design model with a constant disturbance; ``kalman``,
            the steady-state filter of the design model.
        time_constant: Time constant of ``filtered`` [s].
        bandwidth: Place of all poles of ``eso`` [rad/s].
        load: Standard deviation of an unknown input for ``kalman``, constant in a sample, in the
            unit of the inputs.
        settled: Whether it has run long before the law is switched on, and so begins with the true
            value; else it begins with a rate of zero, and the law with that error.
    """

    of: Annotated[tuple[str, ...], _States()]
    law: Annotated[EstimatorLaw, Known("estimator", KINDS)] = "difference"
    time_constant: Annotated[float, Range(0, unit="s", above=True)] | None = None
    bandwidth: Annotated[float, Range(0, unit="rad/s", above=True)] | None = None
    load: Annotated[float, Range(0, unit=FIRST_INPUT, above=True)] | None = None
    settled: Flag = True

    def __post_init__(self) -> None:
        needed = TUNED_BY.get(self.law)
        unneeded = [name for name in dict.fromkeys(TUNED_BY.values()) if name != needed]
        missing = needed is not None and getattr(self, needed) is None
        if missing or any(getattr(self, name) is not None for name in unneeded):
            raise ArgumentError(
                f"{self.law} needs {needed or 'no number'}, has no {', '.join(unneeded)}"
            )

    @property
    def number(self) -> float:
        """Number that tunes the estimator; 0 for ``difference``."""
        if self.law not in TUNED_BY:
            return 0.0
        return float(getattr(self, TUNED_BY[self.law]))


# Row of each estimated rate: kind and number of the estimator, indices of the rate and of its
# position in the state, 1 if it begins settled. Memory of a run: the estimated position, rate and
# disturbance, and the last measurement, in the units of the states.
ESTIMATOR = numbers_dtype(
    "kind",
    "number",
    "of",
    "position",
    "settled",
    "y",
    "rate",
    "load",
    "last",
)


@jitable
def _difference(estimator: Any, y: float, T: float) -> None:
    """(y_k - y_{k-1}) / T, through a lag of the estimator's time constant if it is filtered."""
    slope = (y - estimator.last) / T
    kept = 0.0
    if estimator.kind == _FILTERED:
        kept = math.exp(-T / estimator.number)
    estimator.y = y
    estimator.rate = kept * estimator.rate + (1.0 - kept) * slope


@jitable
def _extended(
    estimator: Any,
    y: float,
    T: float,
    gained: float,
) -> None:
    """Observer with a disturbance as a third state, all three poles at exp(-w T).

    ``gained`` is the change of the rate in the period by the design model.
    """
    rate = estimator.rate
    load = estimator.load
    pole = math.exp(-estimator.number * T)
    e = y - (estimator.y + T * rate + 0.5 * T * (gained + T * load))
    part = 1.0 - pole
    estimator.y = y - pole * pole * pole * e
    estimator.rate = rate + gained + T * load + 1.5 * part * part * (1.0 + pole) * e / T
    estimator.load = load + part * part * part * e / (T * T)


@jitable
def _update(
    estimator: Any,
    y: float,
    T: float,
    gained: float,
) -> None:
    """Update an estimator by a sample y, T after the last one."""
    if estimator.kind == ESO:
        _extended(estimator, y, T, gained)
    else:
        _difference(estimator, y, T)


@jitable
def note_gains(k: int, clock: int, software: Any) -> None:
    """Note before sample k by how much the design model changes each state in a period.

    It starts from the estimates of the extended observers.
    """
    copy(software.seen, software.x)
    for row in range(len(software.estimators)):
        estimator = software.estimators[row]
        if estimator.kind == ESO:
            software.x[int(estimator.position)] = estimator.y
            software.x[int(estimator.of)] = estimator.rate

    copy(software.x, software.predicted)
    move_by_a_period(k, clock, software)
    for j in range(len(software.states)):
        software.states[j].gained = software.x[j] - software.predicted[j]


@jitable
def estimate(k: int, measured: Any, software: Any) -> None:
    """Write the rates that are estimated at sample k into ``software.seen``."""
    setup = software.setup[0]
    for row in range(len(software.estimators)):
        estimator = software.estimators[row]
        rate = int(estimator.of)
        position = int(estimator.position)
        y = software.seen[position]
        fresh = measured.fresh[position]

        if k == 0:
            # The rate is there: the true one if it begins settled, else zero.
            estimator.y = y
            estimator.last = y
        elif fresh > 0.0:
            # A sensor with a period has a clock of its own; others follow the computer's.
            T = setup.period
            sensor_period = software.states[position].sensor_period
            if sensor_period > 0.0:
                T = fresh * sensor_period * setup.tick
            _update(estimator, y, T, software.states[rate].gained)
            estimator.last = y
        software.seen[rate] = estimator.rate
