"""Refusal of a case file whose tables do not fit each other."""

from __future__ import annotations

from grosmc_mj.experiments.file.schema import CaseFile
from grosmc_mj.experiments.laws.packaged import knows_limits
from grosmc_mj.experiments.plants import NominalPlant
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import Mistakes
from grosmc_mj.ground.files import name_in_files
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.simulation.loop.timing import stride_of


def refuse_inconsistent(
    file: CaseFile, nominal: NominalPlant, loop: Loop | None, settings: Settings
) -> None:
    """Refuse loops, controllers and plants that do not fit each other.

    Raises:
        ArgumentError: For all mistakes.
    """
    mistakes = Mistakes()
    with mistakes.gathered():
        stride_of(settings.control_period, settings.timestep)
    duration = file.run.duration
    if settings.control_period >= duration:
        mistakes.note(
            f"run: control_period: {settings.control_period:g} s must be below the duration of "
            f"{duration:g} s"
        )
    if loop is not None:
        with mistakes.gathered():
            loop.require_fits(nominal.system, settings.timestep, settings.control_period)

    names = [table.called for table in file.controller]
    for table in file.controller:
        if table.predict and loop is None:
            mistakes.note(
                f"controller {table.called}: predict: there is no loop that it could know: give "
                "the file a [computing], a [[sensor]] or an [[actuator]]"
            )
        if names.count(table.called) > 1:
            mistakes.note(f"two controllers are called {table.called!r}: give one another name")

    by_file: dict[str, str] = {}
    for name in names:
        other = by_file.setdefault(name_in_files(name), name)
        if other != name:
            mistakes.note(
                f"controllers {other!r} and {name!r} would share the file of "
                f"{name_in_files(name)}: give one another name"
            )

    if file.known_loop is not None:
        tables = [file.law(name) for name in names]
        if not any(table.predict or knows_limits(table, nominal) for table in tables):
            mistakes.note("known_loop: no controller has predict = true, so none knows its loop")
    for name in file.plant.compare or ():
        with mistakes.gathered("plant: compare: "):
            require_known("plant", name, nominal.names)
    mistakes.refuse()
