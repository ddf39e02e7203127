"""A run is as recorded, within the tolerances of its law."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from grosmc_mj.chapter import expected_results


@pytest.mark.parametrize(
    ("now", "before", "as_recorded"),
    [
        (0.25, 0.25, True),
        (0.25, 0.26, False),
        (None, None, True),
        (None, 0.25, False),
        (0.25, None, False),
    ],
)
def test_a_value_is_as_recorded_if_it_is_there_and_equal(
    now: float | None,
    before: float | None,
    as_recorded: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / "recorded.json"
    record = {"status": "completed", "metrics": {"deviation": before}}
    path.write_text(json.dumps({"runs": {"a run": record}}), encoding="utf-8")
    monkeypatch.setattr(expected_results, "EXPECTED_FILE", path)
    result: Any = SimpleNamespace(
        key="a run",
        status=SimpleNamespace(name="COMPLETED"),
        metrics={"deviation": SimpleNamespace(value=now, unit="rad")},
        switched=False,
    )
    assert (expected_results.unexpected_results([result]) == []) is as_recorded
