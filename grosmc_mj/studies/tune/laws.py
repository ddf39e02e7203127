"""Laws of a target with the numbers that are tuned: those declared, or those named."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import Content
from grosmc_mj.experiments.file.user_code import is_named
from grosmc_mj.experiments.laws import laws_of
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError, placed, value_text
from grosmc_mj.ground.units import is_number, typed_number
from grosmc_mj.studies.target import StudiedLaw, chosen_laws
from grosmc_mj.studies.tune.numbers import TunableLaw, TunedNumber, keys_of

# A number of a law with its range, laws.NAME.PATH=LOW..HIGH; the range may be missing.
_WRITTEN = re.compile(r"(?P<path>[^=]+)(?:=(?P<low>.+?)\.\.(?P<high>.+))?")
_FORM = "laws.NAME.NUMBER=LOW..HIGH, such as laws.lqr.Q[1]=1..1e5"
# Range of a number of which nothing is declared: so many times less and more than in the file.
_SPREAD = 100.0
# Laws of the package whose closed loop Q does not place.
_WITHOUT_WEIGHTS = ("pid", "fl-pid", "linear-pid", "pd", "adaptive", "linear-adaptive")
_WEIGHT_RANGE = (1e-1, 1e5)
# Ways to the gains of a PID, of which a table has one.
_PID_GAINS = ("kp", "ki", "kd")
_INSTEAD_OF_GAINS = ("tune", "frequency")


@dataclass(frozen=True)
class _Declared:
    """Range of a number of the package's laws.

    Attributes:
        low: Least value.
        high: Largest value.
        unit: Its unit.
    """

    low: float
    high: float
    unit: str = ""


_DECLARED = {
    "k": _Declared(0.1, 200.0),
    "epsilon": _Declared(0.1, 200.0),
    "integral_weight": _Declared(1e-2, 1e6),
    "frequency": _Declared(0.3, 100.0, "rad/s"),
    "damping": _Declared(0.2, 3.0),
    "bandwidth": _Declared(5.0, 500.0, "rad/s"),
    "adaptation": _Declared(1e-3, 1e4),
    "kp": _Declared(0.1, 300.0),
    "ki": _Declared(1e-2, 1e3),
    "kd": _Declared(1e-3, 30.0),
    "filter": _Declared(5e-4, 0.1, "s"),
    "reaching_rate": _Declared(1e-2, 30.0),
}


def tunable_laws(
    experiment: Experiment, names: Sequence[str], written: Sequence[str] = ()
) -> list[TunableLaw]:
    """Return laws with the numbers that are tuned.

    Args:
        experiment: Experiment of the target.
        names: Names of the laws, as in the other studies.
        written: Numbers and their ranges, ``laws.NAME.NUMBER=LOW..HIGH``; those of a law replace
            the declared ones.

    Raises:
        ArgumentError: If there is no such law or number, or a range cannot be.
    """
    studied = chosen_laws(experiment.varied(loop=None), names)
    named = _by_law(written, [law.name for law in studied])
    return [_tunable_law(experiment, law, named.get(law.name, {})) for law in studied]


def _by_law(written: Sequence[str], laws: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the numbers that are named, by law and path, each with its ends as texts or None."""
    named: dict[str, dict[str, Any]] = {}
    for text in written:
        match = _WRITTEN.fullmatch(text)
        path = match["path"].strip() if match else ""
        if match is None or not path.startswith("laws."):
            raise ArgumentError(f"--number {value_text(text)} must be {_FORM}")

        path = path.removeprefix("laws.")
        owners = [law for law in laws if path.startswith(f"{law}.")]
        if not owners:
            require_known("law", path.partition(".")[0], laws, f"--number {text}: ")
            raise ArgumentError(f"--number {value_text(text)} must be {_FORM}")
        law = max(owners, key=len)
        ends = (match["low"], match["high"]) if match["low"] else None
        named.setdefault(law, {})[path.removeprefix(f"{law}.")] = ends
    return named


def _tunable_law(experiment: Experiment, law: StudiedLaw, named: Mapping[str, Any]) -> TunableLaw:
    """Return a law with the numbers that are named, or else with those that are declared."""
    table = _table(experiment, law)
    if any(path in _PID_GAINS for path in [*named, *_own_gains(table)]):
        for key in _INSTEAD_OF_GAINS:
            table.pop(key, None)

    paths = list(named) or list(_paths(table, law))
    if not paths:
        raise ArgumentError(
            f"law {law.name} has no number to tune: name one by --number laws.{law.name}..."
        )
    numbers = []
    for path in paths:
        with placed(f"laws.{law.name}.{path}: "):
            numbers.append(_number(experiment, law, table, path, named.get(path)))
    return TunableLaw(law, experiment, table, tuple(numbers))


