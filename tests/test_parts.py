"""Results of tests that ran in parts, and results that a session makes once."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import report
from conftest import Store

CASE = '<testcase classname="tests.{0}.test_x" name="a">{1}</testcase>'


def write(folder: Path, name: str, time: float, *cases: str) -> None:
    file = folder / f"{name}.xml"
    file.write_text(f"<testsuites><testsuite>{''.join(cases)}</testsuite></testsuites>")
    os.utime(file, (time, time))


def test_of_each_part_its_newest_result_counts_unless_the_code_is_newer(tmp_path: Path) -> None:
    failed, passed = CASE.format("loop", "<failure/>"), CASE.format("loop", "")
    other = CASE.format("plants", "<skipped/>")
    needed = ["apart", "loop", "plants"]
    write(tmp_path, "all", 20, failed, other)
    write(tmp_path, "apart", 20, CASE.format("hostile", ""))
    text, good = report.report(report.results(tmp_path, since=10), needed)
    assert not good
    assert text.splitlines()[1].split() == ["FAILED", "loop", "1", "failure"]
    write(tmp_path, "tests-loop", 30, passed, passed)
    text, good = report.report(report.results(tmp_path, since=10), needed)
    assert good
    assert text.splitlines()[1].split() == ["ok", "loop", "2", "passed"]
    text, good = report.report(report.results(tmp_path, since=25), needed)
    assert not good
    assert "FAILED  plants          missing" in text


def test_parts_are_the_folders_and_what_runs_apart() -> None:
    assert {"apart", "control", "top level"} <= set(report.parts())
    assert "hostile" not in report.parts()


def test_a_folder_is_filled_once_and_again_if_that_failed(tmp_path: Path) -> None:
    store, calls = Store(tmp_path / "stored"), []

    def fill(folder: Path) -> None:
        calls.append(folder)
        if len(calls) == 1:
            raise OSError("full")

    with pytest.raises(OSError, match="full"):
        store.folder("some", fill)
    folder = store.folder("some", fill)
    assert store.folder("some", fill) == folder
    assert calls == [folder, folder]
