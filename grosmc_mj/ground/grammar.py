"""Reader of formulas: names, numbers with units, functions, and operators by their strength.

A text becomes a tree of nodes, whose meaning others give it: nothing in it is executed, and nothing
is computed. Names may have blanks, which is why this is no grammar of Python's.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from grosmc_mj.ground.errors import ArgumentError, value_text

# Characters of a formula, and the depth of its brackets and words.
_LONGEST = 1000
_DEEPEST = 40
_NUMBER = r"(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"


class Node(NamedTuple):
    """Part of a formula.

    Attributes:
        kind: ``comparison`` of two parts or more with a sign between each two, or another kind.
        text: The number, the name, the function or the operator; the signs of a comparison, apart.
        parts: What it is applied to.
        unit: Unit of a number; empty without one.
        interval: Both ends of an interval behind an operator; empty without one.
    """

    kind: Literal["number", "name", "call", "prefix", "operator", "comparison"]
    text: str
    parts: tuple[Node, ...] = ()
    unit: str = ""
    interval: tuple[Node, ...] = ()


@dataclass(frozen=True)
class Grammar:
    """Words and signs of a kind of formulas.

    Attributes:
        names: Names of its quantities; a longer one comes before a part of it.
        functions: Functions, with their arguments in brackets.
        operators: Strength of each operator between two parts.
        prefixes: Strength of each operator before a part.
        comparisons: Operators that may stand in a row, as in ``0 < x < 1``.
        from_right: Operators that are read from the right.
        with_interval: Operators that may have an interval ``[0 s, 5 s]`` behind them.
        units: Regular expression of a unit behind a number, with the space between them.
    """

    names: Sequence[str]
    functions: Sequence[str]
    operators: Mapping[str, int]
    prefixes: Mapping[str, int]
    units: str
    comparisons: Sequence[str] = ()
    from_right: Sequence[str] = ()
    with_interval: Sequence[str] = ()

    @property
    def _words(self) -> list[str]:
        """Operators that are words, in the order of their strength."""
        return [word for word in dict.fromkeys([*self.prefixes, *self.operators]) if word.isalpha()]

    @property
    def valid(self) -> str:
        """Names, operators and functions of a formula, for messages."""
        return f"{', '.join((*self.names, *self._words, *self.functions))} and numbers"

    def read(self, text: str) -> Node:
        """Return the tree of a text.

        Raises:
            ArgumentError: If it is no formula; the message goes on after the text.
        """
        return _Reader(self, self._tokens(text)).whole()

    def names_in(self, text: str) -> frozenset[str]:
        """Return the names in a text; raises as ``read`` for what is no word, sign or number."""
        return frozenset(token.text for token in self._tokens(text) if token.kind == "name")

    def _tokens(self, text: str) -> list[_Token]:
        """Split a text."""
        if len(text) > _LONGEST:
            raise ArgumentError(f"has {len(text)} characters, a formula may have {_LONGEST}")
        pattern = self._pattern()
        tokens = []
        end = len(text.rstrip())
        place = 0
        while place < end:
            match = pattern.match(text, place)
            if match is None:
                rest = text[place:].lstrip()
                unknown = re.findall(r"\w+|[^\w\s]+", rest)[0]
                raise ArgumentError(
                    f"has {value_text(unknown)} at character {text.find(rest) + 1}, "
                    f"may have {self.valid}"
                )
            tokens.append(self._token(match))
            place = match.end()
        return tokens

    def _pattern(self) -> re.Pattern[str]:
        """Return the pattern of a token; the longest words first."""
        words = {*self.names, *self._words, *self.functions}
        names = "|".join(map(re.escape, sorted(words, key=len, reverse=True)))
        signs = {"(", ")", ",", *self.operators, *self.prefixes} - set(self._words)
        if self.with_interval:
            signs |= {"[", "]"}
        sign = "|".join(map(re.escape, sorted(signs, key=len, reverse=True)))
        return re.compile(
            rf"\s*(?:(?P<number>{_NUMBER})(?P<unit>{self.units})?(?![\w.])"
            rf"|(?P<name>{names})(?!\w)|(?P<sign>{sign}))"
        )

    def _token(self, match: re.Match[str]) -> _Token:
        """Return the token of a match."""
        place = match.end() - len(match[0].lstrip()) + 1
        if match["number"]:
            return _Token("number", match["number"], place, (match["unit"] or "").strip())
        text = match["name"] or match["sign"]
        kind = "name" if text in self.names else "word"
        return _Token(kind, text, place)


class _Token(NamedTuple):
    """A number, a name, or a word or sign that is no name; its first character's place from 1."""

    kind: Literal["number", "name", "word", "end"]
    text: str
    place: int
    unit: str = ""

    def __str__(self) -> str:
        """Write it for messages."""
        return f"{self.text!r} at character {self.place}" if self.text else "nothing"


