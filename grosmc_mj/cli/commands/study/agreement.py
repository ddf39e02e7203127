"""grosmc-mj study agreement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.targets import TARGET, plant_with_equations
from grosmc_mj.errors import ArgumentError

if TYPE_CHECKING:
    from rich.table import Table

    from grosmc_mj.studies.agreement.measure import Agreement

# Of the states under each of the edits; a hundred thousand take a minute.
_MOST_STATES, _MOST_EDITS = 10**6, 10**4


@dataclass(frozen=True)
class AgreementCommand(Command):
    """Compare a plant's equations with MuJoCo.

    Measures the largest difference of the accelerations at random states, inputs and wrenches,
    and of an open-loop trajectory under wrenches, for the nominal model and for random edits of
    mass and length. Writes agreement_SYSTEM.json to --out. Exit code 1 if the corrected equations
    do not agree to 1e-10.

    Attributes:
        target: servo, cart_pendulum, arm or two_link_arm, or a case whose plant has both.
        states: Random states of each comparison.
        edits: Random edits of mass (x0.25 to x4) and length (x0.5 to x4).
        seed: Of the random numbers.
        out: Folder for agreement_SYSTEM.json.
    """

    target: Annotated[Positional[str], arg(metavar=TARGET, name="target")]
    states: Annotated[int, arg(metavar="N")] = 1000
    edits: Annotated[int, arg(metavar="N")] = 5
    seed: Annotated[int, arg(metavar="N")] = 0
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")

    def execute(self) -> int:
        """Measure, write, print."""
        from grosmc_mj.report.document import write_json
        from grosmc_mj.studies.agreement.measure import AGREEMENT_BOUND, agreements, disagreements
        from grosmc_mj.studies.agreement.report import agreement_table, comparison_document

        ranges = (
            ("states", self.states, 1, _MOST_STATES),
            ("edits", self.edits, 0, _MOST_EDITS),
            ("seed", self.seed, 0, 2**63 - 1),
        )
        for name, value, least, most in ranges:
            if not least <= value <= most:
                raise ArgumentError(f"--{name} {value} must be from {least} to {most}")
        physics = plant_with_equations(self.target)
        rows = agreements(physics, seed=self.seed, states=self.states, edits=self.edits)
        found = disagreements(rows)
        target = self.out / f"agreement_{physics.system.name}.json"
        write_json(target, comparison_document(rows, found, self.seed))
        console = screen.console()
        worst = max(row.acceleration for row in rows if row.variant == "corrected")
        screen.say_verdict(
            console,
            f"Accelerations of the corrected equations and of MuJoCo differ by up to {worst:.1e} "
            f"of the largest term (bound {AGREEMENT_BOUND:.0e}).",
            good=not found,
        )
        screen.say_lines(console, [f"differs: {line}" for line in found], all=self.verbose)
        console.print(worst_agreements(rows))
        console.print(f"At {self.states} states of each model, seed {self.seed}.", style="dim")
        screen.say_files(console, target)
        if self.verbose:
            screen.wide_console().print(agreement_table(rows))
        return screen.DIFFERS if found else screen.DONE


def worst_agreements(rows: Sequence[Agreement]) -> Table:
    """The worst of each variant of the equations, over all edits."""
    lines = []
    for variant in dict.fromkeys(row.variant for row in rows):
        own = [row for row in rows if row.variant == variant]
        worst = max(own, key=lambda row: row.acceleration)
        trajectory = max(row.trajectory for row in own)
        lines.append((variant, worst.edit, f"{worst.acceleration:.1e}", f"{trajectory:.1e}"))
    columns = (
        "equations", "worst model", "acceleration, over largest term", "trajectory [m, rad]",
    )  # fmt: skip
    return screen.brief_table("Largest differences from MuJoCo", columns, lines, words=2)
