"""Small laws made at random from a seed, in the Python that can be exported."""

from __future__ import annotations

import random

# Expressions that are numbers, made of smaller ones: {a}, {b}, {c}; {k} is a whole number.
_NUMBERS = [
    "({a} + {b})",
    "({a} - {b})",
    "{a} - ({b} - {c})",
    "({a} * {b})",
    "{a} / (1.5 + abs({b}))",
    "-{a}",
    "-(-{a})",
    "({a}) ** 2",
    "2.0 ** min({a}, 3.0)",
    "10.0 ** max(-3.0, min({a}, 3.0))",
    "abs({a}) ** 0.5",
    "({a} or {b})",
    "({a} and {b})",
    "({a} or {b} or {c})",
    "({a} and {b} or {c})",
    "({a} or 3.0)",
    "(0.0 or {a})",
    "({a} and {d})",
    "(not {a})",
    "bool({a})",
    "({d} or {a})",
    "({a} if {d} else {b})",
    "({a} if {b} else {c})",
    "min({a}, {b})",
    "max({a}, {b}, {c})",
    "abs({a})",
    "math.sin({a})",
    "math.fmod({a}, 0.7)",
    "math.copysign({a}, {b})",
    "np.sign({a})",
    "float({k})",
    "{k}",
    "twice({a})",
    "clipped({a}, {b})",
    "memory.past[({k}) % 4]",
    "first(memory.past[1:][{s}:])",
    "first(memory.past[:-1])",
    "x[({k}) & 1]",
]
_CONDITIONS = [
    "{a} < {b}",
    "{a} >= {b}",
    "{a} < {b} < {c}",
    "{a} == {b}",
    "{k} != {m}",
    "({d} and {e})",
    "({d} or {e})",
    "not ({d})",
    "({a} or {d})",
    "{k} > 0",
    "({d}) == ({e})",
]
_WHOLE = [
    "int({a})",
    "math.floor({a})",
    "math.ceil({a})",
    "({k} + {m})",
    "({k} - {m})",
    "int(memory.k) * 7",
    "(({k}) % 5)",
    "(-({k})) % 3",
    "(int({a}) % 100000) * 100000",
    "({k} and {m})",
    "({k} or {m})",
    "({k} & 6)",
    "int({d}) + int({e})",
    "min({k}, {m})",
    "-({k})",
]
_LEAVES = ["x[0]", "x[1]", "t", "memory.k", "memory.past[2]", "p.most", "0.25", "-1.5", "0.0", "3"]

_HEAD = """
import math

import numpy as np


def twice(a):
    return a + a


def clipped(a, most):
    if a > most:
        return most
    return max(a, -1.0)


def first(row):
    return row[0]


def law(t, x, memory, p, u):
"""


class RandomLaw:
    """Text of a random law, and the names of the variables that it has so far."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._variables: list[str] = []
        self._lines: list[str] = []

    def text(self) -> str:
        """Return the module of the law."""
        for _ in range(self._random.randint(3, 8)):
            self._statement(1)
        self._say(1, f"memory.k = float({self._number(2)})")
        self._say(1, f"u[0] = {self._number(3)}")
        return _HEAD + "\n".join(self._lines) + "\n"

    def _say(self, depth: int, line: str) -> None:
        self._lines.append("    " * depth + line)

    def _statement(self, depth: int) -> None:
        kind = self._random.randrange(8 if depth == 1 else 3)
        name = f"v{len(self._variables)}"
        if kind in (0, 3, 4):
            self._say(depth, f"memory.past[({self._whole(1)}) % 4] = {self._number(3)}")
        elif kind == 1:
            sign = self._random.choice("+-*")
            self._say(depth, f"memory.past[{self._random.randrange(4)}] {sign}= {self._number(2)}")
        elif kind == 5:
            self._say(depth, f"if {self._condition(2)}:")
            self._statement(depth + 1)
            self._say(depth, "else:")
            self._statement(depth + 1)
        elif kind == 6:
            number = self._random.randint(0, 4)
            self._say(depth, f"for i{len(self._lines)} in range({number}):")
            self._statement(depth + 1)
        elif depth == 1:
            self._say(depth, f"{name} = {self._number(3)}")
            self._variables.append(name)
        else:
            self._say(depth, f"memory.other[1:] = memory.past[:{self._random.choice(['3', '-1'])}]")

    def _filled(self, texts: list[str], depth: int) -> str:
        text = self._random.choice(texts)
        for place in ("a", "b", "c"):
            text = text.replace(f"{{{place}}}", self._number(depth - 1), 1)
        for place in ("d", "e"):
            text = text.replace(f"{{{place}}}", self._condition(depth - 1), 1)
        for place in ("k", "m"):
            text = text.replace(f"{{{place}}}", self._whole(depth - 1), 1)
        return text.replace("{s}", str(self._random.randrange(3)))

    def _number(self, depth: int) -> str:
        if depth <= 0:
            return self._random.choice([*_LEAVES, *self._variables])
        return self._filled(_NUMBERS, depth)

    def _condition(self, depth: int) -> str:
        if depth <= 0:
            return f"{self._number(0)} > {self._number(0)}"
        return self._filled(_CONDITIONS, depth)

    def _whole(self, depth: int) -> str:
        if depth <= 0:
            return self._random.choice(["int(memory.k)", "2", "-3", "int(x[0])"])
        return self._filled(_WHOLE, depth)
