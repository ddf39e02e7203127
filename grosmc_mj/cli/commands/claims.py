"""grosmc-mj claims: judge them, vary their choices, check premises."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command, Flag, Out
from grosmc_mj.cli.exit_codes import DIFFERS, DONE
from grosmc_mj.cli.targets import CASES
from grosmc_mj.errors import ArgumentError

if TYPE_CHECKING:
    from grosmc_mj.chapter.claims.claim import Claim, Finding
    from grosmc_mj.experiments.laboratory import Laboratory

_Claims = Annotated[
    Positional[str | None],
    arg(metavar="[SYSTEM|CLAIM]", name="target", help_behavior_hint="(default: all claims)"),
]


@dataclass(frozen=True)
class JudgeCommand(Command):
    """Judge the chapter's claims, each with its number: supported, refuted, undetermined, ...

    Every claim is measured on each plant that it can be asked of, at the control period and at half
    of it; a verdict that changes in between is inconclusive. What turns on something that the
    chapter does not print is undetermined; a claim that fails because a premise failed says so.
    The chapter's claims are counted by the sentence that they rest on: it is refuted if any of them
    is, and supported only if all are. Of one claim the whole story is told, and drawn.
    Writes claims.json or, of one claim, claims/CLAIM.json and claims/CLAIM.png. Exit code 1 if a
    verdict is not the one that the repository expects.

    Attributes:
        target: servo, cart_pendulum, arm or two_link_arm; or one claim.
        page: Write the page on all claims too, with its figures beside it.
        out: Folder for JSON and figures.
    """

    target: _Claims = None
    page: Annotated[Path | None, arg(metavar="FILE.md", help_behavior_hint="")] = None
    out: Out = Path("renders")

    def execute(self) -> int:
        """Judge, write, print, compare."""
        from grosmc_mj.chapter.claims.judging import verdict_differences
        from grosmc_mj.chapter.claims.ledger import select_claims
        from grosmc_mj.chapter.claims.page import write_page
        from grosmc_mj.chapter.claims.picture import write_picture
        from grosmc_mj.chapter.claims.results import claims_result
        from grosmc_mj.chapter.claims.story import claim_tables

        if self.page is not None and self.page.suffix != ".md":
            raise ArgumentError(f"--page {self.page} must end in .md")
        if self.page is not None and self.target:
            raise ArgumentError(f"--page {self.page} is about all claims: leave out {self.target}")
        lab = _laboratory()
        findings = judge_with_progress(lab, select_claims(self.target))
        single = findings[0].claim.id == self.target
        path = self.out / (f"claims/{self.target}.json" if single else "claims.json")
        lines = [f"differs: {line}" for line in verdict_differences(findings)]
        screen.say_result(
            claims_result(findings, lab), path, lines, full=self.verbose, brief=2,
            tables=claim_tables(findings[0]) if single else (),
        )  # fmt: skip
        if single:
            picture = write_picture(findings[0], lab, path.with_suffix(".png"))
            screen.say_files(screen.console(), picture)
        if self.page is not None:
            screen.say_files(screen.console(), *write_page(findings, lab, self.page))
        return DIFFERS if lines else DONE


@dataclass(frozen=True)
class SweepCommand(Command):
    """Vary every choice that a claim depends on, and show where its answer turns.

    Writes sweeps.json.

    Attributes:
        target: servo, cart_pendulum, arm or two_link_arm; or one claim.
        record: Keep the sweeps of all claims as what the package knows.
        out: Folder for sweeps.json.
    """

    target: _Claims = None
    record: Flag = False
    out: Out = Path("renders")

    def execute(self) -> int:
        """Vary, write, print."""
        from grosmc_mj.chapter.claims.ledger import select_claims
        from grosmc_mj.chapter.claims.results import sweeps_result
        from grosmc_mj.chapter.claims.sweep import STORED, sweep

        if self.record and self.target:
            raise ArgumentError(f"--record keeps the sweeps of all claims: leave out {self.target}")
        lab, claims = _laboratory(), select_claims(self.target)
        with screen.progress(len(claims), "claims") as advance:
            content = sweeps_result(list(sweep(lab, claims, advance)), lab)
        path = STORED if self.record else self.out / "sweeps.json"
        screen.say_result(content, path, full=self.verbose)
        return DONE


@dataclass(frozen=True)
class PremisesCommand(Command):
    """Check the premises of the theorems in each case.

    Controllability, G B, relative degree, matching, the input-gain ratio, the switching gain
    required against the one configured (with the input gain's uncertainty counted), s(0), singular
    states. Over the declared operating region and along the run: the least margin, where it is, how
    often it is violated, and the smallest gain that restores it. Writes premises_SYSTEM.json.

    Attributes:
        target: A system, or one of its cases.
        laws: The law whose premises are checked.
        out: Folder for premises_SYSTEM.json.
    """

    target: Annotated[Positional[str], arg(metavar=CASES, name="target")]
    laws: Annotated[str, arg(metavar="NAME")] = "grosmc"
    out: Out = Path("renders")

    def execute(self) -> int:
        """Check, write, print what fails."""
        from grosmc_mj.assumptions.robot import audit_of
        from grosmc_mj.chapter.premises import premises_result, worst_points
        from grosmc_mj.experiments.catalogue import find_experiments

        lab, experiments = _laboratory(), find_experiments(self.target)
        # The theorems know of no loop: of a system its benches are left out.
        experiments = [one for one in experiments if one.case.loop is None] or experiments
        audits = [audit_of(lab, experiment, self.laws) for experiment in experiments]
        path = self.out / f"premises_{experiments[0].case.system}.json"
        points = [f"{audit.case.name}: {line}" for audit in audits for line in worst_points(audit)]
        screen.say_result(premises_result(audits, lab.settings), path, points, full=self.verbose)
        return DONE


CLAIMS = {
    "judge": JudgeCommand,
    "sweep": SweepCommand,
    "premises": PremisesCommand,
}


def _laboratory() -> Laboratory:
    from grosmc_mj.experiments.laboratory import Laboratory
    from grosmc_mj.experiments.runs import Settings

    return Laboratory(Settings())


def judge_with_progress(lab: Laboratory, claims: Sequence[Claim]) -> list[Finding]:
    """Judge claims with a progress bar."""
    with screen.progress(len(claims), "claims") as advance:
        return judge_in_processes(lab, claims, advance)


def judge_in_processes(
    lab: Laboratory, claims: Sequence[Claim], advance: Callable[[str], object]
) -> list[Finding]:
    """Judge claims on all cores."""
    from grosmc_mj.chapter.claims.judging import judge_claims
    from grosmc_mj.executors import executor_for

    # Of one claim the runs are drawn afterwards: they are made here.
    return judge_claims(lab, claims, executor_for(len(claims)), advance, screen.notice)
