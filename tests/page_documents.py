"""Documents of every form that the page shows, and files of them."""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from grosmc_mj.output.results.document import plain
from grosmc_mj.output.results.result import (
    Answer,
    CellChart,
    GridChart,
    Letter,
    LineChart,
    ReportTable,
    Series,
    Standing,
    Value,
    result,
)
from grosmc_mj.output.results.tables import numbers, table, verdicts, words


def _document(kind: str, **parts: Any) -> dict[str, Any]:
    content = result(kind, {"target": "servo/case1", "case": "a long line, " * 20}, **parts)
    return {**plain(content), "command": f"grosmc-mj {kind} servo/case1", "machine": "here"}


RUN = _document(
    "run",
    answers=[
        Answer(
            question="Run of servo",
            verdict="not kept",
            words="1 of 2 are not kept",
            notes=["the load on <b>rotor</b> is unmatched"],
        )
    ],
    standings=[
        Standing(
            case="servo/case1",
            law="lqr",
            breaks_at="physics",
            requirement="stays within 2",
            words="stays within 2: 3 rad",
            share=1.5,
        ),
        Standing(case="servo/case1", law="grosmc", words="stays within 2: 1 rad", share=0.5),
        Standing(case="servo/case2", law="lqr", words="input below 4 A: 1 A", share=0.25),
        Standing(case="servo/case2", law="grosmc", words="input below 4 A: 3 A", share=0.75),
    ],
    sheets=[
        ReportTable(
            table=table("Requirements", [*words("law"), *numbers("margin")], [("lqr", "-1")])
        )
    ],
    values=[
        Value(name="lqr: kept", value="not kept"),
        Value(name="margin", value=1.0, unit="s", better=1),
        Value(name="deviation", value=4e-3, unit="rad", relative=0.25, absolute=1e-4),
    ],
)
LADDER = _document(
    "ladder",
    claims=[{"claim": "servo-index", "broken_at": "friction"}],
    answers=[Answer(question="Ladder of servo", verdict="kept", words="1 of 1 laws")],
    standings=[
        Standing(case="servo", law="lqr", breaks_at="friction", words="3 times the limit"),
        Standing(case="servo", law="pd", words="stands so far", complete=False),
    ],
    sheets=[
        ReportTable(
            table=table("nominal", words("law", "friction"), [("lqr", "3")], legend="Of the limit"),
            charts=[CellChart.of("nominal", {("lqr", "friction"): (0.5, "3", "deviation")}, 2.0)],
        )
    ],
)
REGION = _document(
    "region",
    answers=[Answer(question="Region of servo", verdict="measured", words="83 % converge")],
    sheets=[
        ReportTable(
            table=table("Region", words("map"), [("lqr",)]),
            charts=[
                GridChart(
                    name="lqr",
                    axes=(("angle [rad]", 1.5), ("rate [rad/s]", 2.0)),
                    grid=["cc", "cl"],
                    legend=[
                        Letter(letter="c", name="converges", colour="#0072B2"),
                        Letter(letter="l", name="leaves", colour="#E69F00"),
                    ],
                ),
                LineChart(
                    name="bandwidth",
                    titles=("bandwidth [rad/s]", "J"),
                    limit=1.5,
                    marks=[62.5],
                    lines=[Series(name="J", x=[50.0, 100.0], y=[2.0, None], good=[False, True])],
                ),
            ],
        )
    ],
)
CLAIMS = _document(
    "claims",
    answers=[
        Answer(question="Claims of servo", verdict="kept", standard="expected", words="1 of 1")
    ],
    sheets=[
        ReportTable(
            table=table(
                "Claims", [*words("claim"), *verdicts("verdict")], [("servo-index", "refuted")]
            )
        )
    ],
)
CURVES = {
    "kind": "curves",
    "schema_version": 1,
    "system": "servo",
    "case": "case1",
    "title": "with a load",
    "duration": 3.0,
    "disturbances": [{"start": 1.0, "stop": 2.0, "label": "load"}],
    "laws": {
        "lqr": {"label": "lqr", "colour": "#D55E00"},
        "fl-lqr": {"label": "fl-lqr", "colour": "#CC79A7"},
    },
    "panels": [
        {
            "label": "angle [rad]",
            "reference": {"t": [0.0, 3.0], "y": [0.0, 0.0]},
            "limits": [{"words": "stays within", "t": [0.0, 3.0], "y": [2.0, 2.0]}],
            "curves": [
                {"law": "lqr", "plant": "physics", "t": [0.0, 1.5, 3.0], "y": [0.5, 1.0, 0.0]}
            ],
        },
        {
            "label": "input [V]",
            "play": 0.5,
            "curves": [
                {
                    "law": "lqr",
                    "plant": "physics",
                    "t": [0.0, 3.0],
                    "y": [0.0, 0.0],
                    "range": [[-1.0, -1.0], [1.0, 1.0]],
                }
            ],
        },
    ],
}
FILM = {
    "kind": "film",
    "schema_version": 1,
    "drawn_from": "ab",
    "sha256": "cd",
    "configuration": {
        "case": {"system": "servo", "case": "case1"},
        "film": {"speed": 0.5, "start": 0.25},
    },
}
DOCUMENTS = {
    "run": RUN,
    "ladder": LADDER,
    "region": REGION,
    "claims": CLAIMS,
    "curves": CURVES,
    "film": FILM,
}


def write_documents(folder: Path, *kinds: str) -> Path:
    """Write documents of these kinds, by default of all."""
    for kind in kinds or DOCUMENTS:
        write_document(folder / f"{kind}.json", copy.deepcopy(DOCUMENTS[kind]))
    return folder


def write_document(path: Path, content: Any) -> Path:
    """Write a document as JSON."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def write_film(folder: Path, film: bytes) -> None:
    """Write a film, and the document beside it."""
    (folder / "film.mp4").write_bytes(film)
    write_document(folder / "film.json", {**FILM, "sha256": hashlib.sha256(film).hexdigest()})


def valued(values: Iterable[Value], **fields: Any) -> dict[str, Any]:
    """Return a run's document with these values and fields."""
    return {**RUN, "values": [value.model_dump() for value in values], **fields}
