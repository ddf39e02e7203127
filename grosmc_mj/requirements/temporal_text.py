"""Text of temporal formulas: logic by its words, comparisons by ``expressions``."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from grosmc_mj.errors import ArgumentError, value_text
from grosmc_mj.requirements.expressions import (
    FUNCTIONS,
    Expression,
    Number,
    SignalValue,
    comparisons_in,
)
from grosmc_mj.requirements.temporal import (
    Always,
    And,
    Comparison,
    Eventually,
    Formula,
    Not,
    Or,
    Until,
)
from grosmc_mj.units import Unit, unit_pattern

_LONGEST = 1000
_DEEPEST = 40
_WORDS = ("always", "eventually", "until", "not", "and", "or", "implies")
_COMPARED = ("<", "<=", ">", ">=")


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
    """A word, a sign, or a quantity with the name that it has for Python's grammar."""

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
        formula = reader.implication()
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
        rf"\s*(?:(?P<number>\d+\.?\d*(?:[eE][+-]?\d+)?)(?:\s*(?P<unit>{unit_pattern(*units.values())}))?"
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
        tokens.append(_token(match, units, f"q{len(tokens)}"))
        place = match.end()
    return tokens


def _token(match: re.Match[str], units: Mapping[str, str], name: str) -> _Token:
    """Return the token of a match, with a name for Python's grammar if it is a quantity."""
    if match["number"]:
        return _Token(name, Number.of(float(match["number"]), match["unit"] or ""))
    if match["name"] in units:
        return _Token(name, SignalValue(Unit.of(units[match["name"]]), match["name"]))
    return _Token(match["name"] or match["sign"])


class _Reader:
    """Reader of formulas by recursive descent: ``implies`` binds least, then ``or`` and ``and``."""

    def __init__(self, tokens: Sequence[_Token]) -> None:
        self._tokens = tokens
        self._place = 0
        self._depth = 0

    def _next(self) -> str:
        """Return the next token, empty at the end."""
        if self._place == len(self._tokens):
            return ""
        return self._tokens[self._place].text

    def _takes(self, text: str) -> bool:
        """Whether the next token is this one, which is taken then."""
        taken = self._next() == text
        self._place += taken
        return taken

    def _require(self, text: str) -> None:
        """Take a token that must be there."""
        if not self._takes(text):
            raise ArgumentError(f"has no {text!r} where one must be")

    def require_end(self) -> None:
        """Refuse further tokens."""
        if self._next():
            raise ArgumentError(f"has {self._next()!r} after a whole formula")

    def implication(self) -> Formula:
        """Read ``p implies q``, which is not p or q."""
        left = self._alternatives()
        if self._takes("implies"):
            return Or(Not(left), self.implication())
        return left

    def _alternatives(self) -> Formula:
        """Read formulas with ``or`` between them."""
        formula = self._conjunction()
        while self._takes("or"):
            formula = Or(formula, self._conjunction())
        return formula

    def _conjunction(self) -> Formula:
        """Read formulas with ``and`` between them."""
        formula = self._until()
        while self._takes("and"):
            formula = And(formula, self._until())
        return formula

    def _until(self) -> Formula:
        """Read ``p until q``."""
        before = self._unary()
        if not self._takes("until"):
            return before
        interval = self._interval()
        return Until(self._unary(), *interval, before=before)

    def _unary(self) -> Formula:
        """Read what ``not``, ``always`` or ``eventually`` stands before, or a comparison."""
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ArgumentError(f"is nested more than {_DEEPEST} deep")
        formula = self._operand()
        self._depth -= 1
        return formula

    def _operand(self) -> Formula:
        """Read a formula that no two-sided word divides."""
        if self._takes("not"):
            return Not(self._unary())
        if self._takes("always"):
            interval = self._interval()
            return Always(self._unary(), *interval)
        if self._takes("eventually"):
            interval = self._interval()
            return Eventually(self._unary(), *interval)
        if self._opens_formula():
            self._require("(")
            formula = self.implication()
            self._require(")")
            return formula
        return self._comparison()

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
        quantity = None
        if self._place < len(self._tokens):
            quantity = self._tokens[self._place].quantity
        self._place += 1
        if isinstance(quantity, Number) and str(quantity.unit or "s") == "s":
            return quantity.value
        raise ArgumentError("has an interval that is none of times, such as [0 s, 50 ms]")

    def _opens_formula(self) -> bool:
        """Whether a bracket is next that has a formula in it, not arithmetic."""
        depth = 0
        for token in self._tokens[self._place :]:
            depth += (token.text == "(") - (token.text == ")")
            if depth <= 0:
                return False
            if token.text in _COMPARED or token.text in _WORDS:
                return True
        return False

    def _comparison(self) -> Formula:
        """Read comparisons, up to a word or a bracket of the formula around them."""
        quantities = {}
        source = []
        depth = 0
        while text := self._next():
            depth += (text in "([") - (text in ")]")
            if depth < 0 or (depth == 0 and text in _WORDS):
                break
            token = self._tokens[self._place]
            if token.quantity is not None:
                quantities[text] = token.quantity
            source.append(text)
            self._place += 1

        formula = None
        for sign, left, right in comparisons_in(" ".join(source), quantities):
            if isinstance(sign, ast.Gt | ast.GtE):
                left, right = right, left
            compared = Comparison(left, right)
            formula = compared if formula is None else And(formula, compared)
        assert formula is not None
        return formula


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
        return Specification(_scaled(formula), "1", 1.0, signals)

    (unit,) = base_units
    written = str(unit)
    for name in units.values():
        if Unit.of(name) == unit:
            written = name
            break
    limits = [item.limit for item in comparisons if item.limit is not None]
    return Specification(formula, written, min(limits, default=1.0), signals)


def _scaled(formula: Formula) -> Formula:
    """Return a formula whose margins are parts of the constants that are compared with."""
    if isinstance(formula, Comparison):
        assert formula.limit is not None
        return replace(formula, scale=formula.limit)
    changed = {}
    for name, part in vars(formula).items():
        if isinstance(part, Formula):
            changed[name] = _scaled(part)
    return replace(formula, **changed)
