"""From which starts does each law converge?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Target, WholeNumber, command
from grosmc_mj.cli.study_command import StudyCommand
from grosmc_mj.ground.errors import ArgumentError

if TYPE_CHECKING:
    from grosmc_mj.output.results.result import Result
    from grosmc_mj.studies.region.region import RegionMap, RegionStudy


@command
class RegionCommand(StudyCommand["RegionStudy", "RegionMap"]):
    """Map from which starts each law of a SYSTEM converges, in MuJoCo.

    Each map has N x N starts of two states, by default the error of the controlled position and
    its rate; the other states start at rest. One map for each law on the nominal plant and on a
    perturbed one, under the law of the nominal. A start has converged if every error that the law
    regulates is within 1 degree and 0.1 rad/s (0.02 m and 0.1 m/s) at the end, or well within them
    at an earlier look; it has left the region if any sample of the law finds the state where the
    feedback linearization is undefined (the pole at or below the horizontal; the Jacobian LQR is
    stopped there too); the plant may be singular; or the run stays and does not converge.

    Steps are implicitfast's. Where equations give MuJoCo's own accelerations, maps are made on
    these, in steps of RK4, and every start beside another outcome is confirmed in MuJoCo, with 2 %
    of the others; all are if it overturns one of these.

    Where the loop draws something, starts beside another outcome and 2 % of the others run over
    --draws; all do if one of these differs.

    Writes region_SYSTEM.json, .png and .svg to --out, after Ctrl-C or SIGTERM what there is of
    them, and each finished map to the folder region_SYSTEM.

    Exit code: 0 if done, 1 if a law converges from no start, 2 if the command or the set-up is
    wrong.

    Attributes:
        target: servo, cart_pendulum, arm or two_link_arm; of SYSTEM/CASE the case is the perturbed
            plant, of a system its first case that edits bodies.
        laws: Laws to map, such as cart-ism and cart-pfl.
        points: Starts along each axis, from 2 to 1000.
        axes: Two states that the starts differ in, such as theta theta_dot or p theta.
        limits: Starts go from minus to plus this on each axis, in degrees, rad/s, m or m/s.
        duration: Time that a start is given to converge, in s.
        draws: Runs of a start in a loop with an encoder, noise, jitter or missed samples: each has
            random numbers of its own and other phases of the encoders, and all must converge.
    """

    target: Target
    _: KW_ONLY
    laws: Annotated[
        tuple[str, ...],
        Parameter(metavar="NAME...", show_default="those of validate"),
    ] = ()
    points: WholeNumber = 100
    axes: Annotated[
        tuple[str, ...],
        Parameter(metavar="X Y", show_default="the controlled position and its rate"),
    ] = ()
    limits: Annotated[
        tuple[float, ...],
        Parameter(metavar="X Y", show_default="90 degrees, 10 rad/s, 1 m, 2 m/s"),
    ] = ()
    duration: Annotated[float, Parameter(metavar="S")] = 12.0
    draws: WholeNumber = 10

    def study(self) -> RegionStudy:
        """Return the maps that the options describe.

        Raises:
            ArgumentError: If axes or limits are no pair, or another option does not fit.
        """
        from grosmc_mj.studies.region.region import RegionStudy

        pairs: dict[str, Any] = {"axes": self.axes or None, "limits": self.limits or None}
        for name, pair in pairs.items():
            if pair and len(pair) != 2:
                raise ArgumentError(f"--{name} {' '.join(map(str, pair))}: give two, X and Y")
        return RegionStudy(
            target=self.target,
            controllers=self.laws,
            points=self.points,
            duration=self.duration,
            draws=self.draws,
            **pairs,
        )

    def name_of(self, study: RegionStudy) -> str:
        """Return the name of the system."""
        return study.system.name

    def measure(self, study: RegionStudy, rows: list[RegionMap], folder: Path) -> None:
        """Compute the maps; say which are not made on the equations."""
        for case, reason in study.why_not.items():
            if reason:
                screen.notice(f"{case}: not screened by equations: {reason}.")
        super().measure(study, rows, folder)

    def result(self, study: RegionStudy, rows: Sequence[RegionMap], *, complete: bool) -> Result:
        """Return the result of the maps."""
        from grosmc_mj.studies.region.answer import region_result

        return region_result(study, rows, complete=complete)

    def draw(self, study: RegionStudy, rows: Sequence[RegionMap], path: Path) -> Sequence[Path]:
        """Draw the maps."""
        from grosmc_mj.studies.region.answer import write_region_figure

        return (write_region_figure(study, rows, path.with_suffix(".png")),)

    def keeps(self, study: RegionStudy, rows: Sequence[RegionMap]) -> bool:
        """Whether each law converges from some start."""
        converging = {law_map.controller for law_map in rows if law_map.converged > 0}
        return all(law_map.controller in converging for law_map in rows)
