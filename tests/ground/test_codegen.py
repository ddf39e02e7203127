"""Sources of generated functions on disk: they spare sympy's work and change nothing."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
import sympy as sp

from grosmc_mj.ground.compilation import codegen
from grosmc_mj.ground.compilation.codegen import generate

X = sp.symbols("x0 x1")
PLACES = {X[0]: "x[0]", X[1]: "x[1]"}
POINT = (0.3, -1.7)
EXPRESSION = sp.sin(X[0]) / (1 + sp.sin(X[0]) ** 2) + X[1]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, and the folder of sources in it."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    return tmp_path / "grosmc_mj" / "generated"


def generated(expression: Any = EXPRESSION) -> float:
    """Value of a function of one expression at ``POINT``."""
    return generate("value", [expression], "x", PLACES)(POINT)[0]


def test_a_source_on_disk_spares_the_search_for_common_parts(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = generated()

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("sympy was asked again")

    monkeypatch.setattr(codegen.sp, "cse", refuse)
    assert generated() == first
    assert len(list(folder.iterdir())) == 1


def test_another_expression_has_a_source_of_its_own(folder: Path) -> None:
    assert generated(sp.sin(X[0])) == math.sin(POINT[0])
    assert generated(sp.cos(X[0])) == math.cos(POINT[0])
    assert len(list(folder.iterdir())) == 2


def test_namesake_dummy_symbols_in_one_place_share_a_source(folder: Path) -> None:
    for _ in range(2):
        u = sp.Dummy("u")
        assert generate("twice", [2 * u], "u", {u: "u[0]"})((3.0,)) == (6.0,)
    assert len(list(folder.iterdir())) == 1


@pytest.mark.parametrize("content", [b"", b"def value(x):\n    return (", b"\xff\xfe", b"x = 1\n"])
def test_a_damaged_source_is_written_again(content: bytes, folder: Path) -> None:
    expected = generated()
    (source,) = folder.iterdir()
    intact = source.read_bytes()
    source.write_bytes(content)
    assert generated() == expected
    assert source.read_bytes() == intact


def test_a_function_is_generated_where_no_cache_can_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "file"
    file.touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(file))
    assert generated(X[0] * X[1]) == POINT[0] * POINT[1]
