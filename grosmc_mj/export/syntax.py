"""Syntax trees of Python functions, and the refusal of what has no C."""

from __future__ import annotations

import ast
import linecache
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

from grosmc_mj.errors import ArgumentError


class ExportError(ArgumentError):
    """Error of a law that has no C, with file, line and what to write instead."""


def refusal(function: FunctionType, node: Any, reason: str) -> ExportError:
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


def tree_of(function: FunctionType) -> ast.FunctionDef | ast.Lambda:
    """Return the syntax tree of a function.

    Raises:
        ExportError: If there is no source of it.
    """
    code = function.__code__
    for node in _functions_in(code.co_filename):
        if _is_of(node, code):
            return node
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


def _is_of(node: ast.FunctionDef | ast.Lambda, code: CodeType) -> bool:
    """Whether a tree is that of some code; lambdas of a line are told apart by their columns."""
    if isinstance(node, ast.FunctionDef):
        lines = [node.lineno, *(decorator.lineno for decorator in node.decorator_list)]
        return node.name == code.co_name and min(lines) == code.co_firstlineno
    if code.co_name != "<lambda>" or node.lineno != code.co_firstlineno:
        return False
    columns = {(line, column) for line, _, column, _ in code.co_positions()}
    return (node.body.lineno, node.body.col_offset) in columns


def where(function: FunctionType) -> str:
    """Return file and line of a function, for a comment; of a generated one, the equations."""
    code = function.__code__
    if code.co_filename.startswith("<"):
        return "from the equations"
    return f"{Path(code.co_filename).name}:{code.co_firstlineno}"
