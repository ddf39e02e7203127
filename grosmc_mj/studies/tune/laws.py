"""Laws of a target with the numbers that are tuned: those declared, or those named."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import Content
from grosmc_mj.experiments.file.reading import case_file_of
from grosmc_mj.experiments.file.user_code import is_named
from grosmc_mj.experiments.law_numbers import tunable_numbers
from grosmc_mj.experiments.number import Number
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, placed, value_text
from grosmc_mj.ground.units import is_number, si_number
from grosmc_mj.studies.target import StudiedLaw, chosen_laws
from grosmc_mj.studies.tune.numbers import TunableLaw, TunedNumber
from grosmc_mj.theory.control.law_number import LawNumber

# A number of a law with its range, laws.NAME.PATH=LOW..HIGH; the range may be missing.
_WRITTEN = re.compile(r"(?P<path>[^=]+)(?:=(?P<low>.+?)\.\.(?P<high>.+))?")
_FORM = "laws.NAME.NUMBER=LOW..HIGH, such as laws.lqr.Q[1]=1..1e5"
# Range of a number of which nothing is declared: so many times less and more than in the file.
_SPREAD = 100.0
# Numbers that are tuned only if the file gives them: most laws do without.
_LEFT_ALONE = ("setpoint_weight", "rate_setpoint_weight", "tracking_time")
# Gains of switching laws that read no epsilon.
_OWN_GAINS = ("slope", "least")
# Way to the gains of a PID that is no number.
_TUNE = "tune"


def tunable_laws(
    experiment: Experiment, names: Sequence[str], written: Sequence[str] = ()
) -> list[TunableLaw]:
    """Return laws with the numbers that are tuned.

    Args:
        experiment: Experiment of the target.
        names: Names of the laws, as in the other studies.
        written: Numbers and their ranges, ``laws.NAME.NUMBER=LOW..HIGH``; those of a law replace
            the declared ones. With one law numbers of the case's estimators, too.

    Raises:
        ArgumentError: If there is no such law or number, or a range cannot be.
    """
    studied = [
        # Requirements are asked of a law by its name: all its designs have one.
        replace(law, controller=replace(law.controller, name=law.name))
        for law in chosen_laws(experiment.changed(loop=None), names)
    ]
    named = _Named.read(written, [law.name for law in studied])
    if named.of_case and len(studied) > 1:
        raise ArgumentError(
            f"{next(iter(named.of_case))} is one for all laws: tune one --law with it"
        )
    return [_tunable_law(experiment, law, named) for law in studied]


class _Ends(NamedTuple):
    """Ends of a range, as they are typed."""

    low: str
    high: str


# Ends of ranges by path; None for the usual range.
_Ranges = dict[str, _Ends | None]


class _Named(NamedTuple):
    """Numbers that are named: of laws, by name, and of the case."""

    of_laws: dict[str, _Ranges]
    of_case: _Ranges

    @classmethod
    def read(cls, written: Sequence[str], laws: Sequence[str]) -> _Named:
        """Return the numbers in some texts.

        Args:
            written: The texts, PATH or PATH=LOW..HIGH.
            laws: Names of the laws that are tuned.

        Raises:
            ArgumentError: If one has another form, or is of another law.
        """
        named = cls({}, {})
        for text in written:
            match = _WRITTEN.fullmatch(text)
            path = match["path"].strip() if match else ""
            if match is None or not path.startswith(("laws.", "estimator.")):
                raise ArgumentError(f"--number {value_text(text)} must be {_FORM}")

            ends = _Ends(match["low"], match["high"]) if match["low"] else None
            if path.startswith("estimator."):
                named.of_case[path] = ends
                continue
            path = path.removeprefix("laws.")
            owners = [law for law in laws if path.startswith(f"{law}.")]
            if not owners:
                require_known("law", path.partition(".")[0], laws, f"--number {text}: ")
                raise ArgumentError(f"--number {value_text(text)} must be {_FORM}")
            law = max(owners, key=len)
            named.of_laws.setdefault(law, {})[path.removeprefix(f"{law}.")] = ends
        return named


def _tunable_law(experiment: Experiment, law: StudiedLaw, named: _Named) -> TunableLaw:
    """Return a law with the numbers that are named, or else with those that are declared."""
    base = f"{law.name}, tuned"
    ranges = named.of_laws.get(law.name, {})
    case = _with_law(experiment, law, base, _table(experiment, law, ranges))
    declared = tunable_numbers(case, law.name)
    if not ranges:
        ranges = dict.fromkeys(_usual(case, law, declared))

    numbers = []
    for path, ends in ranges.items():
        shown = f"laws.{law.name}.{path}"
        number = _number(case, f"laws.{base}.{path}", shown)
        with placed(f"{shown}: "):
            numbers.append(_ranged(case, path, number, declared.get(_key(path)), ends))
    for path, ends in named.of_case.items():
        number = Number.of(case, path)
        with placed(f"{path}: "):
            numbers.append(_ranged(case, path, number, None, ends))
    if not numbers:
        raise ArgumentError(
            f"law {law.name} has no number to tune: name one by --number laws.{law.name}..."
        )
    return TunableLaw(law, case, base, tuple(numbers))


def _number(case: Experiment, path: str, shown: str) -> Number:
    """Return the number at a path, which an error shows in another way."""
    try:
        return Number.of(case, path)
    except ArgumentError as error:
        raise ArgumentError(str(error).replace(path, shown)) from None


def _key(path: str) -> str:
    """Return the key in the table of a law that a path begins with."""
    return re.split(r"[.\[]", path)[0]


def _table(experiment: Experiment, law: StudiedLaw, named: Iterable[str]) -> Content:
    """Return the table of a law with all its numbers, Q and R too."""
    table = experiment.file.law(law.base).model_dump(exclude_unset=True)
    table.pop("name", None)
    table.update(law.sampled)
    if law.predict:
        table["predict"] = True
    for weight in ("Q", "R"):
        value = getattr(experiment.file.task, weight)
        if value is not None and not is_named(table["law"]):
            table.setdefault(weight, value)

    # Gains are tuned in the place of what they are computed from.
    keys = {_key(path) for path in named}
    for way in (_TUNE, "frequency"):
        if table["law"] == "pid" and way in table and (way == _TUNE or {"kp", "ki", "kd"} & keys):
            del table[way]
            for gain in ("kp", "ki", "kd"):
                table[gain] = _plain(getattr(law.controller.parameters, gain))
    return table


def _plain(gain: Array) -> float | list[float]:
    """Return a gain as a file has it: one number, or one for each output."""
    entries = np.ravel(gain).tolist()
    return entries[0] if len(entries) == 1 else entries


def _with_law(experiment: Experiment, law: StudiedLaw, base: str, table: Content) -> Experiment:
    """Return an experiment with a law as its only controller, in a table of its own."""
    content = experiment.file.content
    content = {
        **content,
        "laws": {**content.get("laws", {}), base: table},
        "controller": [{"name": law.name, "law": base}],
    }
    return replace(experiment, file=case_file_of(content, experiment.path), chosen=())


def _usual(case: Experiment, law: StudiedLaw, declared: Mapping[str, LawNumber]) -> Iterator[str]:
    """Yield the paths of the numbers of a law that are tuned if none are named."""
    table = case.file.law(law.name).numbers
    if not declared:
        for key, value in table.items():
            if is_number(value):
                yield key
        return

    redundant = _redundant(table, declared)
    for key in declared:
        given = table.get(key)
        if key in ("Q", "R"):
            # Only ratios of weights count: the first input's stays.
            size = len(getattr(law.controller.designed.lqr, key))
            first = 1 if key == "Q" else 2
            yield from (f"{key}[{entry}]" for entry in range(first, size + 1))
        elif isinstance(given, list):
            yield from (f"{key}[{entry}]" for entry in range(1, len(given) + 1))
        elif key in redundant:
            continue
        elif given is not None or key not in _LEFT_ALONE:
            yield key


def _redundant(table: Mapping[str, Any], declared: Mapping[str, LawNumber]) -> set[str]:
    """Keys of gains that others make up for, or that the switching law does not read."""
    if any(key in declared for key in _OWN_GAINS):
        return {"gain", "epsilon"}
    return {"gain"} if "epsilon" in table else set()


def _ranged(
    case: Experiment,
    name: str,
    number: Number,
    declared: LawNumber | None,
    ends: _Ends | None,
) -> TunedNumber:
    """Return a number with its range.

    Args:
        case: Experiment with the law as its only controller.
        name: Name of the number.
        number: The number.
        declared: Declaration of the number; None for a law of one's own and for an estimator.
        ends: Ends of the range; None for the usual range.
    """
    start = number.get(case)
    if ends is not None:
        low, high = (_typed(end, number.unit) for end in ends)
        if not low < high:
            raise ArgumentError(f"the range {ends.low}..{ends.high} must rise")
        return TunedNumber(name, number, start, low, high, logarithmic=low > 0)

    low, high = _usual_range(declared, abs(start))
    if declared is not None and not declared.log:
        return TunedNumber(name, number, start, low, high, logarithmic=False)
    if start < 0:
        low, high = -high, -low
    return TunedNumber(name, number, start, low, high).including_start()


def _usual_range(declared: LawNumber | None, size: float) -> tuple[float, float]:
    """Return the range of a number that has none.

    Args:
        declared: Its declaration; None if there is none.
        size: Its size in the file.
    """
    factors = (1 / _SPREAD, _SPREAD)
    if declared is not None and declared.search is not None:
        if not declared.relative:
            return declared.search
        factors = declared.search
        # A weight that is zero in the file may be any.
        size = size or 1.0
    if not size > 0:
        raise ArgumentError("it is 0, so it needs a range: write NUMBER=LOW..HIGH")
    return factors[0] * size, factors[1] * size


def _typed(text: str, unit: str) -> float:
    """Return an end of a range; as in a file, its unit may be left out."""
    try:
        return si_number(float(text), unit)
    except ValueError:
        return si_number(text, unit)
