"""What the repository records as expected, and how closely a run must repeat it.

``expected_results.json`` is written by ``grosmc-mj validate --record`` and reviewed like code. It
is not a source of results: a run is measured first and compared afterwards.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from grosmc_mj.experiments.metrics import Metric, tolerance_of
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.results.document import write_json

EXPECTED_FILE = Path(__file__).with_name("expected_results.json")


def load_expected() -> dict[str, Any]:
    """The recorded results by the runs' keys, and the settings that they hold for."""
    return json.loads(EXPECTED_FILE.read_text(encoding="utf-8"))


def record_expected(results: Iterable[RunResult], settings: Settings) -> None:
    """Record these results as expected; runs that are not among them stay recorded."""
    runs = load_expected()["runs"]
    for result in results:
        values = {name: metric.value for name, metric in result.metrics.items()}
        runs[result.key] = {"status": result.status.name.lower(), "metrics": values}
    content = {"settings": _comparable(settings), "runs": dict(sorted(runs.items()))}
    write_json(EXPECTED_FILE, content)


def differences(results: Sequence[RunResult], settings: Settings) -> list[str] | None:
    """One line for each result that is not as recorded; None if the settings are other ones."""
    if other_settings(settings):
        return None
    runs = load_expected()["runs"]
    return [line for result in results for line in _differences(result, runs.get(result.key))]


def _differences(result: RunResult, recorded: dict[str, Any] | None) -> list[str]:
    """The same of one run and its record."""
    if recorded is None:
        return [f"{result.key}: not recorded"]
    status = result.status.name.lower()
    if status != recorded["status"]:
        return [f"{result.key}: {status}, recorded {recorded['status']}"]
    switched = result.trajectory.sliding is not None
    lines = []
    for name, metric in result.metrics.items():
        value = recorded["metrics"].get(name)
        if not _repeats(name, metric, value, switched=switched):
            words = f"{name} is {_words(metric.value)}, recorded {_words(value)} {metric.unit}"
            lines.append(f"{result.key}: {words}".rstrip())
    return lines


def other_settings(settings: Settings) -> list[str]:
    """Each setting with another value than the record holds for, with both."""
    recorded = load_expected()["settings"]
    return [
        f"{name.replace('_', ' ')} {value} instead of {recorded[name]}"
        for name, value in _comparable(settings).items()
        if value != recorded[name]
    ]


def _repeats(name: str, metric: Metric, recorded: float | None, *, switched: bool) -> bool:
    """Whether a metric is as recorded, within the tolerance of its law."""
    if metric.value is None or recorded is None:
        return metric.value is recorded
    relative, absolute = tolerance_of(name, switched=switched)
    return math.isclose(metric.value, recorded, rel_tol=relative, abs_tol=absolute)


def _words(value: float | None) -> str:
    """A value, or that there is none."""
    return "none" if value is None else f"{value:.6g}"


def _comparable(settings: Settings) -> dict[str, Any]:
    """The settings that change results; the engines agree to the last bit."""
    return {name: value for name, value in asdict(settings).items() if name != "engine"}
