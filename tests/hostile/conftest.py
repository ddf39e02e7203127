"""The trial of a test of hostile input."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from trial import Trial

from grosmc_mj import cli
from grosmc_mj.cli import screen


@pytest.fixture
def hostile(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Trial]:
    folder = tmp_path / "working"
    folder.mkdir()
    monkeypatch.chdir(folder)
    # No line of progress, however slow the machine is.
    monkeypatch.setattr(screen, "LINE_EVERY", float("inf"))
    trial = Trial(capfd, folder)
    yield trial
    # An oracle that calls everything an error would see nothing.
    assert trial.ends[cli.WRONG] > 0
    assert trial.ends[cli.DONE] + trial.ends[cli.DIFFERS] > 0
