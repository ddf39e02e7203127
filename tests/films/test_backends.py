"""Which OpenGL backend and which ffmpeg are found, and what is said of those that are not there."""

from __future__ import annotations

import ctypes
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from grosmc_mj import cli
from grosmc_mj.errors import SetupError
from grosmc_mj.films.offscreen import (
    BACKENDS,
    candidates,
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
    "DISPLAY",
    "HIDE",
    "IMAGEIO_FFMPEG_EXE",
    "LD_PRELOAD",
    "MUJOCO_EGL_DEVICE_ID",
    "MUJOCO_GL",
    "PYOPENGL_PLATFORM",
    "WAYLAND_DISPLAY",
)
OPENGL = "EGL OSMesa"
NO_GL = (
    "grosmc-mj: no OpenGL backend renders off-screen (egl: libEGL.so.1 is not installed; "
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
# What a probe of a working backend prints.
ANSWER = "renderer: a pretended one"


def without_progress(said: str) -> str:
    """Standard error without the lines that tell now and then how far a command is."""
    return re.sub(r"^\d+ of \d+ .*\n", "", said, flags=re.MULTILINE)


@pytest.fixture(scope="module")
def shim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library for LD_PRELOAD that hides others."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler, which builds what hides a library")
    folder = tmp_path_factory.mktemp("shim")
    source = folder / "hide.c"
    source.write_text(SHIM)
    library = folder / "hide.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    return library


@pytest.fixture(scope="module")
def fonts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Matplotlib's list of fonts, which takes it a second to make."""
    return tmp_path_factory.mktemp("matplotlib")


@pytest.fixture
def no_ffmpeg(tmp_path: Path) -> dict[str, str]:
    """Variables of a process that finds no program at all, imageio-ffmpeg's neither."""
    folder = tmp_path / "no_ffmpeg"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text("import sys\nsys.modules['imageio_ffmpeg'] = None\n")
    return {"PYTHONPATH": str(folder), "PATH": str(folder)}


