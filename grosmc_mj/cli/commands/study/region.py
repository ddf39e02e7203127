"""grosmc-mj study region."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.targets import TARGET
from grosmc_mj.errors import ArgumentError
from grosmc_mj.files import written_aside

if TYPE_CHECKING:
    from rich.console import Console

    from grosmc_mj.studies.region.measure import Region, RegionQuestion
    from grosmc_mj.studies.region.region_map import RegionMap

# The outcomes of starts that do not converge, in the order of ``Outcome``.
_OTHERS = ("left", "singular", "not conv.", "diverged")


@dataclass(frozen=True)
class RegionCommand(Command):
    """Map from which starts each law of a SYSTEM converges, in MuJoCo.

    Each map has N x N starts of two states, by default the error of the controlled position and
    its rate; the other states start at rest. One map for each law on the nominal plant and on a
    perturbed one, under the law of the nominal. A start has converged if every error that the law
    regulates is within 1 degree and 0.1 rad/s (0.02 m and 0.1 m/s) at the end, or well within them
    at an earlier look; it has left the region if any sample of the law finds the state where the
    feedback linearization is undefined (the pole at or below the horizontal; the Jacobian LQR is
    stopped there too); the plant may be singular; or the run stays and does not converge.

    Writes region_SYSTEM.json, .png and .svg to --out.

    Attributes:
        target: servo, cart_pendulum, arm or two_link_arm; of SYSTEM/CASE the case is the perturbed
            plant, of a system its first case that edits bodies.
        controllers: Laws to map, such as cart-ism and cart-pfl; by default those of validate.
        points: Starts along each axis, from 2 to 1000.
        axes: Two states that the starts differ in, such as theta theta_dot or p theta.
        angle: Starts of an angle go from -DEG to DEG.
        rate: Starts of an angular rate go from -RATE to RATE, in rad/s.
        position: Starts of a position go from -M to M.
        speed: Starts of a speed go from -SPEED to SPEED, in m/s.
        duration: Time that a start is given to converge, in s.
        integrator: MuJoCo's integrator: implicitfast is the quickest; RK4, which the other commands
            use, takes four times as long.
        switching: Switching law of the sliding mode laws, as for validate.
        surface: printed or discrete, as for validate.
        screen: auto makes maps on the equations, in steps of RK4, where these give MuJoCo's own
            accelerations, and has every start beside another outcome confirmed in MuJoCo, and 2 %
            of the others; none makes all of them in MuJoCo.
        out: Folder for region_SYSTEM.json and the figure.
    """

    target: Annotated[Positional[str], arg(metavar=TARGET, name="target")]
    controllers: Annotated[
        tuple[str, ...],
        arg(metavar="NAME [NAME ...]", help_behavior_hint="(default: those of validate)"),
    ] = ()
    points: Annotated[int, arg(metavar="N")] = 100
    axes: Annotated[
        tuple[str, str] | None,
        arg(metavar="X Y", help_behavior_hint="(default: the controlled position and its rate)"),
    ] = None
    angle: Annotated[float, arg(metavar="DEG")] = 90.0
    rate: Annotated[float, arg(metavar="RATE")] = 10.0
    position: Annotated[float, arg(metavar="M")] = 1.0
    speed: Annotated[float, arg(metavar="SPEED")] = 2.0
    duration: Annotated[float, arg(metavar="S")] = 12.0
    integrator: Annotated[str, arg(metavar="NAME")] = "implicitfast"
    switching: Annotated[str, arg(metavar="NAME")] = "sign"
    surface: Annotated[str, arg(metavar="printed|discrete")] = "printed"
    screen: Annotated[str, arg(metavar="auto|none")] = "auto"
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")

    def execute(self) -> int:
        """Compute, write, print, draw."""
        from grosmc_mj.results.document import json_text
        from grosmc_mj.studies.region.figure import write_region_figure
        from grosmc_mj.studies.region.measure import Region
        from grosmc_mj.studies.region.report import (
            judged,
            legend,
            region_document,
            region_table,
        )

        began = time.perf_counter()
        question = self._question()
        asked = Region(question)
        base = self.out / f"region_{asked.system.name}"
        targets = [base.with_suffix(suffix) for suffix in (".json", ".png", ".svg")]
        # Opened before the work: a place that cannot be written is found out at once, and what is
        # there already stays until all of the new is complete.
        if self.screen != "none":
            for case, why in asked.why_not.items():
                if why:
                    print(f"{case}: not screened by equations: {why}.", file=sys.stderr)
        with written_aside(targets[0]) as part:
            maps: list[RegionMap] = []
            with screen.progress(asked.batches, "batches") as advance:
                maps.extend(asked.maps(advance))
            part.write_text(json_text(region_document(asked, maps)), encoding="utf-8")
        console = screen.console()
        _answer(console, asked, maps)
        if said := judged(maps):
            console.print(said, style="dim")
        console.print(legend(asked), style="dim")
        if self.verbose:
            screen.wide_console().print(region_table(asked, maps))
        write_region_figure(asked, maps, targets[1])
        console.print(
            f"{len(maps)} maps of {question.points} x {question.points} starts in "
            f"{time.perf_counter() - began:.1f} s"
        )
        screen.say_files(console, *targets)
        return screen.DONE

    def _question(self) -> RegionQuestion:
        """What is asked for, in SI units.

        Raises:
            ArgumentError: If a limit is not positive.
        """
        from grosmc_mj.experiments.runs import Settings
        from grosmc_mj.studies.region.measure import RegionQuestion

        options = ("angle", "rate", "position", "speed")
        for name in options:
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ArgumentError(f"--{name} {value:g} must be finite and positive")
        return RegionQuestion(
            system=self.target,
            points=self.points,
            duration=self.duration,
            axes=self.axes,
            limits={
                "rad": math.radians(self.angle),
                "rad/s": self.rate,
                "m": self.position,
                "m/s": self.speed,
            },
            settings=Settings(
                integrator=self.integrator,  # pyright: ignore[reportArgumentType]
                switching=self.switching,
                surface=self.surface,  # pyright: ignore[reportArgumentType]
            ),
            controllers=self.controllers,
            screen=self.screen,
        )


def _answer(console: Console, asked: Region, maps: Sequence[RegionMap]) -> None:
    """From how many starts each law converges, the least first."""
    from grosmc_mj.studies.region.outcome import Outcome

    rows, order = [], sorted(maps, key=lambda each: each.fractions()[Outcome.CONVERGED])
    for each in order:
        axis, interval = asked.axes[0], each.rest_interval()
        ends = [f"{axis.shown(end):+.1f}" for end in interval or ()]
        counts = each.counts()
        share = f"{100 * each.fractions()[Outcome.CONVERGED]:.1f}"
        others = (str(counts[outcome]) for outcome in Outcome if outcome is not Outcome.CONVERGED)
        rows.append((each.case.name, each.controller, share, *others, " to ".join(ends) or "none"))
    least = order[0]
    console.print(
        f"{least.controller} on {least.case.name} converges from the fewest starts: {rows[0][2]} % "
        f"of {least.grid.size}.",
        style="bold",
    )
    columns = ("plant", "law", "converged %", *_OTHERS, f"at rest [{asked.axes[0].shown_unit}]")
    console.print(screen.brief_table("", columns, rows, words=2, most=16))
