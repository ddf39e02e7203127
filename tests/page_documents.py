"""Small results of every kind that the page reads, as commands write them."""

from __future__ import annotations

import copy
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

ORIGIN: dict[str, Any] = {
    "schema_version": 1,
    "versions": {"python": "3.11.7", "mujoco": "3.17.0"},
    "git_revision": "0123abc",
    "machine": "Linux x86_64, 2 cores",
    "command": "grosmc-mj run servo/case1",
    "seed": 7,
}
RUN: dict[str, Any] = {"system": "servo", "case": "case1", "plant": "physics", "ended": ""}
REQUIREMENT: dict[str, Any] = {
    "requirement": "deviation_below",
    "limit": {"value": 0.002, "unit": "rad"},
    "after": 0.0,
    "controller": "lqr",
    "plant": "physics",
    "measured": 1.42,
    "margin": -1.418,
    "kept": False,
    "note": "",
}
FOUND: dict[str, Any] = {
    "value": 12.5,
    "note": "at t = 3 s",
    "verdict": "refuted",
    "evidence": {"exact": False, "values": [12.5, 12.4]},
    "trials": {"rate = 1 A": 11.0},
}
CLAIM: dict[str, Any] = {
    "id": "servo-index",
    "system": "servo",
    "source": "eq. (13)",
    "statement": "The index is minimized",
    "equation": r"J = \tfrac12\int x^{\mathrm T}Qx\,dt \le \frac{a}{b}",
    "criterion": "J over J*",
    "sense": "at most",
    "threshold": 2.0,
    "unit": "%",
    "cause": "u_d costs, too",
    "verdict": "refuted",
    "plants": {"corrected": FOUND, "physics": FOUND},
    "expected": {"verdicts": {"physics": "refuted"}, "reason": "u_d is left out"},
}
TIMES = [0.0, 0.5, 1.0, 2.0]
CURVE: dict[str, Any] = {"law": "lqr", "plant": "physics", "name": "", "range": None}
AMOUNT: dict[str, Any] = {"factor": 2.0, "parts": [{"value": 0.0015, "unit": "s"}]}

