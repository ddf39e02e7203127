"""grosmc-mj report: one page, one clear line of what is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
from page_documents import write_documents

from grosmc_mj import cli


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stop:
        cli.main([str(each) for each in arguments])
    assert isinstance(stop.value.code, int)
    return stop.value.code


def test_a_folder_becomes_a_page_in_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_documents(tmp_path)
    (tmp_path / "torn.json").write_text('{"schema_version": 1, "claims": [', encoding="utf-8")
    assert run("report", tmp_path) == cli.DONE
    said = capsys.readouterr().out
    assert str(tmp_path / "report.html") in said
    assert f"left out: {tmp_path / 'torn.json'}: is no whole JSON" in " ".join(said.split())
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    # As the command that made a document says, and as this page can be made again.
    assert "grosmc-mj run servo/case1" in text
    assert f"grosmc-mj report {tmp_path}" in text


def test_unreadable_files_alone_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "torn.json").write_text("{", encoding="utf-8")
    (tmp_path / "old.json").write_text(
        '{"schema_version": 1, "answers": 3, "kind": "run"}', encoding="utf-8"
    )
    assert run("report", tmp_path) == cli.WRONG
    said = capsys.readouterr().err
    assert f"unreadable: {tmp_path / 'torn.json'}: is no whole JSON" in said
    assert f"unreadable: {tmp_path / 'old.json'}: schema_version: Input should be 2" in said


@pytest.mark.parametrize(
    ("arguments", "wrong"),
    [
        (("nowhere",), "nowhere does not exist"),
        ((".",), "no results in ."),
        ((".", "-o", "page.pdf"), "-o page.pdf must end in .html"),
    ],
)
def test_what_is_wrong_is_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    wrong: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("report", *arguments) == cli.WRONG
    said = capsys.readouterr()
    assert said.err.splitlines() == [f"grosmc-mj: {wrong}"]
    assert list(tmp_path.iterdir()) == []
