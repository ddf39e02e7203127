"""Text of temporal formulas, read by the strength of its operators and never executed."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from grosmc_mj.experiments.requirements.expressions import (
    FUNCTIONS,
    Applied,
    Expression,
    Number,
    SignalValue,
    applied,
    combined,
    common_unit,
)
from grosmc_mj.experiments.requirements.temporal import Comparison, Formula, Operation
from grosmc_mj.ground.errors import ArgumentError, value_text
from grosmc_mj.ground.units import Unit, unit_pattern

_LONGEST = 1000
_DEEPEST = 40
_WORDS = ("always", "eventually", "until", "not", "and", "or", "implies")
_COMPARED = ("<", "<=", ">", ">=")
# How strongly operators between two parts bind, and ``not``, ``always`` and ``eventually``, and a
# sign before one.
_STRENGTHS = {
    "implies": 1,
    "or": 2,
    "and": 3,
    "until": 4,
    **dict.fromkeys(_COMPARED, 6),
    "+": 7,
    "-": 7,
    "*": 8,
    "/": 8,
}
_OF_WORD = 5
_OF_SIGN = 9


class Specification(NamedTuple):
    """A formula that was read.

    Attributes:
        formula: The formula.
        unit: Unit of its margins; ``1`` where comparisons have different units, each of which
            is in parts of its constant then.
        number: The smallest constant that something is compared with, in that unit; 1 for none.
        signals: Names of the signals in it.
    """

    formula: Formula
    unit: str
    number: float
    signals: frozenset[str]


class _Token(NamedTuple):
    """A word, a sign or a quantity."""

    text: str
    quantity: Expression | None = None


def read_formula(text: str, units: Mapping[str, str]) -> Specification:
    """Return the formula that a text describes.

    Args:
        text: ``always``, ``eventually`` and ``until``, each with an interval such as ``[0 s, 5 s]``
            or without, ``not``, ``and``, ``or``, ``implies``, brackets, and comparisons of
            arithmetic over signals and numbers with units.
        units: Units of the signals, by name.

    Raises:
        ArgumentError: If it has something else, or units that do not fit.
    """
    try:
        reader = _Reader(_tokens(text, units))
        formula = _formula(reader.part())
        reader.require_end()
        return _with_scales(formula, units)
    except ArgumentError as error:
        raise ArgumentError(f"{value_text(text)} {error}") from None


def signals_in(text: str, units: Mapping[str, str]) -> frozenset[str]:
    """Return the names of the signals in a text; raises as ``read_formula``, units apart."""
    quantities = [token.quantity for token in _tokens(text, units)]
    return frozenset().union(*(quantity.signals for quantity in quantities if quantity))


def _tokens(text: str, units: Mapping[str, str]) -> list[_Token]:
    """Split a text; the longest names first, since a name may be a part of another one."""
    if len(text) > _LONGEST:
        raise ArgumentError(f"has {len(text)} characters, may have {_LONGEST}")
    names = sorted([*units, *_WORDS, *FUNCTIONS], key=len, reverse=True)
    pattern = re.compile(
        rf"\s*(?:(?P<number>\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)(?:\s*(?P<unit>{unit_pattern(*units.values())}))?"
        rf"(?![\w.])|(?P<name>{'|'.join(map(re.escape, names))})(?!\w)"
        r"|(?P<sign><=|>=|[-+*/()<>,\[\]]))"
    )

    tokens: list[_Token] = []
    end = len(text.rstrip())
    place = 0
    while place < end:
        match = pattern.match(text, place)
        if match is None:
            unknown = re.findall(r"\w+|[^\w\s]+", text[place:])[0]
            raise ArgumentError(
                f"has {value_text(unknown)}, may have {', '.join(units)}, {', '.join(_WORDS)}, "
                f"{', '.join(FUNCTIONS)} and numbers with units"
            )
        tokens.append(_token(match, units))
        place = match.end()
    return tokens


def _token(match: re.Match[str], units: Mapping[str, str]) -> _Token:
    """Return the token of a match."""
    text = match[0].strip()
    if match["number"]:
        return _Token(text, Number.of(float(match["number"]), match["unit"] or ""))
    if match["name"] in units:
        return _Token(text, SignalValue(Unit.of(units[match["name"]]), match["name"]))
    return _Token(text)


class _Reader:
    """Reader of formulas and of the quantities in them."""

    def __init__(self, tokens: Sequence[_Token]) -> None:
        self._tokens = [*tokens, _Token("")]
        self._place = 0
        self._depth = 0

    @property
    def _next(self) -> str:
        """The next token, empty at the end."""
        return self._tokens[self._place].text

    def _take(self) -> _Token:
        """Return the next token, and go on behind it."""
        token = self._tokens[self._place]
        if token.text:
            self._place += 1
        return token

    def _takes(self, text: str) -> bool:
        """Whether the next token is this one, which is taken then."""
        taken = self._next == text
        self._place += taken
        return taken

    def _require(self, text: str) -> None:
        """Take a token that must be there."""
        if not self._takes(text):
            raise ArgumentError(f"has no {text!r} where one must be")

    def require_end(self) -> None:
        """Refuse further tokens."""
        if self._next:
            raise ArgumentError(f"has {self._next!r} after a whole formula")

    def part(self, strength: int = 0) -> Formula | Expression:
        """Read up to an operator that does not bind more strongly than ``strength``."""
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ArgumentError(f"is nested more than {_DEEPEST} deep")

        left = self._operand()
        while _STRENGTHS.get(self._next, 0) > strength:
            left = self._joined(left, self._take().text)
        self._depth -= 1
        return left

    def _operand(self) -> Formula | Expression:
        """Read a quantity, a bracket, or what stands behind a word or a sign."""
        token = self._take()
        if token.quantity is not None:
            return token.quantity
        if token.text == "(":
            inner = self.part()
            self._require(")")
            return inner
        if token.text == "-":
            quantity = _quantity(self.part(_OF_SIGN))
            return Applied(quantity.unit, np.negative, (quantity,))
        if token.text == "not":
            return Operation("not", (_formula(self.part(_OF_WORD)),))
        if token.text in ("always", "eventually"):
            interval = self._interval()
            return Operation(token.text, (_formula(self.part(_OF_WORD)),), *interval)
        if token.text in FUNCTIONS:
            return applied(token.text, self._arguments())
        found = repr(token.text) if token.text else "nothing"
        raise ArgumentError(f"has {found} where a quantity must be")

    def _arguments(self) -> list[Expression]:
        """Read the arguments of a function in their brackets."""
        self._require("(")
        arguments = [_quantity(self.part())]
        while self._takes(","):
            arguments.append(_quantity(self.part()))
        self._require(")")
        return arguments

    def _joined(self, left: Formula | Expression, operator: str) -> Formula | Expression:
        """Read the part behind an operator, and join it with the part before it."""
        strength = _STRENGTHS[operator]
        if operator in _COMPARED:
            return self._comparisons(_quantity(left), operator)
        if operator == "implies":
            # It is read from the right: p implies (q implies r).
            fails = Operation("not", (_formula(left),))
            return Operation("or", (fails, _formula(self.part(strength - 1))))
        interval = self._interval() if operator == "until" else ()
        right = self.part(strength)
        if operator in _WORDS:
            return Operation(operator, (_formula(left), _formula(right)), *interval)
        return combined(operator, _quantity(left), _quantity(right))

    def _comparisons(self, left: Expression, sign: str) -> Formula:
        """Read what is compared with a quantity; ``0 < x < 1`` has two comparisons."""
        right = _quantity(self.part(_STRENGTHS[sign]))
        common_unit("compares", left, right)
        formula = Comparison(left, right)
        if ">" in sign:
            formula = Comparison(right, left)
        if self._next not in _COMPARED:
            return formula
        return Operation("and", (formula, self._comparisons(right, self._take().text)))

    def _interval(self) -> tuple[float, ...]:
        """Read ``[0 s, 5 s]``; nothing without one."""
        if not self._takes("["):
            return ()
        begin = self._time()
        self._require(",")
        end = self._time()
        self._require("]")
        if end < begin:
            raise ArgumentError(f"has an interval from {begin:g} s to {end:g} s")
        return begin, end

    def _time(self) -> float:
        """Read a time [s]."""
        quantity = self._take().quantity
        if isinstance(quantity, Number) and str(quantity.unit or "s") == "s":
            return quantity.value
        raise ArgumentError("has an interval that is none of times, such as [0 s, 50 ms]")


def _formula(part: Formula | Expression) -> Formula:
    """Return a part that must be a formula."""
    if isinstance(part, Formula):
        return part
    raise ArgumentError("has no comparison (<, <=, >, >=) where one must be")


def _quantity(part: Formula | Expression) -> Expression:
    """Return a part that must be a quantity."""
    if isinstance(part, Expression):
        return part
    raise ArgumentError("has a formula where a quantity must be")


def _with_scales(formula: Formula, units: Mapping[str, str]) -> Specification:
    """Give margins one unit: that of all comparisons, or parts of their constants."""
    comparisons = list(formula.comparisons())
    signals: frozenset[str] = frozenset()
    base_units = set()
    for item in comparisons:
        signals |= item.less.signals | item.more.signals
        unit = item.more.unit or item.less.unit or Unit()
        base_units.add(Unit(1.0, unit.powers))
    if not signals:
        raise ArgumentError("has no signal in it")

    if len(base_units) > 1:
        for item in comparisons:
            if item.limit is None:
                raise ArgumentError(
                    "compares quantities of different units: then each must be compared with a "
                    "number other than 0, of which its margin is a part"
                )
        return Specification(formula.scaled(), "1", 1.0, signals)

    (unit,) = base_units
    written = str(unit)
    for name in units.values():
        if Unit.of(name) == unit:
            written = name
            break
    limits = [item.limit for item in comparisons if item.limit is not None]
    return Specification(formula, written, min(limits, default=1.0), signals)
