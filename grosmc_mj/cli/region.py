"""grosmc-mj region."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from grosmc_mj.cli import screen
from grosmc_mj.cli.commands import Region as RegionCommand
from grosmc_mj.errors import ArgumentError
from grosmc_mj.files import written_aside

if TYPE_CHECKING:
    from grosmc_mj.studies.region.measure import RegionMap, RegionQuestion


def region(command: RegionCommand) -> int:
    """Compute, draw, write, print."""
    from grosmc_mj.report.document import json_text
    from grosmc_mj.studies.region.figure import write_region_figure
    from grosmc_mj.studies.region.measure import Region
    from grosmc_mj.studies.region.report import legend, region_document, region_table

    began = time.perf_counter()
    question = _question(command)
    asked = Region(question)
    base = command.out / f"region_{asked.system.name}"
    targets = [base.with_suffix(suffix) for suffix in (".json", ".png", ".svg")]
    # Opened before the work: a place that cannot be written is found out at once, and what is
    # there already stays until all of the new is complete.
    with written_aside(targets[0]) as part:
        maps: list[RegionMap] = []
        with screen.progress(asked.batches, "batches") as advance:
            maps.extend(asked.maps(advance))
        part.write_text(json_text(region_document(asked, maps)), encoding="utf-8")
    console = screen.console()
    console.print(region_table(asked, maps))
    console.print(legend(asked), style="dim", width=100)
    write_region_figure(asked, maps, targets[1])
    console.print(
        f"{len(maps)} maps of {question.points} x {question.points} starts in "
        f"{time.perf_counter() - began:.1f} s; {', '.join(str(target) for target in targets)}",
        soft_wrap=True,
    )
    return screen.DONE


def _question(command: RegionCommand) -> RegionQuestion:
    """What the command asks for, in SI units.

    Raises:
        ArgumentError: If a limit is not positive.
    """
    from grosmc_mj.experiments.runs import Settings
    from grosmc_mj.studies.region.measure import RegionQuestion

    options = ("angle", "rate", "position", "speed")
    for name in options:
        value = getattr(command, name)
        if not (math.isfinite(value) and value > 0):
            raise ArgumentError(f"--{name} {value:g} must be finite and positive")
    return RegionQuestion(
        system=command.system,
        case=command.case,
        points=command.points,
        duration=command.duration,
        axes=command.axes,
        limits={
            "rad": math.radians(command.angle),
            "rad/s": command.rate,
            "m": command.position,
            "m/s": command.speed,
        },
        settings=Settings(
            integrator=command.integrator,  # pyright: ignore[reportArgumentType]
            switching=command.switching,
            surface=command.surface,  # pyright: ignore[reportArgumentType]
        ),
        controllers=command.controllers,
    )