DOCUMENTS: dict[str, dict[str, Any]] = {
    "validation": {
        **ORIGIN,
        "complete": True,
        "as_recorded": True,
        "differences": [],
        "runs": [{**RUN, "controller": "lqr"}],
        "claims": [CLAIM, {**CLAIM, "id": "arm-1", "system": "arm", "verdict": "supported"}],
    },
    "run": {
        **ORIGIN,
        "complete": True,
        "configuration": {"cases": [{"system": "servo", "case": "case1", "title": "A load"}]},
        "kept": False,
        "requirements": [REQUIREMENT],
        "runs": [{**RUN, "controller": "lqr"}],
    },
    "curves": {
        **ORIGIN,
        "system": "servo",
        "case": "case1",
        "title": "A load",
        "duration": 2.0,
        "disturbances": [{"start": 0.5, "stop": 1.0, "label": "load"}],
        "laws": {
            "lqr": {"label": "LQR", "colour": "#D55E00"},
            "grosmc": {"label": "GROSMC", "colour": "#0072B2"},
        },
        "panels": [
            {
                "label": "rotor angle [rad]",
                "curves": [
                    {**CURVE, "t": TIMES, "y": [0.0, 0.25, 0.5, 1.0]},
                    {**CURVE, "law": "grosmc", "t": TIMES, "y": [0.0, 0.75, 0.875, 1.0]},
                    {**CURVE, "plant": "corrected", "t": TIMES, "y": [0.0, 0.25, 0.5, 1.0]},
                ],
                "reference": {"t": TIMES, "y": [1.0, 1.0, 1.0, 1.0]},
                "limits": [{"words": "within 0.1", "t": [1.0, 2.0], "y": [0.9, 0.9]}],
                "play": 0.0,
            },
            {
                "label": "current [A]",
                "curves": [{**CURVE, "t": TIMES, "y": [0.0] * 4, "range": [[-1.0] * 4, [1.0] * 4]}],
                "reference": None,
                "limits": [],
                "play": 0.1,
            },
        ],
    },
    "tolerance": {
        **ORIGIN,
        "complete": True,
        "configuration": {"target": "servo/bench"},
        "tolerances": [
            {
                "law": "lqr",
                "imperfection": "computing delay",
                "condition": "nominal",
                "kept_ideally": True,
                "largest_kept": AMOUNT,
                "smallest_failed": AMOUNT,
                "breaks": "deviation_below",
            }
        ],
    },
    "ladder": {
        **ORIGIN,
        "complete": True,
        "configuration": {"target": "servo/machine"},
        # What else it has makes it no other document.
        "claims": [{"claim": "servo-index", "statement": "J is least", "of": ["lqr"]}],
        "fallen": [
            {"law": "lqr", "condition": "nominal", "claim": "servo-index", "rung": "friction"},
            {"law": "sign", "condition": "nominal", "claim": "servo-index", "rung": None},
        ],
        "standings": [
            {
                "law": "lqr",
                "rung": rung,
                "together": True,
                "condition": "nominal",
                "kept": share <= 1,
                "share_of_the_tightest_limit": share,
                "tightest": "deviation_below",
            }
            for rung, share in (
                ("printed", 2.0),
                ("sensors", 0.5),
                ("friction", 3.0),
                ("stops", 0.25),
            )
        ],
    },
    "results": {
        **ORIGIN,
        "pass_rates": [
            {
                "requirement": "all requirements",
                "controller": "lqr",
                "kept": 3,
                "runs": 4,
                "low": 0.3,
                "high": 0.95,
                "confidence": 0.95,
            }
        ],
        "margins": [{"requirement": "all requirements", "controller": "lqr", "least": -0.5}],
        "units": {"mass": "kg"},
        "says": "No proof.",
    },
    "region": {
        **ORIGIN,
        "system": "servo",
        "configuration": {
            "axes": [
                {"name": "rotor angle", "unit": "rad", "limit": 1.5},
                {"name": "cart position", "unit": "m", "limit": 2.0},
            ]
        },
        "outcomes": {"c": {"name": "converged"}, "l": {"name": "left the region"}},
        "maps": [
            {
                "case": case,
                "controller": "lqr",
                "counts": {"converged": 6 - left, "left the region": left},
                "converges_on_first_axis": {"from": -1.0, "to": 1.0},
                "grid": ["cc", "cl" if left else "cc", "cc"],
            }
            for case, left in (("nominal", 0), ("case1", 1))
        ],
    },
    "switching": {
        **ORIGIN,
        "benchmark": {
            "equation": "s' = r phi + w",
            "orders": {"sign": 1.0},
            "sample_times": [
                {"law": "sign", "h": h, "gain_ratio": 1.0, "max_sliding": size}
                for h, size in ((0.001, 0.002), (0.004, None))
            ],
            "gain_ratios": [{"law": "sign", "h": 0.001, "gain_ratio": 0.5, "max_sliding": 0.1}],
        },
        "cases": [
            {
                "system": "servo",
                "case": "case1",
                "law": "sign",
                "surface": "printed",
                "control_period": 0.001,
                "deviation": 0.5,
                "ended": "",
            }
        ],
    },
    "sweeps": {
        **ORIGIN,
        "sweeps": [
            {
                "claim": "servo-index",
                "choice": "bandwidth",
                "printed": False,
                "values": [
                    {"choice": f"bandwidth = {rate} rad/s", "measured": 100 / rate, "holds": holds}
                    for rate, holds in ((50, False), (100, True))
                ],
                "flips": "at bandwidth = 62.5 rad/s",
            }
        ],
    },
    "premises": {
        **ORIGIN,
        "premises": [
            {
                "system": "servo",
                "case": "case1",
                "controller": "grosmc",
                "premises": [
                    {
                        "name": "switching gain",
                        "unit": "A",
                        "holds": False,
                        "region": {"margin": -0.5, "violated": 0.25},
                        "along_run": None,
                        "restored_by": "rho = 2 A",
                    }
                ],
            }
        ],
    },
    "worst": {
        **ORIGIN,
        "says": "no proof",
        "controllers": {
            "lqr": {
                "fails": True,
                "relative": -0.5,
                "worst": {"mass": 2.0, "length": 1.5},
                "evaluations": 128,
                "shrunk": {"mass": 1.25, "length": 1.0},
                "not_nominal": ["mass"],
            }
        },
    },
    "radius": {
        **ORIGIN,
        "says": "no proof",
        "controllers": {
            "lqr": {
                "found": 0.75,
                "largest_looked_at": 1.5,
                "promised": None,
                "promised_note": "nothing is promised",
                "looks": [
                    {"scale": 0.5, "least": 0.25, "failures": 0},
                    {"scale": 1.5, "least": -0.5, "failures": 3},
                ],
            }
        },
    },
    "self_test": {
        **ORIGIN,
        "noticed_by": {"G too small": ["servo-index"], "slow sampling": []},
    },
    "film": {
        **ORIGIN,
        "configuration": {
            "case": {"system": "servo", "case": "case1"},
            "film": {"speed": 0.5, "start": 0.25},
        },
        "drawn_from": "ab",
        "sha256": "cd",
    },
}


def write_documents(folder: Path, *kinds: str) -> Path:
    """Write documents of these kinds, or of all, with the parts of the campaign."""
    for kind in kinds or DOCUMENTS:
        content = copy.deepcopy(DOCUMENTS[kind])
        path = folder / ("camp" if kind == "results" else ".") / f"{kind}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(content), encoding="utf-8")
        if kind == "results":
            write_part(path.parent, np.array([-0.5, 0.25, 0.5, np.inf]))
    return folder


def write_film(folder: Path, film: bytes) -> None:
    """Write a film, and the document beside it."""
    (folder / "film.mp4").write_bytes(film)
    content = {**DOCUMENTS["film"], "sha256": hashlib.sha256(film).hexdigest()}
    (folder / "film.json").write_text(json.dumps(content), encoding="utf-8")


def write_part(folder: Path, relative: np.ndarray[Any, Any], law: str = "lqr") -> None:
    """Write a part of a campaign with these margins, of masses from 1 kg to 2 kg."""
    count = len(relative)
    (folder / "parts").mkdir(parents=True, exist_ok=True)
    table = pa.table(
        {
            "id": np.arange(count),
            "controller": [law] * count,
            "mass": np.linspace(1.0, 2.0, count),
            "relative": relative,
        }
    )
    pq.write_table(table, folder / "parts" / "part-0000000.parquet")
