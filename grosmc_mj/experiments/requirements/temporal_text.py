"""Text of temporal formulas: its grammar, and the formula that a tree of it describes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from grosmc_mj.experiments.requirements.expressions import (
    FUNCTIONS,
    Applied,
    ConstantValue,
    Expression,
    SignalValue,
    applied,
    combined,
    common_unit,
)
from grosmc_mj.experiments.requirements.temporal import Formula, Inequality, Operation
from grosmc_mj.ground.errors import ArgumentError, value_text
from grosmc_mj.ground.grammar import Grammar, Node
from grosmc_mj.ground.units import Unit, unit_pattern
from grosmc_mj.ground.wording import unit_after

_COMPARED = ("<", "<=", ">", ">=")
_LOGICAL = ("not", "always", "eventually", "or", "and", "until")
# How strongly operators between two parts bind.
_OPERATORS = {
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
_PREFIXES = {"always": 5, "eventually": 5, "not": 5, "-": 9}


class TemporalSpecification(NamedTuple):
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


def read_formula(text: str, units: Mapping[str, str]) -> TemporalSpecification:
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
        tree = _grammar(units).read(text)
        formula = _Meaning(units).formula(tree)
        _refuse_empty(formula)
        return _with_scales(formula, units)
    except ArgumentError as error:
        raise ArgumentError(f"{value_text(text)} {error}") from None


def signals_in(text: str, units: Mapping[str, str]) -> frozenset[str]:
    """Return the names of the signals in a text; raises as ``read_formula``, units apart."""
    return _grammar(units).names_in(text)


def _grammar(units: Mapping[str, str]) -> Grammar:
    """Return the grammar of formulas about signals."""
    return Grammar(
        names=list(units),
        functions=list(FUNCTIONS),
        operators=_OPERATORS,
        prefixes=_PREFIXES,
        comparisons=_COMPARED,
        # p implies (q implies r).
        from_right=("implies",),
        with_interval=("always", "eventually", "until"),
        units=rf"\s*{unit_pattern(*units.values())}",
    )


class _Meaning:
    """Formulas and quantities that trees describe.

    Args:
        units: Units of the signals, by name.
    """

    def __init__(self, units: Mapping[str, str]) -> None:
        self._units = units

    def formula(self, node: Node) -> Formula:
        """Return a tree that must be a formula."""
        match node:
            case Node(kind="comparison"):
                quantities = [self.quantity(part) for part in node.parts]
                return _comparisons(quantities, node.text.split())
            case Node(kind="operator", text="implies", parts=(left, right)):
                fails = Operation("not", (self.formula(left),))
                return Operation("or", (fails, self.formula(right)))
            case Node(text=text) if text in _LOGICAL:
                parts = tuple(self.formula(part) for part in node.parts)
                return Operation(text, parts, *self._interval(node))
        raise ArgumentError("has no comparison (<, <=, >, >=) where one must be")

    def quantity(self, node: Node) -> Expression:
        """Return a tree that must be a quantity."""
        match node:
            case Node(kind="number"):
                return ConstantValue.of(float(node.text), node.unit)
            case Node(kind="name", text=name):
                return SignalValue(Unit.of(self._units[name]), name)
            case Node(kind="prefix", text="-", parts=(part,)):
                quantity = self.quantity(part)
                return Applied(quantity.unit, np.negative, (quantity,))
            case Node(kind="call"):
                return applied(node.text, [self.quantity(part) for part in node.parts])
            case Node(kind="operator", text="+" | "-" | "*" | "/" as sign, parts=(left, right)):
                return combined(sign, self.quantity(left), self.quantity(right))
        raise ArgumentError("has a formula where a quantity must be")

    def _interval(self, node: Node) -> tuple[float, ...]:
        """Return the instants of an interval [s]; nothing without one."""
        if not node.interval:
            return ()
        begin, end = [_time(part) for part in node.interval]
        if end < begin:
            raise ArgumentError(f"has an interval from {begin:g} s to {end:g} s")
        return begin, end


def _comparisons(quantities: list[Expression], signs: list[str]) -> Formula:
    """Return what is compared with a quantity; ``0 < x < 1`` has two comparisons."""
    left, right, *_ = quantities
    sign, *more = signs
    common_unit("compares", left, right)
    formula = Inequality(left, right)
    if ">" in sign:
        formula = Inequality(right, left)
    if not more:
        return formula
    return Operation("and", (formula, _comparisons(quantities[1:], more)))


def _time(node: Node) -> float:
    """Return a time [s]."""
    if node.kind == "number":
        number = ConstantValue.of(float(node.text), node.unit)
        if str(number.unit or "s") == "s":
            return number.value
    raise ArgumentError("has an interval that is none of times, such as [0 s, 50 ms]")


def _refuse_empty(formula: Formula) -> None:
    """Refuse bounds of one quantity that no value is between."""
    if not isinstance(formula, Operation):
        return
    for part in formula.parts:
        _refuse_empty(part)
    bounds = formula.bounds
    if bounds is not None and bounds.above >= bounds.below:
        unit = unit_after(str(bounds.quantity.unit or ""))
        raise ArgumentError(
            f"keeps no value: none is above {bounds.above:g}{unit} and below {bounds.below:g}{unit}"
        )


def _with_scales(formula: Formula, units: Mapping[str, str]) -> TemporalSpecification:
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
        return TemporalSpecification(formula.scaled(), "1", 1.0, signals)

    (unit,) = base_units
    written = str(unit)
    for name in units.values():
        if Unit.of(name) == unit:
            written = name
            break
    limits = [item.limit for item in comparisons if item.limit is not None]
    return TemporalSpecification(formula, written, min(limits, default=1.0), signals)