class Machine:
    """Runs Python in a process of its own, on a machine that lacks some libraries."""

    def __init__(self, shim: Path, fonts: Path, home: Path) -> None:
        self._own = {
            **{name: value for name, value in os.environ.items() if name not in FOREIGN},
            "LD_PRELOAD": str(shim),
            "MPLCONFIGDIR": str(fonts),
            "XDG_CACHE_HOME": str(home),
        }

    def python(self, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
        """Run Python; one that hangs ends with all the processes that it has started."""
        started = subprocess.Popen(
            [sys.executable, *arguments],
            env={**self._own, **variables},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        try:
            out, error = started.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            os.killpg(started.pid, signal.SIGKILL)
            _, error = started.communicate()
            pytest.fail(f"{' '.join(arguments)} hangs; so far on stderr:\n{error}")
        return subprocess.CompletedProcess(arguments, started.returncode, out, error)

    def grosmc(self, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
        return self.python("-m", "grosmc_mj.cli", *arguments, **variables)

    def together(
        self, *commands: tuple[tuple[str, ...], dict[str, str]]
    ) -> list[subprocess.CompletedProcess[str]]:
        """Run several commands, each with its variables, as many at once as there are cores."""
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
            return list(pool.map(lambda each: self.grosmc(*each[0], **each[1]), commands))


@pytest.fixture
def machine(shim: Path, fonts: Path, tmp_path: Path) -> Machine:
    return Machine(shim, fonts, tmp_path / "cache")


@pytest.fixture(autouse=True)
def _bare(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No display, no wish, nothing tried yet, and a cache of one's own."""
    probe.cache_clear()
    for name in FOREIGN:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture
def pretend(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[str], Callable[[], int]]:
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


def echo(answer: str) -> str:
    return f"echo '{answer}'"


# ---- which to try


@pytest.mark.parametrize("wish", [None, "", "  ", "on", "1", "True", "enable "])
def test_without_a_wish_glfw_is_tried_last_and_only_where_there_is_a_display(
    wish: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert candidates(wish) == ["egl", "osmesa"]
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        with monkeypatch.context() as patch:
            patch.setenv(name, ":0")
            assert candidates(wish) == ["egl", "osmesa", "glfw"]
            patch.setenv(name, "")
            assert candidates(wish) == ["egl", "osmesa"]


@pytest.mark.parametrize(
    ("wish", "name"), [("egl", "egl"), ("EGL ", "egl"), (" OSMesa", "osmesa"), ("glfw", "glfw")]
)
def test_a_wish_is_taken_alone_in_any_spelling_that_mujoco_takes(wish: str, name: str) -> None:
    assert candidates(wish) == [name]


@pytest.mark.parametrize("wish", ["banana", "disabled", "egl,osmesa"])
def test_a_wish_that_is_no_backend_names_those_that_are(wish: str) -> None:
    for ask in (candidates, find_backend):
        with pytest.raises(SetupError, match=r"MUJOCO_GL: .*valid: egl, osmesa, glfw"):
            ask(wish)


def test_a_near_miss_is_corrected() -> None:
    with pytest.raises(SetupError, match="did you mean 'osmesa'"):
        candidates("mesa")


# ---- trying one


@pytest.mark.render
@pytest.mark.parametrize("name", ["egl", "osmesa"])
def test_a_backend_whose_library_is_there_renders_the_right_picture(name: str) -> None:
    try:
        ctypes.CDLL(BACKENDS[name][0])
    except OSError:
        pytest.skip(f"{BACKENDS[name][0]} is not installed")
    found = probe(name)
    assert found.works, found.reason
    assert (found.backend, found.reason, found.remedy) == (name, "", "")


def test_glfw_without_a_display_is_not_even_tried(pretend: Callable[[str], Callable]) -> None:
    asked = pretend(echo(ANSWER))
    found = probe("glfw")
    assert not found.works
    assert "no display" in found.reason
    assert found.remedy == ""
    assert asked() == 0


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("kill -SEGV $$", "signal 11"),
        ("exit 3", "code 3"),
        ("exit 0", "code 0"),
        ("echo 'libGL error: no answer here'", "code 0"),
        (f"{echo(ANSWER)}; kill -ABRT $$", "signal 6"),
        (f"{echo(ANSWER)}; exit 3", "code 3"),
        ("echo 'RuntimeError: it renders black frames' >&2; exit 1", "it renders black frames"),
    ],
)
def test_a_trial_that_fails_says_so_in_words(
    script: str,
    reason: str,
    pretend: Callable[[str], Callable],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    pretend(script)
    found = probe("glfw")  # it needs no library, which might be missing here
    assert not found.works
    assert reason in found.reason
    with pytest.raises(SetupError, match=r"no OpenGL backend renders off-screen \(glfw: ") as said:
        find_backend("glfw")
    assert reason in str(said.value)
    assert "\n" not in str(said.value)


def test_a_trial_that_never_ends_is_ended(
    pretend: Callable[[str], Callable], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grosmc_mj.films.offscreen._TIMEOUT", 0.3)
    pretend("exec sleep 100")
    assert "no answer within" in probe("egl").reason


def test_what_is_printed_before_the_answer_is_not_taken_for_it(
    pretend: Callable[[str], Callable],
) -> None:
    pretend(f"echo noise\n{echo(ANSWER)}")
    assert probe("egl").renderer == "a pretended one"


def test_the_trial_has_its_own_backend_and_not_the_users_setting_for_pyopengl(
    monkeypatch: pytest.MonkeyPatch, pretend: Callable[[str], Callable]
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    monkeypatch.setenv("PYOPENGL_PLATFORM", "glx")
    assert rendering("egl") == {"MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": ""}
    pretend('echo "renderer: $MUJOCO_GL, $PYOPENGL_PLATFORM"')
    assert probe("egl").renderer == "egl,"
    assert os.environ["PYOPENGL_PLATFORM"] == "glx"


@pytest.mark.slow
def test_a_display_that_nobody_serves_is_no_reason_to_install_glfw(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("DISPLAY", ":9753")
    found = probe("glfw")
    assert not found.works
    assert found.reason
    assert found.remedy == ""  # MuJoCo itself depends on glfw: it is there


@pytest.mark.slow
@pytest.mark.render
def test_a_file_of_the_users_named_like_a_module_is_not_imported_by_the_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    try:
        name = find_backend().backend
    except SetupError as error:
        pytest.skip(str(error))
    for module in ("mujoco", "numpy", "random"):
        (tmp_path / f"{module}.py").write_text("raise SystemExit('not this one')\n")
    monkeypatch.chdir(tmp_path)
    found = probe(name)
    assert found.works, found.reason


@pytest.mark.slow
@pytest.mark.parametrize("hidden", ["", OPENGL])
def test_the_trial_prints_one_line_or_ends_with_an_error(hidden: str, machine: Machine) -> None:
    done = machine.python("-m", "grosmc_mj.films.probe", MUJOCO_GL="egl", HIDE=hidden)
    if hidden:
        assert done.returncode == 1
        assert done.stdout == ""
    elif done.returncode == 0:
        assert re.fullmatch(r"renderer: .+\n", done.stdout)


# ---- which is taken


def test_the_next_one_is_tried_if_one_fails(pretend: Callable[[str], Callable]) -> None:
    asked = pretend(f"case $MUJOCO_GL in egl) kill -SEGV $$;; osmesa) {echo(ANSWER)};; esac")
    found = find_backend()
    assert (found.backend, found.renderer, asked()) == ("osmesa", "a pretended one", 2)
    with pytest.raises(SetupError, match="egl"):
        find_backend("egl")
    assert find_backend("OSMESA ").backend == "osmesa"


def test_all_that_failed_are_named(pretend: Callable[[str], Callable]) -> None:
    asked = pretend("echo 'it is broken' >&2; exit 1")
    with pytest.raises(SetupError, match=r"\(egl: .*; osmesa: .*\); run: apt-get install"):
        find_backend()
    assert asked() == 2


# ---- importing without graphics


@pytest.mark.parametrize("wish", [None, "", "egl", "banana"])
def test_the_wish_is_the_same_afterwards(wish: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    if wish is not None:
        monkeypatch.setenv("MUJOCO_GL", wish)
    with without_graphics():
        assert os.environ["MUJOCO_GL"] == "disabled"
    assert os.environ.get("MUJOCO_GL") == wish
    with pytest.raises(ZeroDivisionError), without_graphics():
        _ = 1 / 0
    assert os.environ.get("MUJOCO_GL") == wish


@pytest.mark.slow
@pytest.mark.parametrize(("wish", "hidden"), [("egl", "EGL"), ("osmesa", "OSMesa"), ("banana", "")])
def test_mujoco_can_be_imported_without_the_backend_that_is_wished_for(
    wish: str, hidden: str, machine: Machine
) -> None:
    plain = machine.python("-c", "import mujoco", MUJOCO_GL=wish, HIDE=hidden)
    assert plain.returncode == 1  # it is MuJoCo that fails
    guarded = (
        "from grosmc_mj.films.offscreen import without_graphics as w\n"
        "with w():\n import mujoco\n"
        "import os; print(mujoco.mj_versionString(), os.environ['MUJOCO_GL'])"
    )
    done = machine.python("-c", guarded, MUJOCO_GL=wish, HIDE=hidden)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[1] == wish


# ---- ffmpeg


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that is all of PATH."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    return folder


def script(path: Path, text: str) -> None:
    path.write_text(text)
    path.chmod(0o755)


def hide_the_carried_ffmpeg(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)


BROKEN = {
    "exits with 1": ("#!/bin/sh\nexit 1\n", "does not run"),
    "is killed": ("#!/bin/sh\nkill -SEGV $$\n", "does not run"),
    "is no program": ("\x7fELF, or nearly", "does not run"),
    "has no H.264": ("#!/bin/sh\necho ' V..... mpeg4 MPEG-4 part 2'\n", "libx264"),
    "says no version": (
        "#!/bin/sh\ncase $1 in -version) ;; *) echo ' V..... libx264';; esac\n",
        "does not run",
    ),
}


@pytest.mark.parametrize("how", BROKEN)
def test_a_broken_ffmpeg_is_passed_over(how: str, programs: Path) -> None:
    script(programs / "ffmpeg", BROKEN[how][0])
    found = find_ffmpeg()
    assert found.origin == "imageio-ffmpeg"
    assert found.path != str(programs / "ffmpeg")
    assert re.search(r"\d", found.version)


@pytest.mark.parametrize("how", BROKEN)
def test_a_broken_ffmpeg_and_no_other_is_one_line_with_the_command(
    how: str, programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script(programs / "ffmpeg", BROKEN[how][0])
    hide_the_carried_ffmpeg(monkeypatch)
    with pytest.raises(SetupError) as said:
        find_ffmpeg()
    line = str(said.value)
    assert f"system: {programs / 'ffmpeg'}" in line
    assert BROKEN[how][1] in line
    assert "imageio-ffmpeg: not installed" in line
    assert line.endswith("run: apt-get install ffmpeg")
    assert "\n" not in line


def test_the_systems_ffmpeg_comes_first(programs: Path) -> None:
    script(
        programs / "ffmpeg",
        "#!/bin/sh\ncase $1 in -version) echo ffmpeg version 99;; *) echo libx264;; esac\n",
    )
    assert find_ffmpeg() == (str(programs / "ffmpeg"), "system", "99")


def test_without_any_ffmpeg_the_command_is_named(
    programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert list(programs.iterdir()) == []
    hide_the_carried_ffmpeg(monkeypatch)
    with pytest.raises(SetupError, match=r"no ffmpeg \(system: not .*; run: apt-get install ffmp"):
        find_ffmpeg()


# ---- what the command line makes of it


def one_line(error: str) -> bool:
    return error.startswith("grosmc-mj: ") and error.count("\n") == 1


def lines(text: str, beginning: str) -> list[str]:
    return [line.strip() for line in text.splitlines() if line.strip().startswith(beginning)]


@pytest.mark.slow
@pytest.mark.render
def test_doctor_names_versions_cores_backends_and_ffmpeg(machine: Machine) -> None:
    done = machine.grosmc("doctor")
    assert (done.returncode, without_progress(done.stderr)) == (cli.DONE, "")
    for package in ("python", "grosmc_mj", "mujoco", "numpy", "numba"):
        assert re.search(rf"^ +{package} +\d+\.\d+", done.stdout, re.MULTILINE)
    assert lines(done.stdout, "cores") == [f"cores        {len(os.sched_getaffinity(0))}"]
    for name in BACKENDS:
        (line,) = lines(done.stdout, f"{name} ")
        assert re.match(rf"{name} +(works|no: )", line)
    assert done.stdout.count("films use it") == 1
    assert re.search(r"(system|imageio-ffmpeg) +works: \S*\d\S*,\s/\S+", done.stdout)
    assert lines(done.stdout, "run:") == lines(done.stdout, "missing:") == []
    assert done.stdout.startswith("Films can be made.\n")


@pytest.mark.slow
@pytest.mark.render
def test_without_egl_and_the_systems_ffmpeg_others_take_their_places(
    machine: Machine, tmp_path: Path
) -> None:
    try:
        ctypes.CDLL(BACKENDS["osmesa"][0])
    except OSError:
        pytest.skip("libOSMesa, which takes the place of libEGL, is not installed")
    done = machine.grosmc("doctor", HIDE="EGL", PATH=str(tmp_path))
    assert (done.returncode, without_progress(done.stderr)) == (cli.DONE, "")
    (egl,) = lines(done.stdout, "egl ")
    assert "libEGL.so.1 is not installed; run: apt-get install libegl1 libgl1-mesa-dri" in egl
    assert lines(done.stdout, "osmesa ")[0].startswith("osmesa       works, films use it: ")
    (ffmpeg,) = lines(done.stdout, "imageio-ffmpeg ")
    assert re.search(r"works: \S*\d\S*, /\S+$", ffmpeg)
    assert done.stdout.startswith("Films can be made.\n")


@pytest.mark.slow
def test_doctor_names_one_command_for_each_thing_that_is_missing(
    machine: Machine, no_ffmpeg: dict[str, str]
) -> None:
    done = machine.grosmc("doctor", HIDE=OPENGL, **no_ffmpeg)
    assert (done.returncode, without_progress(done.stderr)) == (cli.DIFFERS, "")
    assert lines(done.stdout, "run:") == [
        "run: apt-get install libegl1 libgl1-mesa-dri",
        "run: apt-get install ffmpeg",
    ]
    assert len(lines(done.stdout, "missing:")) == 2
    assert lines(done.stdout, "osmesa ")[0].endswith("run: apt-get install libosmesa6")
    assert "Films cannot be made" in done.stdout


@pytest.mark.parametrize(
    ("wish", "problem", "remedies"),
    [
        ("banana", "unknown backend 'banana'", ["run: unset MUJOCO_GL"]),
        ("glfw", "no OpenGL backend renders off-screen (glfw: no display", []),
    ],
)
def test_a_wish_that_cannot_be_met_is_a_problem_though_others_work(
    wish: str,
    problem: str,
    remedies: list[str],
    pretend: Callable[[str], Callable],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pretend(echo(ANSWER))
    monkeypatch.setenv("MUJOCO_GL", wish)
    with pytest.raises(SystemExit) as stop:
        cli.main(["doctor"])
    assert stop.value.code == cli.DIFFERS
    said = capsys.readouterr().out
    assert [lines(said, f"{name} ")[0].split()[1][:2] for name in BACKENDS] == ["wo", "wo", "no"]
    (missing,) = lines(said, "missing:")
    assert problem in missing
    assert lines(said, "run:") == remedies


FILM = ("film", "servo", "-o", os.devnull + "/f.mp4")


@pytest.mark.slow
def test_a_film_without_its_backend_or_ffmpeg_is_one_line(
    machine: Machine, no_ffmpeg: dict[str, str]
) -> None:
    expected: list[tuple[dict[str, str], str]] = [
        ({"HIDE": OPENGL}, NO_GL),
        (
            {"HIDE": "EGL", "MUJOCO_GL": "egl"},
            "(egl: libEGL.so.1 is not installed); run: apt-get install libegl1 libgl1-mesa-dri",
        ),
        (
            {"HIDE": "OSMesa", "MUJOCO_GL": "osmesa"},
            "(osmesa: libOSMesa.so.8 is not installed); run: apt-get install libosmesa6",
        ),
        (
            no_ffmpeg,
            "grosmc-mj: no ffmpeg (system: not installed; imageio-ffmpeg: not installed); "
            "run: apt-get install ffmpeg\n",
        ),
    ]
    found = machine.together(*((FILM, variables) for variables, _ in expected))
    for done, (_, says) in zip(found, expected, strict=True):
        assert (done.returncode, done.stdout) == (cli.WRONG, "")
        assert says in done.stderr
        assert one_line(done.stderr)


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
        cli.main(FILM)
    assert stop.value.code == cli.WRONG
    said = capsys.readouterr()
    assert said.out == ""
    assert says in said.err
    assert one_line(said.err)


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
def test_what_makes_no_films_needs_no_backend(machine: Machine, tmp_path: Path) -> None:
    compare = f"run servo/nominal --no-figures --out {tmp_path}"
    for wish, library in (("egl", "EGL"), ("osmesa", "OSMesa")):
        done = machine.python("-c", COMMANDS, "list", compare, MUJOCO_GL=wish, HIDE=library)
        assert (done.returncode, without_progress(done.stderr)) == (0, "")
        listed, compared, rest = done.stdout.split(f"code {cli.DONE}\n")
        assert rest == ""
        assert "servo" in listed
        assert "servo" in compared


@pytest.mark.slow
def test_validate_without_opengl_does_all_but_the_films(machine: Machine, tmp_path: Path) -> None:
    nowhere, elsewhere = tmp_path / "nowhere", tmp_path / "elsewhere"
    filmed, drawn = machine.together(
        (("validate", "servo/nominal", "--films", "--out", str(nowhere)), {"HIDE": OPENGL}),
        (("validate", "servo/case1", "--out", str(elsewhere)), {"HIDE": "EGL", "MUJOCO_GL": "egl"}),
    )
    for done, folder in ((filmed, nowhere), (drawn, elsewhere)):
        assert (done.returncode, without_progress(done.stderr)) == (cli.DONE, "")
        assert "All 4 runs are as recorded." in done.stdout
        assert json.loads((folder / "validation.json").read_text())["complete"] is True
    assert lines(filmed.stdout, "No films") == [NO_GL.strip().replace("grosmc-mj:", "No films:")]
    assert not (nowhere / "films").exists()
    assert list(elsewhere.rglob("*.png"))
