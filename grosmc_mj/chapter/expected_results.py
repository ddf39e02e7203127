"""The recorded results, and how closely a run must repeat them.

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

from grosmc_mj.experiments.experiment import RunResult
from grosmc_mj.experiments.requirements.metrics import tolerance_of
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.output.results.document import write_json

EXPECTED_FILE = Path(__file__).with_name("expected_results.json")


def load_expected() -> dict[str, Any]:
    """Return the recorded results by the runs' keys, and the settings that they hold for."""
    return json.loads(EXPECTED_FILE.read_text(encoding="utf-8"))


def record_expected(results: Iterable[RunResult]) -> None:
    """Record these results as expected; runs that are not among them stay recorded."""
    runs = load_expected()["runs"]
    for result in results:
        metrics = {name: metric.value for name, metric in result.metrics.items()}
        runs[result.key] = {"status": result.status.name.lower(), "metrics": metrics}

    # The engines agree to the last bit: the record holds for both.
    settings = asdict(Settings())
    del settings["engine"]
    write_json(EXPECTED_FILE, {"settings": settings, "runs": dict(sorted(runs.items()))})


def unexpected_results(results: Sequence[RunResult]) -> list[str]:
    """Return one line for each result that is not as recorded."""
    recorded = load_expected()["runs"]
    lines = []
    for result in results:
        for difference in _differences(result, recorded.get(result.key)):
            line = f"{result.key}: {difference}".rstrip()
            lines.append(line)
    return lines


def _differences(result: RunResult, recorded: dict[str, Any] | None) -> Iterator[str]:
    """Compare one run with its record, within the tolerances of its law."""
    if recorded is None:
        yield "not recorded"
        return

    status = result.status.name.lower()
    if status != recorded["status"]:
        yield f"{status}, recorded {recorded['status']}"
        return

    for name, metric in result.metrics.items():
        before = recorded["metrics"].get(name)
        tolerance = tolerance_of(name, switched=result.switched)
        if not _repeats(metric.value, before, tolerance):
            now = _written(metric.value)
            yield f"{name} is {now}, recorded {_written(before)} {metric.unit}"


def _repeats(now: float | None, before: float | None, tolerance: tuple[float, float]) -> bool:
    """Whether a value is the recorded one within a relative and an absolute tolerance."""
    if now is None or before is None:
        return now is before

    relative, absolute = tolerance
    return math.isclose(now, before, rel_tol=relative, abs_tol=absolute)


def _written(value: float | None) -> str:
    if value is None:
        return "none"
    return f"{value:.6g}"
