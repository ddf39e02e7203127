"""Films being written: interrupts, deaths, full disks, and what is left behind of them."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import hear_interrupts
from shipped import find_case, run_case

from grosmc_mj import cli
from grosmc_mj.cli import screen
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.experiments.films import film_of
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.films.film import Format
from grosmc_mj.films.frames import Storyboard
from grosmc_mj.films.offscreen import find_backend, find_ffmpeg
from grosmc_mj.films.storyboard import storyboard
from grosmc_mj.films.workers import draw_frames
from grosmc_mj.films.write import write_film

pytestmark = [pytest.mark.render, pytest.mark.slow]

# Far above what these films take; one that hangs is to be told from one that is slow.
PATIENCE = 300.0
WORKER = "grosmc_mj.films.workers"
# Within this a process that has been told to end has ended [s]; the workers look for their parent
# once a second.
SOON = 10.0
SMALL = Format(width=320, height=240, fps=10, stop=1.2)
FILM = ("cart_pendulum/nominal", "--controllers", "lqr", "--size", "320x240")
SHORT = (*FILM, "--fps", "10", "--to", "0.3", "--workers", "1")
# Long enough to be interrupted.
LONG = (*FILM, "--fps", "60", "--speed", "0.2")
INTERRUPTED = "grosmc-mj: interrupted; run the same command again to start over\n"


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache of these tests' own, where the backend is found once."""
    return tmp_path_factory.mktemp("home")


