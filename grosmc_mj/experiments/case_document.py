"""Cases as plain values, for documents.

An experiment writes documents of its runs: here it is known by its attributes.
"""

from __future__ import annotations

import inspect
from dataclasses import asdict
from typing import Any

from grosmc_mj.experiments.file.keys import key_name
from grosmc_mj.simulation.disturbances import AnyDisturbance, Disturbance


def seed_of(case: Any) -> int | None:
    """Return the seed of the loop's random numbers; None without a loop."""
    if case.loop is None:
        return None
    return case.loop.seed


def case_document(case: Any) -> dict[str, Any]:
    """Return a case as plain values."""
    disturbances = [_disturbance_document(disturbance) for disturbance in case.disturbances]
    return {
        "system": case.system,
        "case": case.name,
        "title": case.title,
        "source": case.source,
        "x0": list(case.x0),
        "duration": case.duration,
        "edits": [asdict(edit) for edit in case.edits],
        "disturbances": disturbances,
    }


def _disturbance_document(disturbance: AnyDisturbance) -> dict[str, Any]:
    """Return a disturbance as plain values."""
    if isinstance(disturbance, Disturbance):
        document = {"body": disturbance.body, "wrench": list(disturbance.amplitudes)}
    else:
        key = key_name(type(disturbance), disturbance.noun)
        document = {key: disturbance.of, "amplitude": disturbance.amplitudes[0]}
    return {**document, "profile": _profile_in_words(disturbance.profile)}


def _profile_in_words(profile: Any) -> str:
    """Return a profile with its numbers, or the name of its function."""
    if inspect.isfunction(profile):
        return f"{profile.__module__}:{profile.__qualname__}"
    return repr(profile)
