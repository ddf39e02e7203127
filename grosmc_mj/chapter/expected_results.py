"""What the repository records as expected, and how closely a run must repeat it.

``expected_results.json`` is written by ``grosmc-mj validate --record`` and reviewed like code. It
is not a source of results: a run is measured first and compared afterwards.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from grosmc_mj.experiments.metrics import tolerance_of
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.results.document import write_json

EXPECTED_FILE = Path(__file__).with_name("expected_results.json")


def load_expected() -> dict[str, Any]:
    """The recorded results by the runs' keys, and the settings that they hold for."""
    return json.loads(EXPECTED_FILE.read_text(encoding="utf-8"))


def record_expected(results: Iterable[RunResult]) -> None:
    """Record these results as expected; runs that are not among them stay recorded."""
    runs = load_expected()["runs"]
    # The engines agree to the last bit.
    settings = {name: value for name, value in asdict(Settings()).items() if name != "engine"}
    for result in results:
        values = {name: metric.value for name, metric in result.metrics.items()}
        runs[result.key] = {"status": result.status.name.lower(), "metrics": values}
    content = {"settings": settings, "runs": dict(sorted(runs.items()))}
    write_json(EXPECTED_FILE, content)


def differences(results: Sequence[RunResult]) -> list[str]:
    """One line for each result that is not as recorded."""
    runs = load_expected()["runs"]
    return [
        f"{result.key}: {line}".rstrip()
        for result in results
        for line in _differences(result, runs.get(result.key))
    ]


def _differences(result: RunResult, recorded: dict[str, Any] | None) -> Iterator[str]:
    """The same of one run and its record, within the tolerance of its law."""
    status = result.status.name.lower()
    if recorded is None:
        yield "not recorded"
        return
    if status != recorded["status"]:
        yield f"{status}, recorded {recorded['status']}"
        return
    switched = result.trajectory.sliding is not None
    for name, metric in result.metrics.items():
        now, before = metric.value, recorded["metrics"].get(name)
        relative, absolute = tolerance_of(name, switched=switched)
        if now is None or before is None:
            repeats = now is before
        else:
            repeats = math.isclose(now, before, rel_tol=relative, abs_tol=absolute)
        if not repeats:
            values = ("none" if value is None else f"{value:.6g}" for value in (now, before))
            yield f"{name} is {', recorded '.join(values)} {metric.unit}"
