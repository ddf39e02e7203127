"""Syntax trees of Python functions, and the refusal of parts that have no C."""

from __future__ import annotations

import ast
import linecache
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

from grosmc_mj.ground.errors import ArgumentError


class ExportError(ArgumentError):
    """Error of a law that has no C, with file, line and what to write instead."""


class NoCError(Exception):
    """Reason why a part of a function has no C, and what to write instead.

    The translation that visits the part adds file and line, see ``refusal``.
    """


def refusal(function: FunctionType, node: Any, reason: object) -> ExportError:
    """Return the error of a part of a function that has no C.

    Args:
        function: The function.
        node: The part, a node of its syntax tree.
        reason: Why it has no C, and what to write instead.
    """
    code = function.__code__
    file = Path(code.co_filename).name
    line = getattr(node, "lineno", code.co_firstlineno)
    text = ast.unparse(node).splitlines()[0][:80]
    return ExportError(f"{file}:{line}: {text}: {reason}")


def body_of(function: FunctionType) -> list[ast.stmt]:
    """Return the statements of a function.

    Raises:
        ExportError: If there is no source of it.
    """
    code = function.__code__
    for node in _functions_in(code.co_filename):
        if isinstance(node, ast.FunctionDef) and _is_definition(node, code):
            return node.body
        if isinstance(node, ast.Lambda) and _is_lambda(node, code):
            return [ast.copy_location(ast.Return(node.body), node)]
    raise ExportError(
        f"{Path(code.co_filename).name}:{code.co_firstlineno}: no source of {code.co_name}: write "
        "the function into a file"
    )


# A law reaches many functions of one file.
@cache
def _functions_in(file: str) -> list[Any]:
    """Return the trees of all functions in a file; generated functions have theirs in linecache."""
    tree = ast.parse("".join(linecache.getlines(file)))
    return [node for node in ast.walk(tree) if isinstance(node, (ast.FunctionDef, ast.Lambda))]


def _is_definition(node: ast.FunctionDef, code: CodeType) -> bool:
    """Whether a tree is that of some code, which begins with the decorators."""
    lines = [node.lineno, *(decorator.lineno for decorator in node.decorator_list)]
    return node.name == code.co_name and min(lines) == code.co_firstlineno


def _is_lambda(node: ast.Lambda, code: CodeType) -> bool:
    """Whether a tree is that of some code; lambdas of a line are told apart by their columns."""
    if code.co_name != "<lambda>" or node.lineno != code.co_firstlineno:
        return False
    columns = {(line, column) for line, _, column, _ in code.co_positions()}
    return (node.body.lineno, node.body.col_offset) in columns


def nodes_of(body: Sequence[ast.stmt]) -> Iterator[ast.AST]:
    """Yield all nodes of some statements."""
    for statement in body:
        yield from ast.walk(statement)


def whole_expressions(body: Sequence[ast.stmt]) -> set[ast.AST | None]:
    """Return the expressions that are all that their statement computes, but for a sign or not."""
    whole: set[ast.AST | None] = set()
    for node in nodes_of(body):
        expression = None
        if isinstance(node, (ast.Expr, ast.Return, ast.Assign, ast.AnnAssign)):
            expression = node.value
        if isinstance(node, ast.If):
            expression = node.test
        if isinstance(expression, ast.UnaryOp):
            expression = expression.operand
        whole.add(expression)
    return whole


def where(function: FunctionType) -> str:
    """Return file and line of a function, for a comment; of a generated one, the equations."""
    code = function.__code__
    if code.co_filename.startswith("<"):
        return "from the equations"
    return f"{Path(code.co_filename).name}:{code.co_firstlineno}"
