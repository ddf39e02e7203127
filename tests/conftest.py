"""Fixtures and hooks of all tests: the store of a session, the systems, a loop without feedback."""

from __future__ import annotations

import compileall
import gc
import os
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import blas_threads  # noqa: F401  (before what imports NumPy)
import hypothesis
import pytest
from hostile_trial import Trial
from last_digits import change_last_digits
from open_loop import held
from printed import Printed, answer
from stored import Store
from syrupy.assertion import SnapshotAssertion

import grosmc_mj
from grosmc_mj import cli
from grosmc_mj.cli import screen
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.theory.control.controller import Controller
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


def pytest_collection_finish() -> None:
    """Imported modules and tests stay: collections of garbage need not look through them again."""
    gc.freeze()


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """A run that did not come to its end leaves no results for ``make test-report``."""
    stored = session.config.getoption("xmlpath")
    if stored and exitstatus not in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
        Path(stored).unlink(missing_ok=True)


@pytest.fixture(scope="session")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """Folders and commands that the tests of a session make once."""
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
