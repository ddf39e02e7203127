"""Reader of MATLAB files without a process of its own, which takes as long as a hundred files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from grosmc_mj.experiments.logs import matlab_file


@pytest.fixture
def reader_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    def call(function: Callable[..., Any], *arguments: Any, memory: int, library: str) -> Any:
        assert memory > 0
        assert library
        return function(*arguments)

    monkeypatch.setattr(matlab_file, "call_in_child", call)
