"""Ladders as a document and as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from grosmc_mj.results.document import origin
from grosmc_mj.results.tables import Table, names, number, numbers, table, text, words
from grosmc_mj.studies.ladder.answers import (
    STANDS,
    deviation_text,
    fall_text,
    fallen,
    first_failed,
    judged_claims,
    of_law,
    reason,
    share_text,
)
from grosmc_mj.studies.ladder.measure import Ladder, Standing
from grosmc_mj.studies.ladder.rungs import Rung
from grosmc_mj.studies.studied import StudiedLaw

LEGEND = (
    "How much of the tightest limit is used; above 1 it is not kept. ended: the run ended early; "
    "never: it does not settle; -: there is no such law."
)


def ladder_document(studied: Ladder, rows: Sequence[Standing], *, complete: bool) -> dict[str, Any]:
    """The content of ladder_NAME.json.

    Args:
        studied: The target.
        rows: What has been found.
        complete: Whether that is all; it is not after an interrupt.
    """
    settings, case = studied.experiment.settings, studied.machine.case
    return {
        **origin(case.loop.seed if case.loop else None),
        "configuration": {
            "target": f"{case.system}/{case.name}",
            "title": case.title,
            "control_period": {"value": settings.control_period, "unit": "s"},
            "timestep": {"value": settings.timestep, "unit": "s"},
            "integrator": settings.integrator,
            "file": studied.machine.document(),
        },
        "complete": complete,
        "output_unit": _output_unit(studied.laws),
        "input_unit": studied.experiment.nominal.system.input.unit,
        "conditions": [{"name": c.name, "title": c.title} for c in studied.conditions],
        "laws": [
            {
                "name": law.name,
                "predicts": law.predict,
                "sampled": law.settings,
                "follows_optimum": law.follows_optimum,
            }
            for law in studied.laws
        ],
        "climbing": [_rung(each) for each in studied.climbing],
        "alone": [_rung(each) for each in studied.alone],
        "claims": [
            {
                "claim": table.id,
                "statement": studied.statements.get(table.id, ""),
                "under": table.under,
                "of": list(table.of or studied.machine.controllers),
            }
            for table in studied.machine.file.claim
        ],
        "fallen": _fallen(rows),
        "standings": [_row(row) for row in rows],
    }


def _fallen(rows: Sequence[Standing]) -> list[dict[str, Any]]:
    """The first rung on which a claim falls for each law and condition; null where it stands."""
    conditions = dict.fromkeys(row.condition.name for row in rows)
    laws = dict.fromkeys(row.law.name for row in rows)
    found = []
    for condition in conditions:
        for law in laws:
            way = of_law(rows, law, condition)
            for claim in judged_claims(way):
                row = fallen(way, claim)
                found.append(
                    {
                        "law": law,
                        "condition": condition,
                        "claim": claim,
                        "rung": None if row is None else row.rung.name,
                    }
                )
    return found


def _rung(rung: Rung) -> dict[str, Any]:
    return {
        "name": rung.name,
        "plant": rung.plant,
        "sampled": rung.sampled,
        "loop": asdict(rung.loop) if rung.looped else None,
        "parts": [{"kind": part.kind, **asdict(part)} for part in rung.parts],
        "assumed": list(rung.assumed),
    }


def _row(row: Standing) -> dict[str, Any]:
    """One standing; what is not there is null."""
    swing = row.oscillation
    return {
        "law": row.law.name,
        "rung": row.rung.name,
        "together": row.together,
        "condition": row.condition.name,
        "kept": row.kept,
        "share_of_the_tightest_limit": row.used,
        "tightest": row.worst or None,
        "shares": dict(row.shares),
        "amplitude": None if swing is None else swing.amplitude,
        "frequency": None if swing is None else swing.frequency,
        "chatter": row.chatter,
        "variation": row.variation,
        "deviation": row.deviation,
        "impossible": row.impossible or None,
        "claims": dict(row.claims),
    }


def ladder_table(title: str, rows: Sequence[Standing], rungs: Sequence[Rung]) -> Table:
    """One row of each law, a column for each rung.

    Args:
        title: Above it.
        rows: Of one condition, all together or all alone.
        rungs: The columns.
    """
    laws = list(dict.fromkeys(row.law.name for row in rows))
    found = {(row.law.name, row.rung.name): row for row in rows}
    cells = [(law, *(_cell(found.get((law, rung.name))) for rung in rungs)) for law in laws]
    return table(title, [*names("law"), *numbers(*(rung.title for rung in rungs))], cells)


def assumed_text(assumed: Mapping[str, Sequence[str]]) -> str:
    """Which numbers nobody has published, by the rung that adds them; empty if there is none."""
    rungs = [f"{name} ({'; '.join(numbers)})" for name, numbers in assumed.items() if numbers]
    return f"* rests on numbers that are assumed: {', '.join(rungs)}." if rungs else ""


def deviation_table(rows: Sequence[Standing], rungs: Sequence[Rung]) -> Table:
    """How far each law that follows the nominal optimum is from it, a column for each rung.

    Args:
        rows: Of one condition, all together.
        rungs: The columns.
    """
    own = [row for row in rows if row.law.follows_optimum]
    laws = list(dict.fromkeys(row.law.name for row in own))
    unit, scale = shown_unit(_output_unit([row.law for row in own]))
    found = {(row.law.name, row.rung.name): row for row in own}

    def cell(row: Standing | None) -> str:
        return "" if row is None else deviation_text(row.deviation, row.worst, scale)

    cells = [(law, *(cell(found.get((law, rung.name))) for rung in rungs)) for law in laws]
    title = f"Distance from the nominal optimum [{unit}]"
    return table(title, [*names("law"), *numbers(*(rung.title for rung in rungs))], cells)


def shown_unit(unit: str) -> tuple[str, float]:
    """In which unit distances are shown, and the factor to it."""
    return (f"m{unit}", 1e3) if unit in ("rad", "m") else (unit, 1.0)


def _output_unit(laws: Sequence[StudiedLaw]) -> str:
    """Of what is regulated; empty without a law."""
    if not laws:
        return ""
    error = laws[0].controller.designed.error
    return error.units[error.output_rows[0]]


def _cell(row: Standing | None) -> str:
    """The text of a cell; nothing of what was interrupted."""
    return "" if row is None else share_text(row)


def breaks_table(title: str, rows: Sequence[Standing], condition: str) -> Table:
    """Where each law breaks first, why, and how it swings there."""
    laws = list(dict.fromkeys(row.law.name for row in rows))
    ways = {law: of_law(rows, law, condition) for law in laws}
    order = {law: _place(way) for law, way in ways.items()}
    cells = []
    for law in sorted(laws, key=lambda law: -order[law]):
        row = first_failed(ways[law])
        last = row or ways[law][-1]
        swing = last.oscillation
        cells.append(
            (
                law,
                row.rung.name if row else STANDS,
                reason(row) if row else "",
                share_text(ways[law][-1]),
                "" if swing is None else number(swing.amplitude),
                "" if swing is None or swing.frequency is None else number(swing.frequency),
                "" if last.variation is None else number(last.variation),
            )
        )
    unit, input_unit = _units(rows)
    columns = [
        *names("law"),
        *words("fails first at"),
        *text("why"),
        *numbers(
            "on the whole\nmachine",
            f"swings by\n[{unit}]",
            "at\n[Hz]",
            f"variation\n[{input_unit}/s]",
        ),
    ]
    return table(title, columns, cells)


def claims_table(title: str, rows: Sequence[Standing], condition: str) -> Table | None:
    """On which rung each claim falls for each law that it is about; None without a claim."""
    ways = {law: of_law(rows, law, condition) for law in dict.fromkeys(r.law.name for r in rows)}
    claims = judged_claims([row for way in ways.values() for row in way])
    if not claims:
        return None
    cells = [
        (law, *(fall_text(way, claim) for claim in claims))
        for law, way in ways.items()
        if judged_claims(way)
    ]
    return table(title, [*names("law"), *words(*claims)], cells)


def _place(way: Sequence[Standing]) -> int:
    """How many rungs a law stands from the first on."""
    row = first_failed(way)
    return len(way) if row is None else list(way).index(row)


def _units(rows: Sequence[Standing]) -> tuple[str, str]:
    """Of errors and of inputs."""
    return _output_unit([rows[0].law]), rows[0].condition.experiment.nominal.system.input.unit
