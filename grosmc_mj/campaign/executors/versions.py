"""The versions that decide what a shard computes, here and on a worker."""

from __future__ import annotations

import functools
import platform
from importlib.metadata import PackageNotFoundError, version

import grosmc_mj

# Others differ without a change in the results.
_PACKAGES = ("mujoco", "numba", "numpy", "scipy")


@functools.cache
def versions() -> dict[str, str]:
    """Of Python, this package and those that compute; `missing` for one that is not there."""
    python = ".".join(platform.python_version_tuple()[:2])
    found = {"python": python, "grosmc_mj": grosmc_mj.__version__}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    return found


def differences(wanted: dict[str, str]) -> list[str]:
    """Where this process differs from another, for instance `numpy 2.3.0 instead of 2.4.6`."""
    found = versions()
    return [
        f"{name} {found.get(name, 'missing')} instead of {value}"
        for name, value in wanted.items()
        if found.get(name) != value
    ]