@pytest.fixture(scope="module")
def backend(home: Path) -> str:
    """What renders here; without it, or without ffmpeg, there is nothing to test."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(home))
        try:
            find_ffmpeg()
            return find_backend(os.environ.get("MUJOCO_GL")).backend
        except SetupError as error:
            pytest.skip(f"no films can be made here: {error}")


def _own_variables(patch: pytest.MonkeyPatch, home: Path) -> None:
    patch.setenv("XDG_CACHE_HOME", str(home))
    patch.setenv("MPLCONFIGDIR", str(home / "matplotlib"))


@pytest.fixture(autouse=True)
def _own_cache(backend: str, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert backend
    _own_variables(monkeypatch, home)


@cache
def board(form: Format = SMALL) -> Storyboard:
    """The pendulum under LQR."""
    case = find_case("cart_pendulum", "nominal")
    return storyboard(film_of([run_case(case, "physics", "lqr", Settings())], form))


# ---- processes


class Process:
    """What /proc says of a process."""

    def __init__(self, pid: int) -> None:
        folder = Path("/proc") / str(pid)
        self.pid, text = pid, (folder / "stat").read_text().rpartition(")")[2]
        self.state, *numbers = text.split()[:4]
        self.parent, self.group, self.session = map(int, numbers)
        self.command = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        self.status = dict(
            line.split(":\t", 1) for line in (folder / "status").read_text().splitlines()
        )

    @property
    def is_worker(self) -> bool:
        return WORKER in self.command


def processes() -> list[Process]:
    """All that live; a zombie does not."""
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            with contextlib.suppress(OSError):
                found.append(Process(int(folder.name)))
    return [each for each in found if each.state != "Z"]


def children(what: str) -> list[Process]:
    """Child processes of this one."""
    return [each for each in processes() if each.parent == os.getpid() and what in each.command]


def wait_for(what: Callable[[], Any], patience: float = PATIENCE) -> Any:
    """Poll until there is something."""
    end = time.monotonic() + patience
    while not (found := what()):
        if time.monotonic() > end:
            pytest.fail(f"nothing of the kind within {patience} s")
        time.sleep(0.02)
    return found


class Run:
    """``grosmc-mj film`` in a process group of its own, as a terminal starts it."""

    def __init__(self, path: Path, *arguments: str, errors: int = subprocess.PIPE) -> None:
        self.path = path
        self._run = subprocess.Popen(
            [sys.executable, "-m", "grosmc_mj.cli", "film", *arguments, "-o", str(path)],
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            start_new_session=True,
            preexec_fn=hear_interrupts,
        )
        self.pid = self._run.pid

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        self._run.communicate()

    def alive(self) -> list[Process]:
        """Its processes and itself, which leads a session."""
        return [each for each in processes() if each.session == self.pid]

    def workers(self) -> list[Process]:
        return [each for each in self.alive() if each.is_worker]

    def rendering(self) -> list[Process]:
        """The workers, once the first frame has been encoded."""
        begun = self.path.parent.glob(f".{self.path.stem}.*.part{self.path.suffix}")
        return self.workers() if any(part.stat().st_size > 0 for part in begun) else []

    def end(self) -> tuple[int, str, str]:
        """Exit code, standard output and standard error."""
        try:
            out, error = self._run.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            pytest.fail(f"it hangs: {[each.command for each in self.alive()]}")
        # What a terminal shows does not come back here.
        return self._run.returncode, out, without_progress(error or "")


def without_progress(said: str) -> str:
    """Standard error without the lines that tell on a busy machine how far a command is."""
    return re.sub(r"^\d+ of \d+ frames in .*\n", "", said, flags=re.MULTILINE)


def put_an_older_film(folder: Path) -> dict[str, bytes]:
    """What is there before."""
    for suffix in ("mp4", "png", "json"):
        (folder / f"f.{suffix}").write_bytes(f"an older {suffix}".encode())
    return contents(folder)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


# ---- interrupts


def test_an_interrupt_is_one_line_and_leaves_an_older_film_and_no_process(tmp_path: Path) -> None:
    # A terminal sends it to the whole group. All start at once: that is quicker.
    moments = (("group", "starting"), ("group", "rendering"), ("parent", "rendering"))
    ends, expected = {}, {}
    with contextlib.ExitStack() as stack:
        runs = {}
        for whom, moment in moments:
            folder = tmp_path / f"{whom}-{moment}"
            folder.mkdir()
            older = put_an_older_film(folder)
            runs[whom, moment] = stack.enter_context(Run(folder / "f.mp4", *LONG, "--workers", "1"))
            expected[whom, moment] = ((cli.INTERRUPTED, "", INTERRUPTED), older)
        for (whom, moment), run in runs.items():
            wait_for(run.workers if moment == "starting" else run.rendering)
            (os.killpg if whom == "group" else os.kill)(run.pid, signal.SIGINT)
        for which, run in runs.items():
            ends[which] = (run.end(), contents(run.path.parent))
            wait_for(lambda run=run: not run.alive(), SOON)
    assert ends == expected


@pytest.fixture(scope="module")
def killed(
    backend: str, home: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Run, list[Process]]]:
    """A film whose own process was killed, and the processes that were there before."""
    folder = tmp_path_factory.mktemp("killed")
    put_an_older_film(folder)
    with pytest.MonkeyPatch.context() as patch:
        _own_variables(patch, home)
        with Run(folder / "f.mp4", *LONG) as run:
            wait_for(run.rendering)
            before = run.alive()
            os.kill(run.pid, signal.SIGKILL)
            yield run, before


def test_workers_end_with_a_parent_that_was_killed(killed: tuple[Run, list[Process]]) -> None:
    run, before = killed
    assert len([each for each in before if each.is_worker]) == len(os.sched_getaffinity(0))
    wait_for(lambda: not run.alive(), SOON)
    assert run.path.read_bytes() == b"an older mp4"


def test_nobody_but_the_parent_hears_the_terminals_interrupt(
    killed: tuple[Run, list[Process]],
) -> None:
    run, before = killed
    for each in before:
        # A terminal sends it to the group in front.
        assert (each.group == run.pid) == (each.pid == run.pid), each.command
    (parent,) = (each for each in before if each.pid == run.pid)
    deaf = int(parent.status["SigBlk"], 16) | int(parent.status["SigIgn"], 16)
    assert not deaf >> (signal.SIGINT - 1) & 1


# ---- deaths, in this process: it says so and goes on


@pytest.fixture
def at_frame(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, Callable[[], object]], None]:
    """Let something happen when a frame of the command line's film is done."""

    def arrange(index: int, event: Callable[[], object]) -> None:
        @contextlib.contextmanager
        def progress(_total: int, _unit: str = "") -> Iterator[Callable[[str], None]]:
            frames = iter(range(100_000))
            yield lambda _text="": (next(frames) == index and event(), None)[1]

        monkeypatch.setattr(screen, "progress", progress)

    return arrange


