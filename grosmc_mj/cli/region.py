"""grosmc-mj region."""

from __future__ import annotations

import contextlib
import json
import math
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.table import Table

from grosmc_mj.cli import screen
from grosmc_mj.cli.commands import Region as RegionCommand
from grosmc_mj.errors import ArgumentError
from grosmc_mj.files import written_aside

if TYPE_CHECKING:
    from grosmc_mj.studies.region.measure import Region, RegionMap, RegionQuestion


def region(command: RegionCommand) -> int:
    """Compute, draw, write, print."""
    from grosmc_mj.studies.region.figure import save_figure
    from grosmc_mj.studies.region.measure import Region
    from grosmc_mj.studies.region.report import region_document

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
        content = region_document(asked, maps)
        text = json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)
        part.write_text(text + "\n", encoding="utf-8")
    console = screen.console()
    console.print(_table(asked, maps))
    console.print(_legend(asked), style="dim", width=100)
    with contextlib.ExitStack() as files:
        save_figure(asked, maps, [files.enter_context(written_aside(each)) for each in targets[1:]])
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


def _table(asked: Region, maps: Sequence[RegionMap]) -> Table:
    """One row a map: its counts, and how far on the first axis alone it converges."""
    from grosmc_mj.studies.region.outcome import Outcome

    axis, gap = asked.axes[0], "\N{NO-BREAK SPACE}"
    table = Table(title=f"{asked.system.title}: outcomes of the starts", title_justify="left")
    words = ["\n".join(outcome.title.rsplit(" ", 1)) for outcome in Outcome]
    for column in ("plant", "controller", *words, f"at rest [{axis.shown_unit}]", "time"):
        table.add_column(column, justify="left" if column in ("plant", "controller") else "right")
    for each in maps:
        interval = each.rest_interval()
        whole = interval == (float(each.line_starts[0]), float(each.line_starts[-1]))
        ends = [f"{axis.shown(end):+.1f}" for end in interval or ()]
        converged, *others = (str(count) for count in each.counts().values())
        table.add_row(
            each.case.name,
            each.controller,
            f"{converged} ({100 * each.fractions()[Outcome.CONVERGED]:.1f} %)".replace(" ", gap),
            *others,
            "all of them" if whole else gap.join((ends[0], "to", ends[1])) if ends else "none",
            f"{each.seconds:.1f}{gap}s",
            end_section=each.controller == asked.controllers[-1],
        )
    return table


def _legend(asked: Region) -> str:
    """What the words of the table mean."""
    axis = asked.axes[0]
    bounds = {
        f"|error of {symbol}| <= {value:.3g} {unit}"
        for controller in asked.controllers
        for symbol, (value, unit) in asked.tolerances(controller).items()
    }
    return (
        f"converged: {' and '.join(sorted(bounds))} after {asked.question.duration:g} s; left the "
        f"region: a sample of the law not in the region ({asked.system.region}); at rest: the "
        f"widest interval of starts of {axis.symbol} alone, about zero, that all converge."
    )
