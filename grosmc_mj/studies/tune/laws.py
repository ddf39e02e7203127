"""Laws of a target with the numbers that are tuned: those declared, or those named."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import Content
from grosmc_mj.experiments.file.reading import case_file_of
from grosmc_mj.experiments.file.user_code import is_named
from grosmc_mj.experiments.number import Number
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError, placed, value_text
from grosmc_mj.ground.units import is_number, si_number
from grosmc_mj.studies.target import StudiedLaw, chosen_laws
from grosmc_mj.studies.tune.numbers import TunableLaw, TunedNumber

# A number of a law with its range, laws.NAME.PATH=LOW..HIGH; the range may be missing.
_WRITTEN = re.compile(r"(?P<path>[^=]+)(?:=(?P<low>.+?)\.\.(?P<high>.+))?")
_FORM = "laws.NAME.NUMBER=LOW..HIGH, such as laws.lqr.Q[1]=1..1e5"
# Range of a number of which nothing is declared: so many times less and more than in the file.
_SPREAD = 100.0
# Laws of the package whose closed loop Q does not place.
_WITHOUT_WEIGHTS = ("pid", "fl-pid", "linear-pid", "pd", "adaptive", "linear-adaptive")
# Ways to the gains of a PID, of which a table has one.
_PID_GAINS = ("kp", "ki", "kd")
_INSTEAD_OF_GAINS = ("tune", "frequency")

# Ranges of numbers of the package's laws.
_RANGES: Mapping[str, tuple[float, float]] = {
    "Q": (1e-1, 1e5),
    "k": (0.1, 200.0),
    "epsilon": (0.1, 200.0),
    "integral_weight": (1e-2, 1e6),
    "frequency": (0.3, 100.0),
    "damping": (0.2, 3.0),
    "bandwidth": (5.0, 500.0),
    "adaptation": (1e-3, 1e4),
    "kp": (0.1, 300.0),
    "ki": (1e-2, 1e3),
    "kd": (1e-3, 30.0),
    "filter": (5e-4, 0.1),
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
    studied = chosen_laws(experiment.changed(loop=None), names)
    named = _by_law(written, [law.name for law in studied])
    return [_tunable_law(experiment, law, named.get(law.name, {})) for law in studied]


class _Ends(NamedTuple):
    """Ends of a range, as they are typed."""

    low: str
    high: str


def _by_law(written: Sequence[str], laws: Sequence[str]) -> dict[str, dict[str, _Ends | None]]:
    """Return the numbers that are named, by law and path, each with the ends of its range."""
    named: dict[str, dict[str, _Ends | None]] = {}
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
        ends = _Ends(match["low"], match["high"]) if match["low"] else None
        named.setdefault(law, {})[path.removeprefix(f"{law}.")] = ends
    return named


def _tunable_law(
    experiment: Experiment, law: StudiedLaw, named: Mapping[str, _Ends | None]
) -> TunableLaw:
    """Return a law with the numbers that are named, or else with those that are declared."""
    table = _table(experiment, law)
    paths = list(named) or list(_paths(table, law))
    if not paths:
        raise ArgumentError(
            f"law {law.name} has no number to tune: name one by --number laws.{law.name}..."
        )
    if table["law"] == "pid" and {*paths} & {*_PID_GAINS}:
        _give_gains(table, law)
    if any(path.startswith("Q[") for path in paths):
        table.setdefault("Q", experiment.file.task.Q)

    base = f"{law.name}, tuned"
    case = _with_law(experiment, law, base, table)
    numbers = [_tuned_number(case, base, law, path, named.get(path)) for path in paths]
    return TunableLaw(law, case, base, tuple(numbers))


def _table(experiment: Experiment, law: StudiedLaw) -> Content:
    """Return the table of a law, with all its numbers."""
    table = experiment.file.law(law.base).model_dump(exclude_unset=True)
    table.pop("name", None)
    table.update(law.sampled)
    if law.predict:
        table["predict"] = True
    return table


def _give_gains(table: Content, law: StudiedLaw) -> None:
    """Give the table of a PID the gains that it has come to another way."""
    for key in _INSTEAD_OF_GAINS:
        if table.pop(key, None) is not None:
            gains = {gain: getattr(law.controller.parameters, gain) for gain in _PID_GAINS}
            table.update({gain: float(np.ravel(value)[0]) for gain, value in gains.items()})


def _with_law(experiment: Experiment, law: StudiedLaw, base: str, table: Content) -> Experiment:
    """Return an experiment with a law as its only controller, in a table of its own."""
    content = experiment.file.content
    content = {
        **content,
        "laws": {**content.get("laws", {}), base: table},
        "controller": [{"name": law.name, "law": base}],
    }
    return replace(experiment, file=case_file_of(content, experiment.path), chosen=())


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
        if key in _RANGES and is_number(value):
            yield key
    uncertainty = table.get("uncertainty")
    if isinstance(uncertainty, dict):
        for index, value in enumerate(uncertainty.get("wrench", ())):
            if value:
                yield f"uncertainty.wrench[{index + 1}]"
        if "reaching_rate" in uncertainty:
            yield "uncertainty.reaching_rate"


def _tuned_number(
    case: Experiment, base: str, law: StudiedLaw, path: str, ends: _Ends | None
) -> TunedNumber:
    """Return a number with its range.

    Args:
        case: Experiment with the law as its only controller.
        base: Name of its table.
        law: The law.
        path: Path of the number in the table.
        ends: Ends of the range; None for the usual range.
    """
    shown = f"laws.{law.name}.{path}"
    try:
        number = Number.of(case, f"laws.{base}.{path}")
    except ArgumentError as error:
        raise ArgumentError(str(error).replace(f"laws.{base}.{path}", shown)) from None
    with placed(f"{shown}: "):
        start = number.get(case)
        if ends is not None:
            low, high = (_typed(end, number.unit) for end in ends)
            if not low < high:
                raise ArgumentError(f"the range {ends.low}..{ends.high} must rise")
            return TunedNumber(path, number, start, low, high, logarithmic=low > 0)

        usual = _RANGES.get(path.partition("[")[0])
        if usual is None and not start > 0:
            raise ArgumentError(f"it is {start:g}, so it needs a range: {shown}=LOW..HIGH")
        low, high = usual or (start / _SPREAD, start * _SPREAD)
        return TunedNumber(path, number, start, low, high).including_start()


def _typed(text: str, unit: str) -> float:
    """Return an end of a range; as in a file, its unit may be left out."""
    try:
        return si_number(float(text), unit)
    except ValueError:
        return si_number(text, unit)
