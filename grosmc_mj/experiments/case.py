"""Cases as values, from case files: the chapter's, this project's, the user's."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.experiments.file.reading import read_case_file
from grosmc_mj.experiments.file.schema import CaseFile, DisturbanceTable, EditTable
from grosmc_mj.experiments.file.units import number_in
from grosmc_mj.experiments.file.user_code import is_named, load_named
from grosmc_mj.plants import System, find_system
from grosmc_mj.simulation.disturbances import Constant, Disturbance, Profile, Pulse, SineFrom
from grosmc_mj.simulation.edits import AddedMass, BodyEdit, Edit, JointEdit

# Where the package's own case files are, a folder for each system.
CASES = Path(__file__).resolve().parents[1] / "cases"


@dataclass(frozen=True)
class Case:
    """One experiment: what is changed against the nominal plant, from where, for how long.

    Attributes:
        system: Name of the system.
        name: ``nominal``, ``case1`` or ``case2``.
        title: For people.
        source: Where the chapter has it, or that this project declares it.
        x0: Start, in the order of the system's states.
        duration: [s]; the chapter prints none.
        edits: Edits of the plant; the controller keeps the nominal numbers.
        disturbances: Wrenches on the plant.
        design: The controllers' design; empty for the system's first one.
    """

    system: str
    name: str
    title: str
    source: str
    x0: tuple[float, ...]
    duration: float
    edits: tuple[Edit, ...] = ()
    disturbances: tuple[Disturbance, ...] = ()
    design: str = ""

    @property
    def controllers(self) -> str:
        """The name of the controllers' design."""
        return self.design or self.system

    @property
    def onset(self) -> float:
        """When the first disturbance begins [s]; infinite if there is none."""
        return min((d.window[0] for d in self.disturbances), default=math.inf)


def cases(system: str) -> list[Case]:
    """The cases of a system, the nominal one first.

    Raises:
        ModelError: If there is no such system.
    """
    return list(_shipped(find_system(system).name))


@cache
def _shipped(system: str) -> tuple[Case, ...]:
    """The cases in the package's own files."""
    files = [read_case_file(path) for path in shipped_files().values()]
    found = [case_of(file, find_system(system)) for file in files if file.plant.system == system]
    return tuple(sorted(found, key=lambda case: (case.name != "nominal", case.name)))


def find_case(system: str, name: str) -> Case:
    """One case by its name.

    Raises:
        ArgumentError: If the system has no such case.
    """
    found = {case.name: case for case in cases(system)}
    if name not in found:
        raise ArgumentError(unknown_name(f"case of {system}", name, found))
    return found[name]


def shipped_files() -> dict[str, Path]:
    """The case files of the package by their names, ``system/case``."""
    return {
        "/".join(path.relative_to(CASES).with_suffix("").parts): path
        for path in sorted(CASES.glob("*/*.toml"))
    }


def case_of(file: CaseFile, system: System, folder: Path | None = None) -> Case:
    """The experiment of a case file.

    Args:
        file: The file.
        system: What it is about.
        folder: Where profiles of the user's own are.

    Raises:
        ArgumentError: If a state is unknown, or a unit or profile does not fit.
    """
    return Case(
        system=system.name,
        name=file.name,
        title=file.title or file.name,
        source=file.source,
        x0=_start(file.run.start, system),
        duration=file.run.duration,
        edits=case_edits(file),
        disturbances=tuple(
            _disturbance(table, f"disturbance {i + 1}", folder)
            for i, table in enumerate(file.disturbance)
        ),
        design=file.task.design or "",
    )


def _start(given: Mapping[str, Any], system: System) -> tuple[float, ...]:
    """x(0) from values by the states' names."""
    names = [state.name for state in system.states]
    x0 = [0.0] * len(names)
    for name, value in given.items():
        if name not in names:
            raise ArgumentError(f"run: start: {unknown_name('state', name, names)}")
        try:
            x0[names.index(name)] = number_in(value, system.states[names.index(name)].unit)
        except ValueError as error:
            raise ArgumentError(f"run: start: {name}: {error}") from None
    return tuple(x0)


def case_edits(file: CaseFile) -> tuple[Edit, ...]:
    """The edits of the model that a case file makes."""
    return tuple(_edit(table) for table in file.edit if table.parameter is None)


def _edit(table: EditTable) -> Edit:
    """One edit of the model."""
    if table.joint is not None:
        return JointEdit(table.joint, table.damping, table.friction, table.armature)
    assert table.body is not None
    if table.added_mass is not None:
        return AddedMass(table.body, table.added_mass, (table.at[0], table.at[1], table.at[2]))
    return BodyEdit(table.body, table.mass_scale, table.length_scale)


def _disturbance(table: DisturbanceTable, where: str, folder: Path | None) -> Disturbance:
    """One disturbance."""
    wrench: Any = (*table.force, *table.torque)
    if not any(wrench):
        raise ArgumentError(f"{where}: it has neither force nor torque")
    try:
        return Disturbance(table.body, wrench, _profile(table, folder), table.label)
    except ArgumentError as error:
        raise ArgumentError(f"{where}: {error}") from None


def _profile(table: DisturbanceTable, folder: Path | None) -> Profile:
    """Its course in time."""
    if is_named(table.profile):
        return load_named(table.profile, folder or Path())
    used = {"constant": (), "pulse": ("start", "stop"), "sine": ("frequency", "phase", "onset")}
    if table.profile not in used:
        raise ArgumentError(unknown_name("profile", table.profile, [*used, "module:name"]))
    timed = {name for names in used.values() for name in names} & table.model_fields_set
    if idle := sorted(timed - set(used[table.profile])):
        raise ArgumentError(f"a {table.profile} has no {', '.join(idle)}")
    if table.profile == "pulse":
        if table.stop is None:
            raise ArgumentError("a pulse needs stop")
        return Pulse(table.start, table.stop)
    if table.profile == "sine":
        if table.frequency is None:
            raise ArgumentError("a sine needs frequency")
        return SineFrom(table.frequency, table.onset, table.phase)
    return Constant()