def _table(experiment: Experiment, law: StudiedLaw) -> Content:
    """Return the table of a law as a controller of the file, with all its numbers."""
    table = experiment.file.law(law.base).model_dump(exclude_unset=True)
    table.update(law.sampled)
    table["name"] = law.name
    if law.predict:
        table["predict"] = True
    return table


def _own_gains(table: Content) -> tuple[str, ...]:
    """Return the gains that are tuned of a PID by default."""
    return _PID_GAINS if table["law"] == "pid" else ()


def _paths(table: Content, law: StudiedLaw) -> Iterator[str]:
    """Yield the numbers of a law that are tuned if none are named."""
    if is_named(table["law"]):
        for key, value in table.items():
            if is_number(value):
                yield key
        return

    if table["law"] not in _WITHOUT_WEIGHTS:
        for index in range(len(law.controller.designed.lqr.Q)):
            yield f"Q[{index + 1}]"
    if table["law"] == "pid":
        yield from (*_PID_GAINS, "filter")
        return
    for key, value in table.items():
        if key in _DECLARED and is_number(value):
            yield key
    uncertainty = table.get("uncertainty")
    if isinstance(uncertainty, dict):
        for index, value in enumerate(uncertainty.get("wrench", ())):
            if value:
                yield f"uncertainty.wrench[{index + 1}]"
        if "reaching_rate" in uncertainty:
            yield "uncertainty.reaching_rate"


def _number(
    experiment: Experiment,
    law: StudiedLaw,
    table: Content,
    path: str,
    ends: tuple[str, str] | None,
) -> TunedNumber:
    """Return a number with its range.

    Args:
        experiment: Experiment of the target.
        law: The law.
        table: Its table.
        path: Place of the number in the table.
        ends: Ends of the range as texts; None for the declared range.
    """
    start = _start(experiment, law, table, path)
    declared = _DECLARED.get(str(keys_of(path)[-1]), _Declared(math.nan, math.nan))
    if ends is not None:
        low, high = (typed_number(end, declared.unit) for end in ends)
        if not low < high:
            raise ArgumentError(f"the range {ends[0]}..{ends[1]} must rise")
        logarithmic = low > 0
        least = 0.0 if logarithmic else -math.inf
        return TunedNumber(
            path, start, low, high, least, unit=declared.unit, logarithmic=logarithmic
        )

    low, high = declared.low, declared.high
    if path.startswith("Q["):
        low, high = _WEIGHT_RANGE
    elif math.isnan(low):
        if start is None or not start > 0:
            raise ArgumentError("nothing tells its range: write NUMBER=LOW..HIGH")
        low, high = start / _SPREAD, start * _SPREAD
    return TunedNumber(path, start, low, high, unit=declared.unit).including(start)


def _start(experiment: Experiment, law: StudiedLaw, table: Content, path: str) -> float | None:
    """Return the value of a number in the file; None if the file has none.

    Raises:
        ArgumentError: If the law has no such number.
    """
    key, *inner = keys_of(path)
    if key == "Q" and inner:
        weight = np.diag(law.controller.designed.lqr.Q)
        require_known("entry of Q", path, [f"Q[{i + 1}]" for i in range(len(weight))])
        return float(weight[inner[0]])

    value: Any = table
    for name in (key, *inner):
        value = _entry(value, name)
    if is_number(value):
        return float(value)
    if value is not None:
        raise ArgumentError(f"{value_text(value)} is no number")
    if is_named(table["law"]) or inner:
        raise ArgumentError(f"law {law.name} has no such number")

    maker = laws_of(experiment.nominal).get(table["law"])
    valid = list(inspect.signature(maker).parameters)[1:] if maker else []
    require_known("number", key, valid)
    gain = getattr(law.controller.parameters, key, None)
    if table["law"] == "pid" and gain is not None:
        return float(np.ravel(gain)[0])
    return None


def _entry(owner: Any, key: Any) -> Any:
    """Return an entry of a table or a list; None if there is none."""
    if isinstance(owner, dict):
        return owner.get(key)
    if isinstance(owner, list) and isinstance(key, int) and 0 <= key < len(owner):
        return owner[key]
    return None
