"""Which OpenGL backend and which ffmpeg are found, and what is said of those that are not there."""

from __future__ import annotations

import ctypes
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from grosmc_mj import cli
from grosmc_mj.errors import SetupError
from grosmc_mj.films.offscreen import (
    BACKENDS,
    find_backend,
    find_ffmpeg,
    probe,
    rendering,
    without_graphics,
)

# Far above what any of these commands takes; one that hangs is to be told from one that is slow.
PATIENCE = 300.0
# What would decide for the tests.
FOREIGN = (
    "DISPLAY", "HIDE", "IMAGEIO_FFMPEG_EXE", "LD_PRELOAD", "MUJOCO_EGL_DEVICE_ID", "MUJOCO_GL",
    "PYOPENGL_PLATFORM", "WAYLAND_DISPLAY",
)  # fmt: skip
OPENGL = "EGL OSMesa"
NO_GL = (
    "no OpenGL backend renders off-screen (egl: libEGL.so.1 is not installed; "
    "osmesa: libOSMesa.so.8 is not installed); run: apt-get install libegl1 libgl1-mesa-dri\n"
)
# dlopen finds no library whose name has a word of $HIDE in it.
SHIM = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <string.h>

void *dlopen(const char *name, int flags) {
  void *(*real)(const char *, int) = (void *(*)(const char *, int))dlsym(RTLD_NEXT, "dlopen");
  const char *hidden = getenv("HIDE");
  char words[256] = "", *rest = NULL, *word;
  if (name && hidden) {
    strncpy(words, hidden, sizeof words - 1);
    for (word = strtok_r(words, " ", &rest); word; word = strtok_r(NULL, " ", &rest))
      if (strstr(name, word)) return real("hidden-by-a-test.so", flags);
  }
  return real(name, flags);
}
"""
ANSWER = "echo 'renderer: a pretended one'"
Pretend = Callable[[str], Callable[[], int]]


@pytest.fixture(scope="module")
def shim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library for LD_PRELOAD that hides others."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler, which builds what hides a library")
    library = tmp_path_factory.mktemp("shim") / "hide.so"
    source = library.with_suffix(".c")
    source.write_text(SHIM)
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    return library


Machine = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def machine(shim: Path, tmp_path: Path) -> Machine:
    """Runs Python in a process of its own, on a machine that lacks some libraries."""

    def run(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
        own = {name: value for name, value in os.environ.items() if name not in FOREIGN}
        own |= {"LD_PRELOAD": str(shim), "XDG_CACHE_HOME": str(tmp_path / "cache")}
        done = subprocess.run(
            [sys.executable, *arguments], env=own | variables, capture_output=True, text=True,
            check=False, timeout=PATIENCE,
        )  # fmt: skip
        # Lines that tell now and then how far a command is.
        done.stderr = re.sub(r"^\d+ of \d+ .*\n", "", done.stderr, flags=re.MULTILINE)
        return done

    return run


@pytest.fixture
def no_ffmpeg(tmp_path: Path) -> dict[str, str]:
    """Variables of a process that finds no program at all, imageio-ffmpeg's neither."""
    folder = tmp_path / "no_ffmpeg"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text("import sys\nsys.modules['imageio_ffmpeg'] = None\n")
    return {"PYTHONPATH": str(folder), "PATH": str(folder)}


