"""Arguments and source of a law of the user's own, as far as they can be judged before a run."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from grosmc_mj.ground.errors import ArgumentError

_FORMS = "a law is (t, x, memory, p, u) and writes u, or (t, x, memory, p) and returns its inputs"


def refuse_other_arguments(law: Callable[..., Any]) -> None:
    """Refuse a law that cannot be called with the arguments of one.

    Raises:
        ArgumentError: With its file, line and arguments.
    """
    signature = inspect.signature(law)
    for count in (4, 5):
        try:
            signature.bind(*range(count))
        except TypeError:
            continue
        return
    raise ArgumentError(f"{_place(law)} has the arguments {signature}: {_FORMS}")


def refuse_unwritten_inputs(law: Callable[..., Any], inputs: Sequence[str]) -> None:
    """Refuse a law with the argument u whose text writes some of its inputs never.

    It is not judged where it uses u other than by constant indices, or has no text.

    Args:
        law: The law.
        inputs: Names of the inputs.

    Raises:
        ArgumentError: With its file, its line and the inputs.
    """
    parameters = list(inspect.signature(law).parameters)
    if len(parameters) < 5:
        return
    written = _written(law, parameters[4])
    if written is None:
        return
    missing = [i for i in range(len(inputs)) if i not in written and i - len(inputs) not in written]
    if not missing:
        return
    u = parameters[4]
    unwritten = ", ".join(f"{u}[{i}] ({inputs[i]})" for i in missing)
    instead = f"write {u}[{missing[0]}] = 0.0 for an input that is not used"
    if len(inputs) == 1:
        instead = f"write {u}[0], or leave {u} out of the arguments and return the input"
    raise ArgumentError(f"{_place(law)} never writes {unwritten}: {instead}")


def _written(law: Callable[..., Any], u: str) -> set[int] | None:
    """Return the constant indices at which a law writes u; None if it uses u in another way."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(law)))
    except (OSError, TypeError, SyntaxError):
        return None

    indices: set[int] = set()
    by_index = 0
    for node in ast.walk(tree):
        if not isinstance(node, ast.Subscript) or getattr(node.value, "id", None) != u:
            continue
        index = _constant(node.slice)
        if index is None:
            return None
        by_index += 1
        if isinstance(node.ctx, ast.Store):
            indices.add(index)

    uses = sum(isinstance(node, ast.Name) and node.id == u for node in ast.walk(tree))
    return indices if uses == by_index else None


def _constant(index: ast.expr) -> int | None:
    """Return an index that is a whole number; None for any other."""
    try:
        value = ast.literal_eval(index)
    except ValueError:
        return None
    return value if isinstance(value, int) else None


def _place(law: Callable[..., Any]) -> str:
    """Return file, line and name of a function, or its name."""
    name = getattr(law, "__name__", type(law).__name__)
    code = getattr(law, "__code__", None)
    if code is None:
        return name
    return f"{Path(code.co_filename).name}:{code.co_firstlineno}: {name}"
