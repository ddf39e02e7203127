"""Files of logs: compressed, large, damaged; one log in several files is read alike."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from grosmc_mj.errors import ArgumentError
from grosmc_mj.logs import csv_file
from grosmc_mj.logs.log import Log, name_of_log
from grosmc_mj.logs.read import read_log
from grosmc_mj.plants import find_system

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


def assert_equal(log: Log, other: Log) -> None:
    """Assert that two logs are equal to the bit."""
    assert np.array_equal(log.time, other.time)
    assert np.array_equal(log.inputs, other.inputs)
    assert log.states.keys() == other.states.keys()
    for name, values in log.states.items():
        assert np.array_equal(values, other.states[name])


def test_a_compressed_csv_file_is_read_as_the_plain_one(tmp_path: Path) -> None:
    plain = tmp_path / "log.csv"
    plain.write_text(csv_text())
    packed = tmp_path / "log.csv.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))

    assert name_of_log(packed) == name_of_log(plain) == "log"
    assert_equal(read_log(packed, SERVO, None), read_log(plain, SERVO, None))


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
    with pytest.raises(ArgumentError, match=r"log\.csv\.gz: holds more than the \d+ MB that are"):
        read_log(path, SERVO, None)
