"""The case files that a user begins with."""

from __future__ import annotations

from pathlib import Path

from grosmc_mj.experiments.case import CASES

_OWN = "own_plant"


def starter() -> str:
    """A case file with every key explained."""
    return (CASES / "starter.toml").read_text(encoding="utf-8")


def own_plant(name: str) -> dict[str, str]:
    """A case file with a plant and laws in Python, and that Python, by their file names."""
    sources = [Path(f"{_OWN}{suffix}") for suffix in (".toml", ".py")]
    return {
        f"{name}{source.suffix}": (CASES / source).read_text(encoding="utf-8").replace(_OWN, name)
        for source in sources
    }
