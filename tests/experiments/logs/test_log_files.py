"""Files of logs: compressed, large, damaged; one log in several files is read alike."""

from __future__ import annotations

import contextlib
import gzip
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import assert_one_line, run
from mcap.writer import Writer as McapWriter
from scipy.io import savemat

from grosmc_mj.cli.exit_codes import WRONG
from grosmc_mj.experiments.logs import csv_file, files, matlab_file, mcap_file
from grosmc_mj.experiments.logs.columns import name_and_unit
from grosmc_mj.experiments.logs.log import Log, name_of_log
from grosmc_mj.experiments.logs.read import read_log
from grosmc_mj.experiments.logs.table import LogTable
from grosmc_mj.ground.errors import ArgumentError, GrosmcError, ModelError
from grosmc_mj.ground.units import Unit, number_in
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.theory.plants import find_system

SERVO = find_system("servo")
SAMPLING = 0.002
TIME = np.arange(400) * SAMPLING
CURRENT = np.sign(np.sin(7 * TIME + 0.1))
ANGLE = np.round(4 * TIME + np.sin(3 * TIME), 5)
HEADER = "time [s],current [A],rotor angle [rad]"


def csv_text(header: str = HEADER) -> str:
    """A log of the servo."""
    rows = zip(TIME, CURRENT, ANGLE, strict=True)
    return "\n".join([header, *(f"{t:.3f},{u:g},{angle:.5f}" for t, u, angle in rows)])


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Log:
    """The log of a plain CSV file."""
    path = tmp_path_factory.mktemp("plain") / "log.csv"
    path.write_text(csv_text())
    return read_log(path, SERVO, None)


def assert_equal(log: Log, other: Log) -> None:
    """Assert that two logs are equal to the bit."""
    assert np.array_equal(log.time, other.time)
    assert np.array_equal(log.inputs, other.inputs)
    assert log.states.keys() == other.states.keys() == {"rotor angle"}
    assert np.array_equal(log.states["rotor angle"], other.states["rotor angle"])


def test_a_compressed_csv_file_is_read_as_the_plain_one(plain: Log, tmp_path: Path) -> None:
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(csv_text().encode()))
    assert name_of_log(path) == "log"
    assert_equal(read_log(path, SERVO, None), plain)


def test_a_mistake_in_a_compressed_file_is_named_by_its_line(tmp_path: Path) -> None:
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(csv_text().replace("0.050,", "0.050,x", 1).encode()))
    with pytest.raises(ArgumentError, match=r"current \[A\] is no number in line 27, 'x"):
        read_log(path, SERVO, None)


