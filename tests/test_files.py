"""Files are whole or not there, and nobody else decides where they are written."""

import errno
import os
from pathlib import Path

import pytest

from grosmc_mj.errors import SetupError
from grosmc_mj.files import private_cache, written_aside


def test_a_link_that_is_in_the_way_is_replaced_and_never_followed(tmp_path: Path, monkeypatch):
    elsewhere, target = tmp_path / "elsewhere", tmp_path / "results.json"
    elsewhere.write_text("somebody's")
    target.symlink_to(elsewhere)
    with written_aside(target) as part:
        part.write_text("ours")
    assert not target.is_symlink()
    # One that was planted where the file aside will be is an error.
    monkeypatch.setattr("grosmc_mj.files.secrets.token_hex", lambda size: "foretold")
    (tmp_path / ".results.foretold.part.json").symlink_to(elsewhere)
    with pytest.raises(SetupError, match="File exists"), written_aside(target) as part:
        part.write_text("others")
    assert (target.read_text(), elsewhere.read_text()) == ("ours", "somebody's")


def test_of_two_writers_the_one_that_ends_last_counts(tmp_path: Path):
    target = tmp_path / "results.json"
    before = os.umask(0o027)
    with written_aside(target) as first, written_aside(target) as second:
        assert (first != second, first.parent, second.parent) == (True, tmp_path, tmp_path)
        first.write_text("first")
        second.write_text("second")
    assert target.read_text() == "first"
    os.umask(before)
    assert list(tmp_path.iterdir()) == [target]
    # It has the mode that the user's mask leaves.
    assert target.stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize(
    "error",
    [ConnectionResetError(errno.ECONNRESET, "reset"), FileNotFoundError(2, "none", "ffmpeg")],
)
def test_an_error_that_is_not_of_its_writing_keeps_its_words(tmp_path: Path, error: OSError):
    with pytest.raises(type(error)) as raised, written_aside(tmp_path / "results.json"):
        raise error
    assert raised.value is error
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "harm",
    [lambda part: Path("/dev/full").write_text("1"), Path.unlink],
    ids=["full", "gone"],
)
def test_an_error_of_its_writing_names_the_file(tmp_path: Path, harm):
    target = tmp_path / "results.json"
    line = rf"cannot write {target}: No s.*; free the disk"
    with pytest.raises(SetupError, match=line), written_aside(target) as part:
        harm(part)
    assert not list(tmp_path.iterdir())


def test_the_cache_is_for_its_owner_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = private_cache(str(tmp_path))
    assert folder is not None
    # What others could only read is made private; what they could write to is not believed.
    folder.chmod(0o755)
    assert private_cache(str(tmp_path)) == folder
    assert folder.stat().st_mode & 0o777 == 0o700
    (tmp_path / "linked").mkdir()
    (tmp_path / "linked" / "grosmc_mj").symlink_to(folder)
    with pytest.raises(SetupError, match="must be a folder of your own"):
        private_cache(str(tmp_path / "linked"))
    folder.chmod(0o770)
    with pytest.raises(SetupError, match=r"must be a folder of your own with mode 700.*mode 770"):
        private_cache(str(tmp_path))
    folder.chmod(0o700)
    monkeypatch.setattr(os, "getuid", lambda: 4_000_000_000)
    with pytest.raises(SetupError, match=r"must be a folder of your own.*its owner is user \d+"):
        private_cache(str(tmp_path))


def test_without_a_home_there_is_no_cache(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(os, "getuid", lambda: 4_000_000_000)  # no such user
    assert private_cache() is None
    assert not list(tmp_path.iterdir())


def test_what_is_no_file_is_never_replaced(tmp_path: Path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(SetupError, match="a device, a pipe or a socket"), written_aside(pipe):
        pass
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]
