"""Slips of the pen in the chapter: what is meant is plain, and nothing turns on it."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import NamedTuple

_FILE = Path(__file__).with_name("slips.toml")


class Slip(NamedTuple):
    """One slip.

    Attributes:
        where: Section or equation.
        written: What the chapter has.
        meant: What it must be.
    """

    where: str
    written: str
    meant: str


@cache
def slips() -> tuple[Slip, ...]:
    """All of them, in the chapter's order."""
    found = tomllib.loads(_FILE.read_text(encoding="utf-8"))
    return tuple(Slip(**each) for each in found["slip"])
