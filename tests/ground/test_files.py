"""Files are whole or not there, and nobody else decides where they are written."""

import errno
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from commands import Patch

from grosmc_mj.ground.errors import ArgumentError, SetupError
from grosmc_mj.ground.files import (
    LARGEST_TEXT,
    atomic_write,
    name_in_files,
    private_cache,
    require_folder,
    require_regular,
)

# The number of no user.
NOBODY = 4_000_000_000


@pytest.fixture
def elsewhere(tmp_path: Path) -> Path:
    """A file of somebody else."""
    path = tmp_path / "elsewhere"
    path.write_text("somebody's")
    return path


@pytest.fixture
def over_a_link(elsewhere: Path, tmp_path: Path) -> Path:
    """A file that was written where a link led to the other one."""
    target = tmp_path / "results.json"
    target.symlink_to(elsewhere)
    with atomic_write(target) as part:
        part.write_text("ours")
    return target


def test_a_link_at_the_path_is_replaced(over_a_link: Path) -> None:
    assert not over_a_link.is_symlink()
    assert over_a_link.read_text() == "ours"


@pytest.mark.usefixtures("over_a_link")
def test_a_link_at_the_path_is_not_followed(elsewhere: Path) -> None:
    assert elsewhere.read_text() == "somebody's"


def test_a_link_at_the_temporary_path_is_an_error(
    elsewhere: Path, tmp_path: Path, monkeypatch: Patch
) -> None:
    target = tmp_path / "results.json"
    target.write_text("ours")
    monkeypatch.setattr("grosmc_mj.ground.files.secrets.token_hex", lambda size: "foretold")
    (tmp_path / ".results.foretold.part.json").symlink_to(elsewhere)
    with pytest.raises(SetupError, match="File exists"), atomic_write(target) as part:
        part.write_text("others")
    assert target.read_text() == "ours"
    assert elsewhere.read_text() == "somebody's"


def test_of_two_writers_the_one_that_ends_last_counts(tmp_path: Path) -> None:
    target = tmp_path / "results.json"
    with atomic_write(target) as first, atomic_write(target) as second:
        assert first != second
        assert first.parent == second.parent == tmp_path
        first.write_text("first")
        second.write_text("second")
    assert target.read_text() == "first"
    assert list(tmp_path.iterdir()) == [target]


@pytest.fixture
def mask() -> Iterator[None]:
    before = os.umask(0o027)
    yield
    os.umask(before)


@pytest.mark.usefixtures("mask")
def test_a_file_has_the_mode_that_the_user_s_mask_leaves(tmp_path: Path) -> None:
    target = tmp_path / "results.json"
    with atomic_write(target) as part:
        part.write_text("ours")
    assert target.stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize(
    "error",
    [ConnectionResetError(errno.ECONNRESET, "reset"), FileNotFoundError(2, "none", "ffmpeg")],
)
def test_an_error_that_is_not_of_its_writing_keeps_its_words(
    tmp_path: Path, error: OSError
) -> None:
    with pytest.raises(type(error)) as raised, atomic_write(tmp_path / "results.json"):
        raise error
    assert raised.value is error
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "harm",
    [lambda part: Path("/dev/full").write_text("1"), Path.unlink],
    ids=["full", "gone"],
)
def test_an_error_of_its_writing_names_the_file(tmp_path: Path, harm) -> None:
    target = tmp_path / "results.json"
    line = rf"cannot write {target}: No s.*; free the disk"
    with pytest.raises(SetupError, match=line), atomic_write(target) as part:
        harm(part)
    assert not list(tmp_path.iterdir())


def test_a_pipe_is_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(SetupError, match="a device, a pipe or a socket"), atomic_write(pipe):
        pass
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]


def test_a_folder_below_a_file_is_refused_before_it_is_made(elsewhere: Path) -> None:
    with pytest.raises(SetupError, match="elsewhere is a file, and a folder is needed"):
        require_folder(elsewhere / "results" / "runs")


def test_a_name_in_files_keeps_letters_digits_and_the_signs_of_numbers() -> None:
    assert name_in_files("fl-pid, quick/0.5+é") == "fl-pid_quick_0.5+é"


# The cache.


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    folder = private_cache(str(tmp_path))
    assert folder is not None
    return folder


def test_a_cache_that_others_could_read_is_made_private(cache: Path, tmp_path: Path) -> None:
    cache.chmod(0o755)
    assert private_cache(str(tmp_path)) == cache
    assert cache.stat().st_mode & 0o777 == 0o700


def test_a_cache_that_others_could_write_to_is_refused(cache: Path, tmp_path: Path) -> None:
    cache.chmod(0o770)
    with pytest.raises(SetupError, match=r"must be a folder of your own with mode 700.*mode 770"):
        private_cache(str(tmp_path))


def test_a_cache_that_is_a_link_is_refused(cache: Path, tmp_path: Path) -> None:
    linked = tmp_path / "linked"
    linked.mkdir()
    (linked / "grosmc_mj").symlink_to(cache)
    with pytest.raises(SetupError, match="must be a folder of your own"):
        private_cache(str(linked))


@pytest.mark.usefixtures("cache")
def test_a_cache_of_another_user_is_refused(tmp_path: Path, monkeypatch: Patch) -> None:
    monkeypatch.setattr(os, "getuid", lambda: NOBODY)
    with pytest.raises(SetupError, match=r"must be a folder of your own.*its owner is user \d+"):
        private_cache(str(tmp_path))


def test_without_a_home_there_is_no_cache(tmp_path: Path, monkeypatch: Patch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(os, "getuid", lambda: NOBODY)
    assert private_cache() is None
    assert not list(tmp_path.iterdir())


def test_a_pipe_is_not_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ArgumentError, match="pipe is a folder, a pipe, a socket or a device"):
        require_regular(tmp_path / "pipe")


def test_a_file_larger_than_what_is_read_is_refused_unread(tmp_path: Path) -> None:
    with (tmp_path / "sparse").open("wb") as file:
        file.truncate(LARGEST_TEXT + 1)
    with pytest.raises(ArgumentError, match="has 256 MB: at most 256 MB are read"):
        require_regular(tmp_path / "sparse")


def test_a_file_that_is_not_there_is_left_to_its_reader(tmp_path: Path) -> None:
    require_regular(tmp_path / "none")
