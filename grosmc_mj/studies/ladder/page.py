"""The tables of ``docs/ladder.md``, from what the study has written."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from grosmc_mj.results.tables import markdown_table, numbers, words
from grosmc_mj.studies.ladder.answers import STANDS, cell_text, deviation_text
from grosmc_mj.studies.ladder.report import assumed_text, shown_unit


def ladders_text(documents: Iterable[Mapping[str, Any]]) -> str:
    """Headings and tables for each document, in Markdown."""
    return "\n\n".join(_ladder(document) for document in documents)


def _ladder(document: Mapping[str, Any]) -> str:
    """How much each law uses of the tightest limit, climbing and with each rung alone."""
    parts = [f"**{document['configuration']['target']}**: {document['configuration']['title']}"]
    for title, key, together in (
        ("Each rung on top of the others:", "climbing", True),
        ("Each alone on the sampled plant:", "alone", False),
    ):
        rungs = [rung["name"] for rung in document[key]]
        titles = [f"{rung['name']}*" if rung["assumed"] else rung["name"] for rung in document[key]]
        found = {
            (row["law"], row["rung"]): row
            for row in document["standings"]
            if row["together"] is together and row["condition"] == "nominal"
        }
        laws = [each["name"] for each in document["laws"]]
        rows = [[law, *(_cell(found[law, rung]) for rung in rungs)] for law in laws]
        lines = markdown_table([*words("law"), *numbers(*titles)], rows)
        parts.append("\n".join([title, "", *lines]))
    parts += [*_under_load(document), *_deviations(document)]
    if assumed := assumed_text({rung["name"]: rung["assumed"] for rung in document["climbing"]}):
        # A star would begin a list.
        parts.append(f"\\{assumed}")
    return "\n\n".join([*parts, *_claims(document)])


def _under_load(document: Mapping[str, Any]) -> list[str]:
    """The whole machine under each condition; nothing of a ladder that has been climbed once."""
    conditions, top = document["conditions"], document["climbing"][-1]["name"]
    if len(conditions) < 2:
        return []
    found = {
        (row["law"], row["condition"]): row
        for row in document["standings"]
        if row["together"] and row["rung"] == top
    }
    names = [condition["name"] for condition in conditions]
    rows = [
        [law["name"], *(_cell(found[law["name"], name]) for name in names)]
        for law in document["laws"]
    ]
    said = "; ".join(f"{each['name']}: {each['title']}" for each in conditions[1:])
    lines = markdown_table([*words("law"), *numbers(*names)], rows)
    return ["\n".join([f"The whole machine, nominally and under load ({said}):", "", *lines])]


def _deviations(document: Mapping[str, Any]) -> list[str]:
    """How far the laws that follow the nominal optimum are from it, climbing."""
    rungs = [rung["name"] for rung in document["climbing"]]
    unit, scale = shown_unit(document["output_unit"])
    found = {
        (row["law"], row["rung"]): row
        for row in document["standings"]
        if row["together"] and row["condition"] == "nominal"
    }
    rows = [
        [
            law["name"],
            *(
                deviation_text(row["deviation"], row["tightest"] or "", scale)
                for row in (found[law["name"], rung] for rung in rungs)
            ),
        ]
        for law in document["laws"]
        if law["follows_optimum"]
    ]
    lines = markdown_table([*words("law"), *numbers(*rungs)], rows)
    title = f"Largest distance from the nominal optimum [{unit}], of the laws that follow it:"
    return ["\n".join([title, "", *lines])]


def _claims(document: Mapping[str, Any]) -> list[str]:
    """Where claims fall on the way up; nothing of a machine without one."""
    falls = {
        (each["law"], each["claim"]): each["rung"] or STANDS
        for each in document["fallen"]
        if each["condition"] == "nominal"
    }
    if not falls:
        return []
    claims = list(dict.fromkeys(claim for _law, claim in falls))
    laws = list(dict.fromkeys(law for law, _claim in falls))
    rows = [[law, *(falls.get((law, claim), "") for claim in claims)] for law in laws]
    lines = markdown_table(words("law", *(f"`{claim}`" for claim in claims)), rows)
    statements = {each["claim"]: each["statement"] for each in document["claims"]}
    said = "; ".join(f"`{claim}`: {statements[claim]}" for claim in claims)
    title = "Which claim falls, and on which rung:"
    return ["\n".join([title, "", *lines]), f"{said}."]


def _cell(row: Mapping[str, Any]) -> str:
    share = row["share_of_the_tightest_limit"]
    used = math.inf if share is None else share
    return cell_text(used, row["tightest"] or "", row["impossible"] or "")