def test_the_content_of_a_compressed_file_is_bounded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A megabyte of empty lines is a kilobyte: the content counts, not the file."""
    monkeypatch.setattr(csv_file, "LARGEST_LOG", 1 << 20)
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(csv_text().encode() + b"\n" * (1 << 20)))
    with pytest.raises(ArgumentError, match=r"log\.csv\.gz: it holds more than the \d+ MB"):
        read_log(path, SERVO, None)


# -- time since 1970 -------------------------------------------------------------------------------

BEGIN = 1_700_000_000
# The same instants in several units: header, and the text of a count of milliseconds.
CLOCKS: dict[str, tuple[str, Callable[[int], str]]] = {
    "seconds": ("time [s]", lambda ms: f"{BEGIN}.{ms:03d}"),
    "seconds with an exponent": ("time [s]", lambda ms: f"{BEGIN * 1000 + ms}e-3"),
    "milliseconds": ("time [ms]", lambda ms: f"{BEGIN * 1000 + ms}"),
    "microseconds": ("time [us]", lambda ms: f"{BEGIN * 1000 + ms}000"),
    "nanoseconds": ("time [ns]", lambda ms: f"{BEGIN * 1000 + ms}000000"),
    "dates": ("time", lambda ms: f"2026-01-01T00:00:00.{ms:03d}"),
    "milliseconds from 0": ("time [ms]", str),
}
MILLISECONDS = range(2, 802, 2)


def with_clock(header: str, text: Callable[[int], str]) -> str:
    """The log of the servo with other times."""
    lines = [HEADER.replace("time [s]", header)]
    for ms, u, angle in zip(MILLISECONDS, CURRENT, ANGLE, strict=True):
        lines.append(f"{text(ms)},{u:g},{angle:.5f}")
    return "\n".join(lines)


@pytest.mark.parametrize(("header", "text"), CLOCKS.values(), ids=CLOCKS)
def test_a_time_since_1970_is_that_from_0_to_the_bit(
    plain: Log, tmp_path: Path, header: str, text: Callable[[int], str]
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(with_clock(header, text))
    assert_equal(read_log(path, SERVO, None), plain)


NANOSECONDS = [(BEGIN * 1000 + ms) * 10**6 for ms in MILLISECONDS]
TICKS = {
    "integers": pa.array(NANOSECONDS, pa.int64()),
    "unsigned integers": pa.array(NANOSECONDS, pa.uint64()),
}


@pytest.mark.parametrize("ticks", TICKS.values(), ids=TICKS)
@pytest.mark.parametrize("kind", [None, pa.timestamp("ns"), pa.timestamp("ns", "UTC")])
def test_nanoseconds_of_a_parquet_file_are_those_from_0_to_the_bit(
    plain: Log, tmp_path: Path, ticks: pa.Array, kind: pa.DataType | None
) -> None:
    column = ticks if kind is None else ticks.cast(pa.int64()).cast(kind)
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table({"time [ns]": column, "current": CURRENT, "rotor angle": ANGLE}), path)
    assert_equal(read_log(path, SERVO, None), plain)


@pytest.mark.usefixtures("reader_in_this_process")
def test_nanoseconds_of_a_matlab_file_are_those_from_0_to_the_bit(
    plain: Log, tmp_path: Path
) -> None:
    path = tmp_path / "log.mat"
    savemat(path, {"t": np.array(NANOSECONDS), "current": CURRENT, "rotor_angle": ANGLE})
    log = read_log(path, SERVO, LogTable(time_unit="ns"))
    assert_equal(log, plain)


# -- headers ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("rotor angle [deg]", "rotor angle", "deg"),
        (" u (V) ", "u", "V"),
        ("rotor angle", "rotor angle", ""),
        ("speed (rotor) [rad/s]", "speed (rotor)", "rad/s"),
        ("gain [V/(rad/s)]", "gain", "V/(rad/s)"),
        ("gain (V/(rad/s))", "gain", "V/(rad/s)"),
        ("a]", "a]", ""),
        ("a [m)", "a [m)", ""),
    ],
)
def test_a_header_has_a_name_and_a_unit(header: str, name: str, unit: str) -> None:
    assert name_and_unit(header) == (name, unit)


LONG = 200_000
# Texts that a pattern with backtracking reads in a time that grows with their square: minutes.
LONG_TEXTS: dict[str, Callable[[], object]] = {
    "blanks in a header": lambda: name_and_unit("x" + " " * LONG + "x"),
    "brackets in a header": lambda: name_and_unit("[" * LONG + "x)"),
    "digits of a number": lambda: number_in("1" * LONG + "x", "s"),
    "blanks after a number": lambda: number_in("1" + " " * LONG + "\nx\n.", "s"),
    "digits of a share": lambda: number_in("1" * LONG + "x", "1"),
    "separators of a unit": lambda: Unit.of("/" * LONG),
}


@pytest.mark.parametrize("read", LONG_TEXTS.values(), ids=LONG_TEXTS)
def test_a_long_text_is_read_in_a_time_in_proportion(read: Callable[[], object]) -> None:
    begin = time.process_time()
    with contextlib.suppress(GrosmcError):
        read()
    assert time.process_time() - begin < 2.0


def test_a_long_model_is_read_in_a_time_in_proportion(tmp_path: Path) -> None:
    path = tmp_path / "robot.xml"
    path.write_text("<mujoco>" + "<model " * LONG)
    begin = time.process_time()
    with pytest.raises(ModelError):
        Robot.from_mjcf(path)
    assert time.process_time() - begin < 2.0


# -- damaged and too large -------------------------------------------------------------------------


def test_a_matlab_file_that_ends_its_reader_is_one_line(tmp_path: Path) -> None:
    """One byte makes of the full matrix a sparse one, whose indices are taken from its numbers."""
    path = tmp_path / "log.mat"
    savemat(path, {"t": TIME, "current": CURRENT, "rotor_angle": ANGLE})
    content = bytearray(path.read_bytes())
    full, sparse = 6, 5
    # After the header, the tag of the matrix and the tag of its flags.
    place = 128 + 8 + 8
    assert content[place] == full
    content[place] = sparse
    path.write_bytes(content)
    with pytest.raises(ArgumentError, match=r"log\.mat: it is damaged: the process that read it"):
        read_log(path, SERVO, None)


@pytest.mark.slow
def test_a_matlab_file_is_read_within_a_bound_of_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(matlab_file, "_MEMORY", 192 << 20)
    path = tmp_path / "log.mat"
    savemat(path, {"t": np.zeros(200_000_000, np.uint8)}, do_compression=True)
    assert path.stat().st_size < 1 << 20
    with pytest.raises(ArgumentError, match=r"log\.mat: it holds more than the 1024 MB"):
        read_log(path, SERVO, None)


REPEATED = {
    "a megabyte of equal numbers": (
        {name: np.zeros(100_000) for name in ("time", "current", "rotor angle")},
        r"log\.parquet: it holds 2 MB, more than the 1024 MB",
    ),
    "long texts": (
        {"time": np.arange(5000), "note": ["x" * 1000] * 5000},
        r"log\.parquet: it holds more than the 1024 MB",
    ),
}


@pytest.mark.parametrize(("columns", "words"), REPEATED.values(), ids=REPEATED)
def test_values_that_repeat_in_a_parquet_file_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, columns: dict[str, Any], words: str
) -> None:
    """They are a few bytes in the file."""
    monkeypatch.setattr(files, "LARGEST_LOG", 1 << 20)
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table(columns), path)
    assert path.stat().st_size < 100_000
    with pytest.raises(ArgumentError, match=words):
        read_log(path, SERVO, None)


def test_a_chunk_of_a_bag_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_file, "LARGEST_LOG", 1 << 20)
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=8 << 20)
        writer.start()
        channel = writer.register_channel("/note", "json", 0)
        writer.add_message(channel, 0, b'"' + b" " * (4 << 20) + b'"', 0)
        writer.finish()
    assert path.stat().st_size < 100_000
    with pytest.raises(ArgumentError, match=r"log\.mcap: it holds 4 MB, more than the 1024 MB"):
        read_log(path, SERVO, None)


def test_long_arrays_of_messages_are_no_signals(tmp_path: Path) -> None:
    """A map of the room beside the joints."""
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channels = [writer.register_channel(topic, "json", 0) for topic in ("/servo", "/map")]
        cells = json.dumps({"cells": [0] * 5000}).encode()
        for k in range(100):
            content = json.dumps({"u": CURRENT[k], "q": ANGLE[k]}).encode()
            writer.add_message(channels[0], k * 1000, content, 0)
            writer.add_message(channels[1], k * 1000, cells, 0)
        writer.finish()
    assert set(files.columns_of(path)) == {"/servo.u", "/servo.q"}


def test_a_table_of_too_many_columns_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    names = [f"c{k}" for k in range(20_000)]
    row = ",".join(["1"] * len(names))
    path.write_text("\n".join([",".join(names), *[row] * 60]))
    begin = time.process_time()
    with pytest.raises(ArgumentError, match=r"has 20000 columns or more, and 10000 are read"):
        read_log(path, SERVO, None)
    assert time.process_time() - begin < 2.0


def test_a_letter_of_another_encoding_in_the_last_line_is_read(
    plain: Log,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Behind the beginning in which the header is looked for."""
    monkeypatch.setattr(csv_file, "_BEGINNING", 256)
    path = tmp_path / "log.csv"
    path.write_bytes(csv_text().encode() + b"\n# 21 \xb0C\n")
    assert_equal(read_log(path, SERVO, None), plain)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("kind", [pa.large_string(), pa.dictionary(pa.int32(), pa.string())])
