"""Grammar of formulas: strengths, rows of comparisons, names in names, places of mistakes."""

from __future__ import annotations

import pytest

from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.grammar import Grammar, Node

GRAMMAR = Grammar(
    names=["a", "b", "a b"],
    functions=["f"],
    operators={"or": 1, "<": 2, "+": 3, "**": 5},
    prefixes={"not": 2, "-": 4},
    comparisons=["<"],
    from_right=["**"],
    with_interval=["or"],
    units=r"\s*(?:mm|m)\b",
)


def written(node: Node) -> str:
    """Write a tree with all of its brackets."""
    parts = ", ".join(map(written, node.parts))
    interval = "".join(f"[{end.text}]" for end in node.interval)
    return f"{node.text}{node.unit}{interval}({parts})" if parts else f"{node.text}{node.unit}"


@pytest.mark.parametrize(
    ("text", "tree"),
    [
        ("a + b + a", "+(+(a, b), a)"),
        ("a ** b ** a", "**(a, **(b, a))"),
        ("-a ** b", "-(**(a, b))"),
        ("- a + b", "+(-(a), b)"),
        ("a b + b", "+(a b, b)"),
        ("a < b < a or b", "or(< <(a, b, a), b)"),
        ("not a < b", "<(not(a), b)"),
        ("a or[1 m, 2] b", "or[1][2](a, b)"),
        ("f(2 mm, (a))", "f(2mm, a)"),
    ],
)
def test_an_operator_binds_by_its_strength(text: str, tree: str) -> None:
    assert written(GRAMMAR.read(text)) == tree


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a + c", "has 'c' at character 5, may have a, b, a b, not, or, f and numbers"),
        ("a b b", "has 'b' at character 5 after a whole formula"),
        ("a +", "has nothing where a quantity must be"),
        ("a + + b", "has '+' at character 5 where a quantity must be"),
        ("f(a", "has no ')' where one must be"),
        ("2mmm", "has '2mmm' at character 1"),
    ],
)
def test_a_mistake_is_told_with_its_place(text: str, reason: str) -> None:
    with pytest.raises(ArgumentError) as refusal:
        GRAMMAR.read(text)
    assert str(refusal.value).startswith(reason)


def test_names_of_a_text_are_the_longest() -> None:
    assert GRAMMAR.names_in("f(a b) + b or 1") == {"a b", "b"}
