"""Numbers of a case that are allowed, and probably a mistake."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.file.parts import TABLES, table_of, unit_of
from grosmc_mj.fields import Range, range_of


def implausible(case: Case) -> Iterator[str]:
    """Return a line for each number of a case that is far from those of any machine.

    The usual sizes stand beside its field, or are those of its unit.
    """
    for label, value, bounds in [*_starts(case), *_parts(case)]:
        if not isinstance(value, float):
            continue
        usual = bounds.unusual(value)
        if usual:
            line = f"{label} = {value:g} {bounds.unit} is implausible; usual: {usual} {bounds.unit}"
            # A number without a unit leaves two blanks.
            yield " ".join(line.split())


def _starts(case: Case) -> Iterator[tuple[str, Any, Range]]:
    """Return label, value and range of each state at the start."""
    for state, value in zip(case.nominal.system.states, case.x0, strict=True):
        # A start at an operating point has rounding errors in the place of zeros.
        yield f"start: {state.name}", value, Range(unit=state.unit, usual=(0, 1e4))


def _parts(case: Case) -> Iterator[tuple[str, Any, Range]]:
    """Return label, value and range of each number of edits, machine and loop."""
    parts: list[tuple[str, Any]] = [(table_of(edit), edit) for edit in case.edits]
    if case.loop is not None:
        parts += case.loop.parts
    for kind, part in parts:
        owner = getattr(part, "of", "")
        if not isinstance(owner, str):
            owner = owner[0]
        name = f"{kind} of {owner!r}" if owner else kind
        for item in fields(part):
            bounds = range_of(type(part), item.name)
            if bounds is None:
                continue
            if kind in TABLES and not bounds.whole:
                bounds = replace(bounds, unit=unit_of(kind, owner, item.name, case.nominal.system))
            yield f"{name}: {item.name}", getattr(part, item.name), bounds
