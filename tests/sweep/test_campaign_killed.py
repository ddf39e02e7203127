"""A campaign that is killed goes on as if nothing had been."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from campaign_cases import DEVIATION, LQR, servo
from conftest import hear_interrupts

from grosmc_mj import cli

PARTS = 6


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A servo's campaign under LQR, which compiles soonest."""
    path = tmp_path_factory.mktemp("files") / "small.toml"
    path.write_text(servo(laws=LQR, limits=DEVIATION))
    return path


def arguments(file: Path, out: Path) -> list[str]:
    """Several parts."""
    sizes = ("--runs", str(64 * PARTS), "--shard", "64")
    return ["campaign", str(file), *sizes, "--out", str(out), "--no-figures"]


def here(*asked: str) -> None:
    """Run it to its end in this process."""
    with pytest.raises(SystemExit) as stop:
        cli.main(asked)
    assert stop.value.code == cli.DONE


@pytest.fixture(scope="module")
def undisturbed(file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The campaign as it is if nothing happens."""
    out = tmp_path_factory.mktemp("undisturbed")
    here(*arguments(file, out))
    return out


def left(folder: Path) -> dict[str, bytes]:
    """Everything that a campaign leaves behind, but the manifest and by which command."""
    content = json.loads((folder / "results.json").read_text())
    assert content.pop("command") is not None
    parts = {path.name: path.read_bytes() for path in (folder / "parts").iterdir()}
    return {**parts, "results.json": json.dumps(content).encode()}


@pytest.mark.slow
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_a_killed_campaign_goes_on_as_if_nothing_had_been(
    end: signal.Signals, file: Path, undisturbed: Path, tmp_path: Path
) -> None:
    out = tmp_path / "killed"
    code, said, parts = ended(end, file, out)
    assert 2 <= parts < PARTS
    assert not (out / "results.json").exists()
    if end != signal.SIGKILL:
        assert code == cli.INTERRUPTED
        assert f"interrupted: {parts} of {PARTS} parts are done".encode() in said
    else:
        assert code == -signal.SIGKILL
    here(*arguments(file, out), "--resume")
    assert left(out) == left(undisturbed)


# The command line, which never ends its last part: parts are synchronised before they are whole.
HELD = f"""
import os, pathlib, sys, time
from grosmc_mj import cli
parts, sync = pathlib.Path(sys.argv[1], "parts"), os.fsync
def held(file):
    while len(list(parts.glob("part-*"))) == {PARTS - 1}:
        time.sleep(0.01)
    sync(file)
os.fsync = held
cli.main(sys.argv[2:])
"""


def ended(end: signal.Signals, file: Path, out: Path) -> tuple[int, bytes, int]:
    """End a campaign at a random instant after its second part; its exit code, words and parts."""
    with subprocess.Popen(
        [sys.executable, "-c", HELD, str(out), *arguments(file, out)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        preexec_fn=hear_interrupts,
    ) as process:
        deadline = time.monotonic() + 120
        while len(list((out / "parts").glob("part-*"))) < 2 and process.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        time.sleep(random.uniform(0, 0.1))
        process.send_signal(end)
        _, said = process.communicate(timeout=60)
    return process.returncode, said, len(list((out / "parts").glob("part-*")))
