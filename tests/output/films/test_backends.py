"""OpenGL backends and ffmpeg: the choice among them, and the errors without them."""

from __future__ import annotations

import ctypes
import os
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from commands import run

from grosmc_mj import cli
from grosmc_mj.ground.errors import SetupError
from grosmc_mj.output.films import offscreen
from grosmc_mj.output.films.offscreen import find_backend, find_ffmpeg, probe, without_graphics

ANSWER = "echo 'renderer: a pretended one'"
Pretend = Callable[[str], Callable[[], int]]


@pytest.fixture(autouse=True)
def _bare(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """No display, no chosen backend, no trial yet, and an empty cache folder."""
    probe.cache_clear()
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL", "PYOPENGL_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    yield
    probe.cache_clear()


@pytest.fixture
def pretend(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Pretend:
    """Let a shell script answer in place of the trial; the function returned counts the trials."""
    program = tmp_path / "interpreter"
    trials = tmp_path / "trials"
    monkeypatch.setattr(sys, "executable", str(program))

    def answer(script: str) -> Callable[[], int]:
        probe.cache_clear()
        trials.write_text("")
        program.write_text(f"#!/bin/sh\necho x >>'{trials}'\n{script}\n")
        program.chmod(0o755)
        return lambda: trials.read_text().count("x")

    return answer


@pytest.mark.parametrize(
    ("wish", "display", "tried"),
    [
        (None, "", "egl, osmesa"),
        (" ", ":0", "egl, osmesa, glfw"),
        ("EGL ", ":0", "egl"),
    ],
)
def test_a_wish_is_tried_alone_else_glfw_last_where_there_is_a_display(
    wish: str | None, display: str, tried: str, pretend: Pretend, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WAYLAND_DISPLAY", display)
    count = pretend("echo 'it is broken' >&2; exit 1")
    with pytest.raises(SetupError) as error:
        find_backend(wish)
    names = re.findall(r"(\w+): (?:it is broken|lib\w+)", str(error.value))
    assert ", ".join(names) == tried
    assert count() == len(names)


def test_an_unknown_backend_is_refused(pretend: Pretend) -> None:
    pretend("exit 1")
    with pytest.raises(SetupError, match=r"MUJOCO_GL: unknown backend 'banana': .*run: unset MUJO"):
        find_backend("banana")


def test_the_next_backend_is_tried_if_one_fails_but_none_twice(pretend: Pretend) -> None:
    count = pretend(f"case $MUJOCO_GL in egl) kill -SEGV $$;; osmesa) echo noise; {ANSWER};; esac")
    for _ in range(2):
        trial = find_backend()
        assert trial.backend == "osmesa"
        assert trial.renderer == "a pretended one"
        assert count() == 2


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("kill -SEGV $$", "exit code -11"),
        (f"{ANSWER}; kill -ABRT $$", "exit code -6"),
        ("echo 'RuntimeError: it renders black frames' >&2; exit 1", "it renders black frames"),
        ("exec sleep 100", "no answer within 0.3 s"),
    ],
)
def test_a_trial_that_fails_says_so_in_one_line(
    script: str, reason: str, pretend: Pretend, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(offscreen, "_TIMEOUT", 0.3)
    pretend(script)
    # It needs no library, which might be missing here.
    with pytest.raises(SetupError, match=r"no OpenGL backend renders off-screen \(glfw: ") as error:
        find_backend("glfw")
    assert reason in str(error.value)
    assert "\n" not in str(error.value)


def test_a_trial_has_its_own_environment(monkeypatch: pytest.MonkeyPatch, pretend: Pretend) -> None:
    """Neither the user's backend nor the user's setting for PyOpenGL."""
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    monkeypatch.setenv("PYOPENGL_PLATFORM", "glx")
    pretend('echo "renderer: $MUJOCO_GL, $PYOPENGL_PLATFORM"')
    assert probe("egl").renderer == "egl,"
    assert "no display" in probe("glfw").reason


def test_graphics_are_disabled_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    with without_graphics():
        assert os.environ["MUJOCO_GL"] == "disabled"
    assert os.environ["MUJOCO_GL"] == "glfw"


@pytest.mark.slow
@pytest.mark.render
def test_a_backend_that_works_renders_whatever_the_user_s_files_are_called(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("mujoco", "numpy", "random"):
        (tmp_path / f"{module}.py").write_text("raise SystemExit('not this one')\n")
    monkeypatch.chdir(tmp_path)
    try:
        assert find_backend().works
    except SetupError as error:
        pytest.skip(str(error))


FILM = ("film", "servo/nominal", "--laws", "lqr", "--to", "0.1", "-o", "f.mp4")
CASE = ("run", "servo/nominal", "--laws", "lqr", "--no-figures")
NO_OPENGL = (
    "no OpenGL backend renders off-screen (egl: libEGL.so.1 is not installed; "
    "osmesa: libOSMesa.so.8 is not installed); run: apt-get install libegl1 libgl1-mesa-dri\n"
)


@pytest.fixture
def _without_opengl(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pretend: Pretend) -> None:
    pretend("exit 1")
    monkeypatch.chdir(tmp_path)
    load = ctypes.CDLL

    def hidden(name: str, *arguments: Any, **options: Any) -> Any:
        if name in ("libEGL.so.1", "libOSMesa.so.8"):
            raise OSError(name)
        return load(name, *arguments, **options)

    monkeypatch.setattr(ctypes, "CDLL", hidden)


def test_ffmpeg_is_found() -> None:
    assert Path(find_ffmpeg().path).is_file()


@pytest.mark.usefixtures("_without_opengl")
def test_without_opengl_a_film_is_refused_with_the_remedy(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(*FILM) == cli.WRONG
    assert capsys.readouterr().err == f"grosmc-mj: {NO_OPENGL}"


@pytest.mark.usefixtures("_without_opengl")
def test_without_opengl_a_run_has_all_but_its_film(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(*CASE, "--film") == cli.DONE
    assert f"No films: {NO_OPENGL}" in capsys.readouterr().out


@pytest.mark.usefixtures("_without_opengl")
def test_without_opengl_or_ffmpeg_one_line_has_both_remedies(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    assert run(*FILM) == cli.WRONG
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    remedies = re.findall(r"run: (apt-get [^;\n]*)", error)
    assert remedies == ["apt-get install libegl1 libgl1-mesa-dri", "apt-get install ffmpeg"]
