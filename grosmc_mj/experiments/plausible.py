"""Numbers of a case that are allowed, and probably a slip."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.file.parts import TABLES, table_of, unit_of
from grosmc_mj.fields import Range, range_of
from grosmc_mj.plants import System


def implausible(case: Case, system: System) -> Iterator[str]:
    """A line for each number of a case that is far from those of any machine.

    The usual sizes stand beside its field, or are those of its unit.
    """
    numbers: list[tuple[str, Any, Range]] = []
    for state, value in zip(system.states, case.x0, strict=True):
        # A start at an operating point has rounding errors in the place of zeros.
        numbers.append((f"start: {state.name}", value, Range(unit=state.unit, usual=(0, 1e4))))
    edits: list[tuple[str, Any]] = [(table_of(edit), edit) for edit in case.edits]
    for kind, part in [*edits, *(case.loop.parts if case.loop else ())]:
        of = getattr(part, "of", "")
        of = of if isinstance(of, str) else of[0]
        for item in fields(part):
            bounds = range_of(type(part), item.name)
            if bounds is not None:
                if kind in TABLES and not bounds.whole:
                    bounds = replace(bounds, unit=unit_of(kind, of, item.name, system))
                label = f"{kind}{of and f' of {of!r}'}: {item.name}"
                numbers.append((label, getattr(part, item.name), bounds))
    for label, value, bounds in numbers:
        if isinstance(value, float) and (usual := bounds.unusual(value)):
            line = f"{label} = {value:g} {bounds.unit} is implausible; usual: {usual}"
            yield " ".join(f"{line} {bounds.unit}".split())