def film(path: Path, *arguments: str) -> int:
    """Exit code of the command line, in this process."""
    with pytest.raises(SystemExit) as stop:
        cli.main(("film", *arguments, "-o", str(path)))
    assert isinstance(stop.value.code, int)
    return stop.value.code


def one_line(capfd: pytest.CaptureFixture[str]) -> str:
    """The only line, on stderr, with its beginning left out."""
    said = capfd.readouterr()
    error = without_progress(said.err)
    assert said.out == ""
    assert error.startswith("grosmc-mj: ")
    assert error.count("\n") == 1, said.err
    return error.removeprefix("grosmc-mj: ").rstrip()


def kill_one(what: str) -> None:
    os.kill(children(what)[0].pid, signal.SIGKILL)


def test_a_worker_that_dies_ends_the_film_in_one_line(
    tmp_path: Path,
    at_frame: Callable[[int, Callable[[], object]], None],
    capfd: pytest.CaptureFixture[str],
) -> None:
    older = put_an_older_film(tmp_path)
    at_frame(2, lambda: kill_one(WORKER))
    assert film(tmp_path / "f.mp4", *FILM, "--fps", "10") == cli.WRONG
    line = one_line(capfd)
    assert "a rendering process ended unexpectedly" in line
    assert "grosmc-mj doctor" in line
    assert "ffmpeg" not in line  # which is not to blame
    assert ".part" not in line  # a name that nobody has given
    assert contents(tmp_path) == older
    assert not children(WORKER)
    assert not children("ffmpeg")


def test_an_ffmpeg_that_dies_ends_the_film_in_one_line(
    tmp_path: Path,
    at_frame: Callable[[int, Callable[[], object]], None],
    capfd: pytest.CaptureFixture[str],
) -> None:
    older = put_an_older_film(tmp_path)
    at_frame(2, lambda: kill_one("ffmpeg"))
    assert film(tmp_path / "f.mp4", *FILM, "--fps", "10", "--workers", "1") == cli.WRONG
    line = one_line(capfd)
    assert "f.mp4: ffmpeg stopped" in line
    assert ".part" not in line
    assert contents(tmp_path) == older
    assert not children(WORKER)
    assert not children("ffmpeg")


def test_what_ffmpeg_says_is_passed_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    programs = tmp_path / "bin"
    programs.mkdir()
    broken = programs / "ffmpeg"
    broken.write_text(
        "#!/bin/sh\n"
        "case $* in\n"
        "  -version) echo ffmpeg version 9;;\n"
        "  *-encoders) echo libx264;;\n"
        "  *) echo 'Something else' >&2; echo 'Unknown encoder of a kind' >&2; exit 1;;\n"
        "esac\n"
    )
    broken.chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    assert film(tmp_path / "out" / "f.mp4", *SHORT) == cli.WRONG
    assert "f.mp4: ffmpeg stopped: Unknown encoder of a kind" in one_line(capfd)
    assert contents(tmp_path / "out") == {}


# ---- places that cannot be written


