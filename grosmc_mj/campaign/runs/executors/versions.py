"""The versions that decide what a shard computes, here and on a worker."""

from __future__ import annotations

import functools
import platform

from grosmc_mj.versions import DECISIVE, installed


@functools.cache
def versions() -> dict[str, str]:
    """Of Python, this package and those that compute; `missing` for one that is not there."""
    python = ".".join(platform.python_version_tuple()[:2])
    return {"python": python, **installed(DECISIVE, "missing")}


def differences(wanted: dict[str, str]) -> list[str]:
    """Where this process differs from another, for instance `numpy 2.3.0 instead of 2.4.6`."""
    found = versions()
    return [
        f"{name} {found.get(name, 'missing')} instead of {value}"
        for name, value in wanted.items()
        if found.get(name) != value
    ]
