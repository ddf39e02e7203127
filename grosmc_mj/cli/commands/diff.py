"""grosmc-mj diff."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command

if TYPE_CHECKING:
    from rich.console import Console

    from grosmc_mj.comparison.comparison import ResultComparison

# Rows and lines of an answer.
_ROWS, _LINES = 16, 8


@dataclass(frozen=True)
class DiffCommand(Command):
    """Compare two results: what changed, by how much, and which of it is noise.

    Each side is a file or a folder with what run, validate, claims, study and campaign have
    written. On the same machine with the same versions a run repeats to the bit, so that any
    change beyond rounding is real; on another one, what switching amplifies is noise. Campaigns
    are compared by tests, plant by plant where the plants are the same. diff.json goes to --out,
    and grosmc-mj report shows it.

    Exit code: 0 if nothing got worse beyond noise, 1 if something did or is gone, 2 if the results
    cannot be compared.

    Attributes:
        old: Results before.
        new: Results after.
        junit: Write a JUnit file, too.
        out: Folder for diff.json.
    """

    old: Annotated[Positional[Path], arg(metavar="OLD")]
    new: Annotated[Positional[Path], arg(metavar="NEW")]
    junit: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="(default: none)")] = None
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")

    @property
    def simulates(self) -> bool:
        """Whether it needs MuJoCo: it reads results."""
        return False

    def execute(self) -> int:
        """Compare, write, say."""
        from grosmc_mj.comparison.comparison import compare, comparison_document
        from grosmc_mj.comparison.junit import write_junit
        from grosmc_mj.results.document import write_json

        comparison = compare(self.old, self.new)
        files = [self.out / "diff.json"]
        write_json(files[0], comparison_document(comparison))
        if self.junit is not None:
            write_junit(self.junit, comparison)
            files.append(self.junit)
        _say(screen.console(), comparison, full=self.verbose)
        screen.say_files(screen.console(), *files)
        return screen.DIFFERS if comparison.worse else screen.DONE


def _say(console: Console, comparison: ResultComparison, *, full: bool) -> None:
    """The verdict, what changed, and what it was made from."""
    from grosmc_mj.comparison.changes import Effect

    counts, worse = comparison.counts, len(comparison.worse)
    said = f"{worse} got worse beyond noise" if worse else "Nothing got worse beyond noise"
    others = ", ".join(
        f"{counts[effect]} {effect.value}"
        for effect in Effect
        if effect is not Effect.WORSE and counts[effect]
    )
    told = f"; {others}" if others else ""
    screen.say_verdict(console, f"{said}, of {comparison.compared} compared{told}.", good=not worse)
    if unjudged := counts[Effect.UNJUDGED]:
        console.print(
            f"{unjudged} differences cannot be judged: they are of single runs whose chance had "
            "another seed, which tell nothing of how far it scatters. Compare campaigns of both, "
            "or runs of the same seed."
        )
    told_of = (Effect.NOISE, Effect.UNJUDGED)
    real = [each for each in comparison.changes if full or each.effect not in told_of]
    if real:
        rows = [
            (each.effect.value, each.name, _value(each.before), _value(each.after), each.unit)
            for each in real
        ]
        columns = ("", "of", "before", "after", "unit")
        most = len(rows) if full else _ROWS
        console.print(screen.brief_table("What changed", columns, rows, words=2, most=most))
    for title, lines in (("Made from", comparison.sources), ("Not read", comparison.notices)):
        if lines:
            console.print(f"{title}:", style="bold")
            shown = lines if full else lines[:_LINES]
            for line in shown:
                console.print(f"  {line}", markup=False, no_wrap=not full, overflow="ellipsis")
            if left := len(lines) - len(shown):
                console.print(f"  ... and {left} more: --verbose has them", style="dim")


def _value(value: float | str | None) -> str:
    if value is None:
        return "none"
    return value if isinstance(value, str) else f"{value:.5g}"
