"""Versions of installed packages."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version

import grosmc_mj

# Packages beside this one whose version may change a bit of a run.
DECISIVE = ("mujoco", "numba", "numpy", "scipy")


def installed(packages: Iterable[str], absent: str = "not installed") -> dict[str, str]:
    """The version of this package and of others; ``absent`` for one that is not there."""
    found = {"grosmc_mj": grosmc_mj.__version__}
    for package in packages:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = absent
    return found
