"""Stored pieces of long work: read as they were written, refused if they are not."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from grosmc_mj.ground.errors import SetupError
from grosmc_mj.studies.pieces import Piece, PieceStore, Rows, held


class Share(BaseModel):
    """Row of a study."""

    law: str
    share: float


ROW = Share(law="lqr", share=math.inf)
PIECE = Piece.named_by(["servo", "lqr", 1], "lqr of this study")


@pytest.fixture
def pieces(tmp_path: Path) -> PieceStore[Share]:
    """A store of one row."""
    stored = PieceStore(tmp_path, Rows(Share))
    stored.write(PIECE, ROW)
    return stored


def test_a_piece_is_read_as_it_was_written(pieces: PieceStore[Share]) -> None:
    assert pieces.read(PIECE) == ROW


@pytest.mark.parametrize("other", [["servo", "lqr", 2], ["servo", "lqr"], ["servo", "lqr", 1.5]])
def test_a_piece_that_depends_on_something_else_is_missing(
    other: Any, pieces: PieceStore[Share]
) -> None:
    assert pieces.read(Piece.named_by(other, "another one")) is None


def change_number(content: dict[str, Any]) -> None:
    content["row"]["share"] = 0.5


def change_dependence(content: dict[str, Any]) -> None:
    content["depends_on"] = "0" * 64


def drop_checksum(content: dict[str, Any]) -> None:
    del content["sha256"]


@pytest.mark.parametrize("damage", [change_number, change_dependence, drop_checksum])
def test_a_changed_piece_is_refused(
    damage: Callable[[dict[str, Any]], None], pieces: PieceStore[Share]
) -> None:
    file = pieces.file(PIECE)
    content = json.loads(file.read_text())
    damage(content)
    file.write_text(json.dumps(content))
    with pytest.raises(SetupError, match="is damaged, or is not lqr of this study: remove it"):
        pieces.read(PIECE)


def test_a_piece_that_was_cut_off_is_refused(pieces: PieceStore[Share]) -> None:
    file = pieces.file(PIECE)
    file.write_bytes(file.read_bytes()[:-9])
    with pytest.raises(SetupError, match="--resume runs it again"):
        pieces.read(PIECE)


def test_an_unfinished_file_is_removed_and_a_finished_one_stays(pieces: PieceStore[Share]) -> None:
    unfinished = pieces.folder / ".lqr.0123456789abcdef.part.json"
    unfinished.write_text("{")
    pieces.remove_unfinished()
    assert not unfinished.exists()
    assert pieces.read(PIECE) == ROW


def test_a_folder_is_held_by_one_at_a_time(tmp_path: Path) -> None:
    with held(tmp_path), pytest.raises(SetupError, match="wait for its end"), held(tmp_path):
        pass
    with held(tmp_path):
        pass
