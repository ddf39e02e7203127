"""``[[disturbance]]`` of a case file: where it acts, and its course in time."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from grosmc_mj.experiments.file.keys import keys_of
from grosmc_mj.experiments.file.part_tables import PartTable, Values, part_from, values_of
from grosmc_mj.experiments.file.user_code import is_named, load_named
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError, Mistakes
from grosmc_mj.ground.fields import Numbers, checked
from grosmc_mj.simulation.disturbances import (
    AnyDisturbance,
    Constant,
    Disturbance,
    Pulse,
    RateDisturbance,
    SineFrom,
    Table,
)
from grosmc_mj.theory.plants import System

# Courses in time by the names that a file has for them; their fields are keys of the table.
COURSES: Mapping[str, type] = {
    "constant": Constant,
    "pulse": Pulse,
    "sine": SineFrom,
    "table": Table,
}


@checked()
class Wrench:
    """Wrench on a body, in world axes at its centre of mass.

    Attributes:
        force: Force [N], (3,).
        torque: Torque [N m], (3,).
    """

    force: Annotated[tuple[float, float, float], Numbers(3, "N")] = (0.0, 0.0, 0.0)
    torque: Annotated[tuple[float, float, float], Numbers(3, "N m")] = (0.0, 0.0, 0.0)


def disturbances_of(file: Any, system: System, folder: Path) -> tuple[AnyDisturbance, ...]:
    """Return the disturbances in a case file.

    Args:
        file: A ``CaseFile``.
        system: The system of its plant.
        folder: Folder of a user's own profiles.

    Raises:
        ArgumentError: For all that do not fit.
    """
    mistakes = Mistakes()
    make = partial(_acting, system=system, folder=folder)
    disturbances = mistakes.each("disturbance", file.disturbance, make, file.base_of("disturbance"))
    mistakes.refuse()
    return tuple(disturbances)


def _acting(table: PartTable, system: System, folder: Path) -> AnyDisturbance:
    """Return one disturbance, which acts after the begin of a run."""
    disturbance = _disturbance(table, system, folder)
    _, last = disturbance.window
    if last <= 0:
        raise ArgumentError(f"it ends at {last:g} s, a run begins at 0 s: it never acts")
    return disturbance


def _disturbance(table: PartTable, system: System, folder: Path) -> AnyDisturbance:
    """Return one disturbance with its profile."""
    kind = table.form.part
    if kind is RateDisturbance and system.joints:
        raise ArgumentError(f"{system.name} has a model in MuJoCo: name a body or an input")
    if kind is Disturbance and not system.bodies:
        raise ArgumentError(f"{system.name} has no bodies: name an input or a state")

    values = values_of(table, system)
    profile = _profile(values, folder)
    if kind is not Disturbance:
        return part_from(kind, {**values, "profile": profile})

    # Zero is a number too: a disturbance without effect still ends the transient.
    given = {name: values[name] for name in keys_of(Wrench) if name in values}
    if not given:
        raise ArgumentError("it has neither force nor torque")
    wrench = Wrench(**given)
    others = {name: values[name] for name in ("label", "scale") if name in values}
    return Disturbance(values["body"], (*wrench.force, *wrench.torque), profile, **others)


def _profile(values: Values, folder: Path) -> Any:
    """Return the profile of a disturbance over time."""
    name = values.get("profile", "constant")
    if isinstance(name, str) and is_named(name):
        return load_named(name, folder)

    require_known("profile", name, (*COURSES, "module:name"))
    keys = {course: keys_of(kind) for course, kind in COURSES.items()}
    valid = keys[name]
    foreign = set[str]().union(*keys.values()).difference(valid)
    misplaced = sorted(values.keys() & foreign)
    if misplaced:
        raise ArgumentError(f"a {name} has no {', '.join(misplaced)}")

    needed = [key for key in valid.values() if key.required]
    if any(key.name not in values for key in needed):
        raise ArgumentError(f"a {name} needs {' and '.join(key.name for key in needed)}")
    return COURSES[name](**{key: values[key] for key in valid if key in values})