def test_other_kinds_of_text_in_a_parquet_file_are_read(
    plain: Log, tmp_path: Path, kind: pa.DataType
) -> None:
    texts = pa.array([f"{t:.3f}" for t in TIME]).cast(kind)
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table({"time": texts, "current": CURRENT, "rotor angle": ANGLE}), path)
    assert_equal(read_log(path, SERVO, None), plain)


# -- paths that are no logs ------------------------------------------------------------------------


def no_file(path: Path) -> None:
    """Leave a path without a file."""


def loop_of_links(path: Path) -> None:
    path.symlink_to(path)


NO_LOGS: dict[str, tuple[Callable[[Path], object], str]] = {
    "nothing": (no_file, "there is no such file"),
    "folder": (Path.mkdir, "is a folder, a pipe, a socket or a device"),
    "pipe": (os.mkfifo, "is a folder, a pipe, a socket or a device"),
    "loop of links": (loop_of_links, "cannot be read: Too many levels of symbolic links"),
}


@pytest.mark.parametrize(("make", "words"), NO_LOGS.values(), ids=NO_LOGS)
@pytest.mark.parametrize("command", ["run", "identify"])
def test_a_path_that_is_no_log_is_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    make: Callable[[Path], object],
    words: str,
    command: str,
) -> None:
    path = tmp_path / "log.csv"
    make(path)
    monkeypatch.chdir(tmp_path)
    arguments = ["log.csv", "servo/case1"]
    if command == "run":
        arguments = ["servo/case1", "--log", "log.csv", "--laws", "lqr"]
    assert run(command, *arguments) == WRONG
    line = capfd.readouterr().err
    assert_one_line(line)
    assert words in line
    assert line.strip().endswith("name a file that ends in .csv, .csv.gz, .parquet, .mcap or .mat")