@pytest.fixture(autouse=True)
def _bare(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No display, no wish, nothing tried yet, and a cache of one's own."""
    probe.cache_clear()
    for name in FOREIGN:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture
def pretend(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Pretend:
    """Let a shell script answer in place of the probe; what it returns counts the questions."""
    program, asked = tmp_path / "interpreter", tmp_path / "asked"
    asked.write_text("")
    monkeypatch.setattr(sys, "executable", str(program))

    def answer(script: str) -> Callable[[], int]:
        probe.cache_clear()
        program.write_text(f"#!/bin/sh\necho x >>'{asked}'\n{script}\n")
        program.chmod(0o755)
        return lambda: asked.read_text().count("x")

    return answer


# Which backend is taken


@pytest.mark.parametrize(
    ("wish", "display", "tried"),
    [(None, "", "egl, osmesa"), (" ", ":0", "egl, osmesa, glfw"), ("EGL ", "", "egl"),
     (" OSMesa", ":0", "osmesa")],
)  # fmt: skip
def test_a_wish_is_tried_alone_else_glfw_last_where_there_is_a_display(
    wish: str | None, display: str, tried: str, pretend: Pretend, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WAYLAND_DISPLAY", display)
    asked = pretend("echo 'it is broken' >&2; exit 1")
    with pytest.raises(SetupError) as said:
        find_backend(wish)
    names = re.findall(r"(\w+): (?:it is broken|lib\w+)", str(said.value))
    assert ", ".join(names) == tried
    assert asked() == len(names)


def test_the_next_one_is_tried_if_one_fails_and_none_twice(pretend: Pretend) -> None:
    asked = pretend(f"case $MUJOCO_GL in egl) kill -SEGV $$;; osmesa) echo noise; {ANSWER};; esac")
    for _ in range(2):
        found = find_backend()
        assert (found.backend, found.renderer, asked()) == ("osmesa", "a pretended one", 2)
    with pytest.raises(SetupError, match="egl"):
        find_backend("egl")


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("kill -SEGV $$", "exit code -11"),
        ("exit 3", "exit code 3"),
        ("echo 'libGL error: no answer here'", "exit code 0"),
        (f"{ANSWER}; kill -ABRT $$", "exit code -6"),
        ("echo 'RuntimeError: it renders black frames' >&2; exit 1", "it renders black frames"),
    ],
)
def test_a_trial_that_fails_says_so_in_one_line(
    script: str, reason: str, pretend: Pretend, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    pretend(script)
    # It needs no library, which might be missing here.
    with pytest.raises(SetupError, match=r"no OpenGL backend renders off-screen \(glfw: ") as said:
        find_backend("glfw")
    assert reason in str(said.value)
    assert "\n" not in str(said.value)


def test_a_trial_that_never_ends_is_ended(
    pretend: Pretend, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grosmc_mj.films.offscreen._TIMEOUT", 0.3)
    pretend("exec sleep 100")
    assert "no answer within" in probe("egl").reason


def test_the_trial_has_its_own_backend_and_not_the_users_setting_for_pyopengl(
    monkeypatch: pytest.MonkeyPatch, pretend: Pretend
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    monkeypatch.setenv("PYOPENGL_PLATFORM", "glx")
    assert rendering("egl") == {"MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": ""}
    pretend('echo "renderer: $MUJOCO_GL, $PYOPENGL_PLATFORM"')
    assert probe("egl").renderer == "egl,"
    assert "no display" in probe("glfw").reason


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize("name", ["egl", "osmesa"])
def test_a_backend_whose_library_is_there_renders_the_right_picture(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever files of the user's own are named like the modules that it needs."""
    try:
        ctypes.CDLL(BACKENDS[name][0])
    except OSError:
        pytest.skip(f"{BACKENDS[name][0]} is not installed")
    for module in ("mujoco", "numpy", "random"):
        (tmp_path / f"{module}.py").write_text("raise SystemExit('not this one')\n")
    monkeypatch.chdir(tmp_path)
    found = probe(name)
    assert (found.works, found.backend, found.reason, found.remedy) == (True, name, "", "")


# Importing without graphics


@pytest.mark.parametrize("wish", [None, "", "egl", "banana"])
def test_the_wish_is_the_same_afterwards(wish: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    if wish is not None:
        monkeypatch.setenv("MUJOCO_GL", wish)
    with without_graphics():
        assert os.environ["MUJOCO_GL"] == "disabled"
    assert os.environ.get("MUJOCO_GL") == wish


# ffmpeg


def test_imageio_s_ffmpeg_is_taken_and_a_machine_without_any_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    found = find_ffmpeg()
    assert Path(found.path).is_file()
    assert re.search(r"\d", found.version)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(SetupError, match=r"no ffmpeg \(.*\); run: apt-get install ffmpeg"):
        find_ffmpeg()


# What the commands make of it


def lines(text: str, beginning: str) -> list[str]:
    return [line.strip() for line in text.splitlines() if line.strip().startswith(beginning)]


@pytest.mark.parametrize(
    ("wish", "says"),
    [
        ("glfw", "(glfw: no display (DISPLAY and WAYLAND_DISPLAY are not set))"),
        ("banana", "MUJOCO_GL: unknown backend 'banana': valid: egl, osmesa, glfw; run: unset"),
    ],
)
def test_a_film_with_a_wish_that_cannot_be_met_is_one_line(
    wish: str,
    says: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("MUJOCO_GL", wish)
    with pytest.raises(SystemExit) as stop:
        cli.main(("film", "servo", "--duration", "0.1", "-o", "f.mp4"))
    assert stop.value.code == cli.WRONG
    said = capsys.readouterr()
    assert (said.out, said.err.count("\n")) == ("", 1)
    assert says in said.err


# Commands, one after another in one process.
COMMANDS = """
import sys
from grosmc_mj import cli

for command in sys.argv[1:]:
    try:
        cli.main(command.split())
    except SystemExit as stop:
        print("code", stop.code)
"""


@pytest.mark.slow
@pytest.mark.parametrize(("wish", "library"), [("egl", "EGL"), ("osmesa", "OSMesa")])
def test_without_its_backend_all_works_but_the_films(
    wish: str, library: str, machine: Machine, tmp_path: Path
) -> None:
    done = machine(
        "-c", COMMANDS, "list", f"validate servo/nominal --films --out {tmp_path}",
        MUJOCO_GL=wish, HIDE=library,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    listed, validated, _ = done.stdout.split(f"code {cli.DONE}\n")
    assert "servo" in listed
    assert "All 4 runs are as recorded." in validated
    assert lines(validated, f"No films: no OpenGL backend renders off-screen ({wish}: lib")
    assert json.loads((tmp_path / "validation.json").read_text())["complete"] is True
    assert not (tmp_path / "films" / "servo_nominal.mp4").exists()


@pytest.mark.slow
def test_without_any_opengl_or_ffmpeg_a_film_is_one_line(
    machine: Machine, no_ffmpeg: dict[str, str]
) -> None:
    film = ("-m", "grosmc_mj.cli", "film", "servo", "--duration", "0.1", "-o", "f.mp4")
    for variables, says in (
        ({"HIDE": OPENGL}, NO_GL),
        (no_ffmpeg, "run: apt-get install ffmpeg\n"),
    ):
        done = machine(*film, **variables)
        assert (done.returncode, done.stdout) == (cli.WRONG, "")
        assert done.stderr.endswith(says)
        assert done.stderr.count("\n") == 1
