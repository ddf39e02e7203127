"""Place of the case files that commands write."""

from __future__ import annotations

from pathlib import Path

import pytest

from grosmc_mj.experiments.file.shipped import shipped_files, written_beside


@pytest.mark.parametrize("case", [Path("mine.toml"), Path("folder/mine.toml")])
def test_a_case_is_written_beside_the_one_it_is_made_of(case: Path) -> None:
    assert written_beside(case, Path("renders"), "new.toml") == case.with_name("new.toml")


@pytest.mark.parametrize("name", ["servo/bench", "logs/arm"])
def test_nothing_is_written_beside_a_case_of_the_package(name: str) -> None:
    path = written_beside(shipped_files()[name], Path("renders"), "new.toml")
    assert path == Path("renders/new.toml")