class _Reader:
    """Reader of the tokens of one formula."""

    def __init__(self, grammar: Grammar, tokens: Sequence[_Token]) -> None:
        self._grammar = grammar
        self._tokens = [*tokens, _Token("end", "", 0)]
        self._place = 0
        self._depth = 0

    @property
    def _next(self) -> str:
        """The next word or sign; empty for a name, a number and the end."""
        token = self._tokens[self._place]
        return token.text if token.kind == "word" else ""

    def _take(self) -> _Token:
        """Return the next token, and go on behind it."""
        token = self._tokens[self._place]
        self._place += token.kind != "end"
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

    def whole(self) -> Node:
        """Read all of the formula."""
        node = self._part(0)
        last = self._tokens[self._place]
        if last.kind != "end":
            raise ArgumentError(f"has {last} after a whole formula")
        return node

    def _part(self, strength: int) -> Node:
        """Read up to an operator that does not bind more strongly than ``strength``."""
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ArgumentError(f"is nested more than {_DEEPEST} deep")
        left = self._operand()
        while self._grammar.operators.get(self._next, 0) > strength:
            left = self._joined(left)
        self._depth -= 1
        return left

    def _operand(self) -> Node:
        """Read a number, a name, a bracket, or what stands behind a function or a prefix."""
        token = self._take()
        if token.kind == "number":
            return Node("number", token.text, unit=token.unit)
        if token.kind == "name":
            return Node("name", token.text)
        if token.text in self._grammar.functions:
            return Node("call", token.text, self._arguments())
        if token.text in self._grammar.prefixes:
            interval = self._interval(token.text)
            part = self._part(self._grammar.prefixes[token.text])
            return Node("prefix", token.text, (part,), interval=interval)
        if token.text == "(":
            inner = self._part(0)
            self._require(")")
            return inner
        raise ArgumentError(f"has {token} where a quantity must be")

    def _arguments(self) -> tuple[Node, ...]:
        """Read the arguments of a function in their brackets."""
        self._require("(")
        arguments = [self._part(0)]
        while self._takes(","):
            arguments.append(self._part(0))
        self._require(")")
        return tuple(arguments)

    def _joined(self, left: Node) -> Node:
        """Read an operator and the part behind it; join them with the part before."""
        operator = self._take().text
        strength = self._grammar.operators[operator]
        if operator in self._grammar.comparisons:
            return self._comparison(left, operator, strength)
        interval = self._interval(operator)
        if operator in self._grammar.from_right:
            strength -= 1
        return Node("operator", operator, (left, self._part(strength)), interval=interval)

    def _comparison(self, left: Node, sign: str, strength: int) -> Node:
        """Read all that is compared in a row."""
        parts = [left, self._part(strength)]
        signs = [sign]
        while self._next in self._grammar.comparisons:
            signs.append(self._take().text)
            parts.append(self._part(strength))
        return Node("comparison", " ".join(signs), tuple(parts))

    def _interval(self, operator: str) -> tuple[Node, ...]:
        """Read ``[0 s, 5 s]`` behind an operator; nothing without one."""
        if operator not in self._grammar.with_interval or not self._takes("["):
            return ()
        begin = self._operand()
        self._require(",")
        end = self._operand()
        self._require("]")
        return begin, end