def fill_the_disk_for(suffix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is written to new files of this kind finds no space."""
    opened = os.open

    def open_full(path: Any, flags: int, *more: Any, **further: Any) -> int:
        if flags & os.O_EXCL and Path(path).suffix == f".{suffix}":
            Path(path).symlink_to("/dev/full")
            path, flags = "/dev/full", os.O_WRONLY
        return opened(path, flags, *more, **further)

    monkeypatch.setattr("grosmc_mj.files.os.open", open_full)


@pytest.mark.parametrize("suffix", ["mp4", "png", "gif"])
def test_a_full_disk_is_one_line_that_says_what_to_do(
    suffix: str,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fill_the_disk_for(suffix, monkeypatch)
    assert film(tmp_path / "f.mp4", *SHORT, "--gif") == cli.WRONG
    line = one_line(capfd)
    assert f"f.{suffix}" in line
    assert "No space left on device" in line
    assert "free the disk or choose another place" in line
    assert not list(tmp_path.glob(".*"))
    assert not (tmp_path / "f.mp4").exists()
    assert Path("/dev/full").is_char_device()


def test_a_disk_that_is_full_for_the_last_file_names_the_films_own_option(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    fill_the_disk_for("json", monkeypatch)
    assert film(tmp_path / "f.mp4", *SHORT) == cli.WRONG
    line = one_line(capfd)
    assert "f.json" in line
    assert "No space left on device" in line
    assert "--out" not in line  # film has no such option
    assert not list(tmp_path.glob("*part*"))


def test_a_film_that_the_disk_cannot_hold_is_not_called_done(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    if shutil.which("mount") is None:
        pytest.skip("no mount, which makes a small disk")
    small = ["mount", "-t", "tmpfs", "-o", "size=4k", "tmpfs", str(disk)]
    made = subprocess.run(small, check=False, capture_output=True, text=True)
    if made.returncode:
        pytest.skip(f"cannot make a small disk: {made.stderr.strip()}")
    try:
        code = film(disk / "f.mp4", *FILM, "--fps", "10", "--to", "2", "--workers", "1")
        left = [path.name for path in disk.iterdir()]
    finally:
        subprocess.run(["umount", disk], check=True)
    assert code == cli.WRONG
    assert "f.mp4" not in left
    assert not [name for name in left if ".part" in name]
    line = one_line(capfd)
    assert "f.mp4" in line
    assert "No space left on device" in line
    assert "free the disk or choose another place" in line


@pytest.mark.parametrize("place", ["file/f.mp4", "file/deeper/f.mp4", "taken.mp4", "/proc/f.mp4"])
def test_a_place_that_cannot_be_written_is_one_line_before_any_frame_is_drawn(
    place: str,
    tmp_path: Path,
    at_frame: Callable[[int, Callable[[], object]], None],
    capfd: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "taken.mp4").mkdir()
    drawn: list[int] = []
    at_frame(0, lambda: drawn.append(0))
    assert film(tmp_path / place, *SHORT) == cli.WRONG
    line = one_line(capfd)
    assert f"cannot write {tmp_path / place}" in line
    assert "choose another place" in line
    assert not drawn
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "taken.mp4"]


def test_a_film_that_is_no_mp4_is_refused(tmp_path: Path, backend: str) -> None:
    case = find_case("cart_pendulum", "nominal")
    shown = film_of([run_case(case, "physics", "lqr", Settings())], SMALL)
    for name in ("f.avi", "f", "f.mp4.gz"):
        with pytest.raises(ArgumentError, match=r"must end in \.mp4"):
            write_film(shown, tmp_path / name, backend=backend)
    assert contents(tmp_path) == {}


# ---- drawing


def cursor_column(frame: np.ndarray, form: Storyboard) -> int:
    """Where the cursor stands in the first plot."""
    area = form.chart.areas[0]
    plot = frame[area.top : area.bottom, area.left : area.right]
    (columns,) = np.nonzero(np.all(plot == 120, axis=(0, 2)))
    assert len(columns) == 1
    return area.left + int(columns[0])


def test_frames_come_in_order_though_a_worker_halts(backend: str) -> None:
    with contextlib.closing(draw_frames(board(), backend, 2)) as frames:
        shown = [next(frames)]
        halted = wait_for(lambda: children(WORKER))[0].pid
        os.kill(halted, signal.SIGSTOP)

        def go_on() -> None:
            # Where drawing is quick, all is drawn without it by then.
            with contextlib.suppress(ProcessLookupError):
                os.kill(halted, signal.SIGCONT)

        resume = threading.Timer(0.2, go_on)
        resume.start()
        shown += frames
        resume.join()
    chart = board().chart
    columns = [chart.column(chart.areas[0], float(t)) for t in board().times]
    assert [cursor_column(frame, board()) for frame in shown] == columns
    assert len(set(columns)) == len(columns)


def test_drawing_that_is_given_up_ends_its_workers(
    backend: str, capfd: pytest.CaptureFixture[str]
) -> None:
    frames = draw_frames(board(), backend, 2)
    next(frames)
    assert len(children(WORKER)) == 2
    frames.close()
    assert not children(WORKER)
    assert capfd.readouterr() == ("", "")


def test_no_more_workers_start_than_there_are_frames(backend: str) -> None:
    few = board(Format(width=320, height=240, fps=10, stop=0.1))
    assert len(few.times) == 1
    with contextlib.closing(draw_frames(few, backend, 2)) as frames:
        next(frames)
        assert len(children(WORKER)) == 1


def test_workers_do_not_take_the_users_setting_for_pyopengl(
    backend: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    if backend not in ("egl", "osmesa"):
        pytest.skip("only egl and osmesa look at it")
    monkeypatch.setenv("PYOPENGL_PLATFORM", "osmesa" if backend == "egl" else "egl")
    with contextlib.closing(draw_frames(board(), backend, 1)) as frames:
        assert next(frames).shape == (240, 320, 3)
    assert capfd.readouterr() == ("", "")


# ---- whole films in processes of their own

# A user's own program: no function, and nothing that asks whether it is the main module.
PROGRAM = """
import json, os, sys
from pathlib import Path

from grosmc_mj.films.film import Format
from grosmc_mj.films.write import write_film
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.films import film_of

fps, path = int(sys.argv[1]), Path(sys.argv[2])


def peak(pid):
    status = Path(f"/proc/{pid}/status").read_text()
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM"))


def look():
    for pid in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split():
        if b"films.workers" in Path(f"/proc/{pid}/cmdline").read_bytes():
            workers.append(peak(pid))


workers = []
run = Experiment.load("cart_pendulum/nominal").run("physics", "lqr")
written = write_film(
    film_of([run], Format(480, 320, fps, stop=4.0)), path, workers=1, advance=look
)
print(json.dumps({"frames": written.frames, "parent": peak("self"), "worker": max(workers)}))
"""


def test_memory_does_not_grow_with_the_film(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    runs = [
        subprocess.Popen(
            [sys.executable, str(program), str(fps), str(tmp_path / f"{fps}.mp4")],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for fps in (5, 20)
    ]
    said = [run.communicate(timeout=2 * PATIENCE) for run in runs]
    assert [(run.returncode, error) for run, (_, error) in zip(runs, said, strict=True)] == [
        (0, ""),
        (0, ""),
    ]
    short, long = (json.loads(out) for out, _ in said)
    assert (short["frames"], long["frames"]) == (20, 80)
    # The other 60 frames are 27 MB.
    for who in ("parent", "worker"):
        assert abs(long[who] - short[who]) < 20_000, (short, long)  # kB


def test_a_normal_film_says_what_it_is_and_shows_its_progress_to_terminals_only(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    master, terminal = pty.openpty()
    shown: list[str] = []

    def read() -> None:
        with contextlib.suppress(OSError):  # at the end of a terminal Linux says EIO
            while data := os.read(master, 65536):
                shown.append(data.decode())

    reader = threading.Thread(target=read)
    reader.start()
    with Run(tmp_path / "seen.mp4", *SHORT, errors=terminal) as seen:
        os.close(terminal)
        # Here, where standard error is no terminal.
        code = film(tmp_path / "piped.mp4", *SHORT)
        assert not children(WORKER)
        ends = {"piped": (code, *capfd.readouterr()), "seen": seen.end()}
        wait_for(lambda: not seen.alive(), SOON)
    reader.join(SOON)
    os.close(master)
    for name, (code, out, _) in ends.items():
        assert code == cli.DONE
        words, written, poster = out.splitlines()
        assert words.startswith("3 frames, 0.3 s, ")
        assert [written, poster] == [f"{tmp_path / name}.mp4", f"{tmp_path / name}.png"]
    assert without_progress(ends["piped"][2]) == ""
    text = re.sub(r"\x1b\[[^a-zA-Z]*[a-zA-Z]", "", "".join(shown))
    assert "seen.mp4" in text
    assert "3/3 frames" in text
    assert "Traceback" not in text
    assert sorted(contents(tmp_path)) == sorted(
        f"{name}.{suffix}" for name in ends for suffix in ("json", "mp4", "png")
    )
