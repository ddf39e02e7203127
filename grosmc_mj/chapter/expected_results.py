"""What the repository records as expected, and how closely a run must repeat it.

``expected.json`` is written by ``grosmc-mj validate --record`` and reviewed like code. It is
not a source of results: a run is measured first and compared afterwards.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from grosmc_mj.errors import SetupError
from grosmc_mj.experiments.metrics.recorded import Metric
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.results.document import write_json

EXPECTED_FILE = Path(__file__).with_name("expected_results.json")

# Laws without switching repeat to rounding, which the step of a threshold or a sum over 1e4
# samples amplifies: relative, absolute.
_SMOOTH = (1e-6, 1e-9)
# Switching amplifies rounding until whole samples differ; what then repeats are bounds and
# norms. The deviation, the costs and the effort are averages or envelopes of the chatter.
_SWITCHED = {
    "deviation": (0.25, 1e-4),
    "settling_time": (0.0, 0.02),
    "overshoot": (0.2, 0.2),
    "rms_error": (1e-3, 1e-5),
    "max_sliding": (0.25, 1e-4),
    "rms_sliding": (0.25, 1e-4),
    "cost_continuous": (0.01, 0.0),
    "cost_whole": (0.1, 0.0),
    "cost_optimal": (1e-9, 0.0),
    "total_variation": (0.1, 0.0),
    "max_input": (0.05, 0.0),
    "cart_travel": (0.05, 0.0),
}
# What depends on the chatter in ways of its own.
_OTHER = (0.1, 0.0)


def load_expected() -> dict[str, Any]:
    """The recorded results by the runs' keys, and the settings that they hold for.

    Raises:
        SetupError: If the record is missing.
    """
    if not EXPECTED_FILE.is_file():
        raise SetupError(f"{EXPECTED_FILE} is missing: install again, or run make record")
    return json.loads(EXPECTED_FILE.read_text(encoding="utf-8"))


def record_expected(results: Iterable[RunResult], settings: Settings) -> None:
    """Record these results as expected; runs that are not among them stay recorded."""
    runs = load_expected()["runs"] if EXPECTED_FILE.is_file() else {}
    for result in results:
        runs[result.key] = {
            "status": result.status.name.lower(),
            "metrics": {name: metric.value for name, metric in result.metrics.items()},
        }
    content = {"settings": _comparable(settings), "runs": dict(sorted(runs.items()))}
    write_json(EXPECTED_FILE, content)


def differences(results: Sequence[RunResult], settings: Settings) -> list[str] | None:
    """One line for each result that is not as recorded; None if the settings are other ones.

    Raises:
        SetupError: If the record is missing.
    """
    if other_settings(settings):
        return None
    expected, found = load_expected(), []
    for result in results:
        recorded = expected["runs"].get(result.key)
        if recorded is None:
            found.append(f"{result.key}: not recorded")
            continue
        status = result.status.name.lower()
        if status != recorded["status"]:
            found.append(f"{result.key}: {status}, recorded {recorded['status']}")
            continue
        switched = result.trajectory.sliding is not None
        for name, metric in result.metrics.items():
            if not _repeats(name, metric, recorded["metrics"].get(name), switched=switched):
                found.append(
                    f"{result.key}: {name} is {_words(metric.value)}, recorded "
                    f"{_words(recorded['metrics'].get(name))} {metric.unit}".rstrip()
                )
    return found


def other_settings(settings: Settings) -> list[str]:
    """Each setting with another value than the record holds for, with both."""
    recorded = load_expected()["settings"]
    return [
        f"{name.replace('_', ' ')} {value} instead of {recorded[name]}"
        for name, value in _comparable(settings).items()
        if value != recorded[name]
    ]


def tolerance_of(metric: str, *, switched: bool) -> tuple[float, float]:
    """How closely a metric repeats on another machine: relative, absolute in its unit.

    Args:
        metric: Its name.
        switched: Whether a switching law made the run.
    """
    return _SWITCHED.get(metric, _OTHER) if switched else _SMOOTH


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
    return {
        "control_period": settings.control_period,
        "timestep": settings.timestep,
        "integrator": settings.integrator,
        "switching": settings.switching,
        "surface": settings.surface,
    }
