"""Fixtures and hooks of all tests: the store of a session, the systems, a loop without feedback."""

from __future__ import annotations

import compileall
import contextlib
import fcntl
import gc
import io
import json
import os
import shutil
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import hypothesis
import numpy as np
import pytest
from commands import run
from hostile_trial import Trial
from last_digits import change_last_digits
from printed import Printed, answer
from syrupy.assertion import SnapshotAssertion

import grosmc_mj
from grosmc_mj import cli
from grosmc_mj.cli import screen
from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.memory import Memory
from grosmc_mj.theory.plants import SYSTEMS

# SymPy and numba make millions of small objects that live on: looking through them as often as
# Python does by itself takes a tenth of the time of a derivation or a compilation.
gc.set_threshold(100_000, 20, 100)

# Hypothesis fails an example that takes 200 ms, and data that are slow to draw: a busy machine
# would have another verdict.
hypothesis.settings.register_profile(
    "any machine", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("any machine")

# A process a core runs tests: threads of a BLAS would only stand in their way.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Tests that move the cache, to see what is kept of graphics, leave compiled laws where they are.
os.environ.setdefault(
    "NUMBA_CACHE_DIR", os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
)


def pytest_configure(config: pytest.Config) -> None:
    """Change the last digits of linear algebra if asked (see ``emulated_machine.py``).

    Compile the package once for all processes that the tests start.

    Where Python may not write bytecode each of them would compile it, which takes as long as a
    short command.
    """
    if os.environ.get("LAST_DIGITS"):
        change_last_digits()
    if not hasattr(config, "workerinput"):
        compileall.compile_dir(Path(grosmc_mj.__file__).parent, quiet=2)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with the most slow tests first.

    A worker takes one file at a time (``--dist loadfile``): what is left at the end is quick, so
    that the workers end together.
    """
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: -slow[item.path])


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """A run that did not come to its end leaves no results for ``make test-report``."""
    stored = session.config.getoption("xmlpath")
    if stored and exitstatus not in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
        Path(stored).unlink(missing_ok=True)


def hear_interrupts() -> None:
    """The ``preexec_fn`` of every child that a test interrupts: Ctrl-C ends it.

    A process that was started in the background ignores SIGINT, and so do its children: Python
    raises KeyboardInterrupt only where it finds the default handler.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Stored(NamedTuple):
    """A command that has run: its exit code, its words, and the folder of its results."""

    code: int
    said: str
    folder: Path

    def read(self, name: str) -> Any:
        """A JSON document of its folder."""
        return json.loads((self.folder / name).read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Store:
    """Folders that are filled once a session, for all of its worker processes."""

    root: Path

    def folder(self, name: str, fill: Callable[[Path], object]) -> Path:
        """The folder of this name; the first process that needs it fills it, others wait."""
        folder, done = self.root / name, self.root / f"{name}.done"
        self.root.mkdir(exist_ok=True)
        with (self.root / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not done.exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                fill(folder)
                done.touch()
        return folder

    def command(self, *arguments: str) -> Stored:
        """A command of the package with its ``--out``; tests only read its folder.

        CI has run ``validate`` before, and names its folder in ``VALIDATED``.
        """
        made = os.environ.get("VALIDATED") if arguments == ("validate",) else None
        name = "_".join(arguments).replace("/", "-")
        folder = Path(made) if made else self.folder(name, partial(_command, arguments))
        said = (folder / "said.txt").read_text(encoding="utf-8")
        return Stored(int((folder / "code.txt").read_text()), said, folder)


def _command(arguments: tuple[str, ...], folder: Path) -> None:
    with contextlib.redirect_stdout(io.StringIO()) as said:
        code = run(*arguments, "--out", folder)
    (folder / "said.txt").write_text(said.getvalue(), encoding="utf-8")
    (folder / "code.txt").write_text(str(code))


@pytest.fixture(scope="session")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """What the tests of a session make once."""
    base = tmp_path_factory.getbasetemp()
    return Store((base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "stored")


@pytest.fixture(scope="session", autouse=True)
def compiled(store: Store) -> None:
    """Of several workers one compiles what all laws share; the others wait, and read the cache."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        store.folder("compiled", _compile)


def _compile(_: Path) -> None:
    plant = MujocoPlant.load("servo")
    for moved in (plant, plant.analytic()):
        simulate(moved, held(0.0), [0.0, 0.0], duration=2e-3)


@dataclass(frozen=True)
class Input:
    """A constant input, in the unit of the plant's."""

    u: float


def constant_input(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.v = p.u
    return p.u


@dataclass(frozen=True, eq=False)
class Inputs:
    """Two constant inputs, in the units of the plant's, (2,)."""

    u: Array


def constant_inputs(t: float, x: Any, memory: Any, p: Any) -> tuple[float, float]:
    memory.v[0], memory.v[1] = p.u[0], p.u[1]
    return (p.u[0], p.u[1])


def held(u: float | tuple[float, float]) -> Controller:
    """A controller that holds one input or two."""
    if isinstance(u, tuple):
        memory = partial(_memory_of_two_inputs)
        return Controller("open loop", constant_inputs, Inputs(np.array(u)), memory)
    return Controller("open loop", constant_input, Input(u))


def _memory_of_two_inputs() -> Memory:
    return Memory(v=np.zeros(2))


@pytest.fixture(params=list(SYSTEMS))
def name(request: pytest.FixtureRequest) -> str:
    """Each system in turn."""
    return request.param


@pytest.fixture
def plant(name: str) -> MujocoPlant:
    """The shipped model of each system in turn."""
    return MujocoPlant.load(name)


@pytest.fixture
def open_loop() -> Callable[[float | tuple[float, float]], Controller]:
    """A controller that holds u, whatever the state."""
    return held


@pytest.fixture(scope="session")
def pairs(store: Store) -> Any:
    """The folder of eight servos under two LQRs, in two parts."""
    return _campaign(store, "pair")


@pytest.fixture(scope="session")
def servos(store: Store) -> Any:
    """The folder of eight servos of seed 5 under LQR and GROSMC, in two parts."""
    return _campaign(store, "servo", seed=5)


def _campaign(store: Store, kind: str, **more: Any) -> Any:
    """A campaign that has run to its end."""
    import campaigns

    declared = campaigns.campaign(getattr(campaigns, kind)(), **more)
    path = store.folder(f"campaign_{kind}", lambda path: campaigns.kept(declared, path))
    return campaigns.Folder(path)


@pytest.fixture
def printed(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    snapshot: SnapshotAssertion,
) -> Callable[..., None]:
    """Requirement that a command, in a folder of its own, prints its snapshot."""
    monkeypatch.chdir(tmp_path)
    # No line of progress, however slow the machine is.
    monkeypatch.setattr(screen, "LINE_EVERY", float("inf"))
    stored = snapshot.use_extension(Printed)

    def require(*arguments: object) -> None:
        assert answer(capsys, tmp_path, *arguments) == stored

    return require


@pytest.fixture
def hostile(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Trial]:
    """Trial of hostile input: it sees a right answer, and a wrong one, at least."""
    folder = tmp_path / "working"
    folder.mkdir()
    monkeypatch.chdir(folder)
    # No line of progress, however slow the machine is.
    monkeypatch.setattr(screen, "LINE_EVERY", float("inf"))
    trial = Trial(capfd, folder)
    yield trial
    # An oracle that calls everything an error would see nothing.
    assert trial.ends[cli.WRONG] > 0
    assert trial.ends[cli.DONE] + trial.ends[cli.DIFFERS] > 0
