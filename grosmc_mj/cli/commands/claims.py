"""grosmc-mj claims: judge them, vary their choices, check premises."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import OUTPUT, Command, Flag, Out, command
from grosmc_mj.cli.exit_codes import DIFFERS, DONE
from grosmc_mj.cli.targets import CASES
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.files import require_writable

if TYPE_CHECKING:
    from grosmc_mj.chapter.claims.claim import Claim, Finding
    from grosmc_mj.experiments.run_cache import RunCache

_Claims = Annotated[str | None, Parameter(show_default="all claims")]


@command
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
    _: KW_ONLY
    page: Annotated[Path | None, Parameter(metavar="FILE.md", group=OUTPUT)] = None
    out: Out = Path("renders")

    def execute(self) -> int:
        """Judge the claims, write and print the result, compare it with the expected verdicts."""
        from grosmc_mj.chapter.claims.judging import verdict_differences
        from grosmc_mj.chapter.claims.ledger import select_claims
        from grosmc_mj.chapter.claims.page import write_page
        from grosmc_mj.chapter.claims.picture import write_picture
        from grosmc_mj.chapter.claims.results import claims_result

        self._refuse_page()
        claims = select_claims(self.target)
        path = self.out / "claims.json"
        if claims[0].id == self.target:
            path = self.out / f"claims/{self.target}.json"
        require_writable(path)
        lab = _run_cache()
        findings = judge_with_progress(lab, claims)
        differences = [f"differs: {line}" for line in verdict_differences(findings)]
        result = claims_result(findings, lab.settings, differences)
        if findings[0].claim.id == self.target:
            picture = path.with_suffix(".png")
            screen.say_result(
                result,
                path,
                lambda: (write_picture(findings[0], lab, picture),),
                full=self.verbose,
            )
        else:
            screen.say_result(result, path, full=self.verbose)

        if self.page is not None:
            screen.say_files(screen.console(), *write_page(findings, lab, self.page))
        return DIFFERS if differences else DONE

    def _refuse_page(self) -> None:
        """Refuse a page that is no Markdown, or is about some claims only."""
        if self.page is None:
            return
        if self.page.suffix != ".md":
            raise ArgumentError(f"--page {self.page} must end in .md")
        if self.target:
            raise ArgumentError(f"--page {self.page} is about all claims: leave out {self.target}")


@command
class SweepCommand(Command):
    """Vary every choice that a claim depends on, and show where its answer turns.

    Writes sweeps.json.

    Attributes:
        target: servo, cart_pendulum, arm or two_link_arm; or one claim.
        record: Keep the sweeps of all claims as what the package knows.
        out: Folder for sweeps.json.
    """

    target: _Claims = None
    _: KW_ONLY
    record: Flag = False
    out: Out = Path("renders")

    def execute(self) -> int:
        """Vary the choices, write and print the result."""
        from grosmc_mj.chapter.claims.ledger import select_claims
        from grosmc_mj.chapter.claims.results import sweeps_result
        from grosmc_mj.chapter.claims.sweep import STORED, sweep

        if self.record and self.target:
            raise ArgumentError(f"--record keeps the sweeps of all claims: leave out {self.target}")

        path = STORED if self.record else self.out / "sweeps.json"
        require_writable(path)
        lab = _run_cache()
        claims = select_claims(self.target)
        with screen.progress(len(claims), "claims") as advance:
            sweeps = list(sweep(lab, claims, advance))

        screen.say_result(sweeps_result(sweeps, lab.settings), path, full=self.verbose)
        return DONE


@command
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

    target: Annotated[str, Parameter(metavar=CASES)]
    _: KW_ONLY
    laws: Annotated[str, Parameter(metavar="NAME")] = "grosmc"
    out: Out = Path("renders")

    def execute(self) -> int:
        """Check the premises, write the result and print what fails."""
        from grosmc_mj.chapter.premises import premises_result
        from grosmc_mj.experiments.assumptions.robot import audit_of
        from grosmc_mj.experiments.catalogue import find_experiments

        lab = _run_cache()
        experiments = find_experiments(self.target)
        # The theorems know of no loop: of a system its benches are left out.
        without_loop = [item for item in experiments if item.loop is None]
        if without_loop:
            experiments = without_loop

        path = self.out / f"premises_{experiments[0].system}.json"
        require_writable(path)
        audits = [audit_of(lab, experiment, self.laws) for experiment in experiments]
        screen.say_result(premises_result(audits, lab.settings), path, full=self.verbose)
        return DONE


def _run_cache() -> RunCache:
    """Return an empty cache of runs with the default settings."""
    from grosmc_mj.experiments.run_cache import RunCache
    from grosmc_mj.experiments.settings import Settings

    return RunCache(Settings())


def judge_with_progress(lab: RunCache, claims: Sequence[Claim]) -> list[Finding]:
    """Judge claims with a progress bar."""
    with screen.progress(len(claims), "claims") as advance:
        return judge_in_processes(lab, claims, advance)


def judge_in_processes(
    lab: RunCache,
    claims: Sequence[Claim],
    advance: Callable[[str], object],
) -> list[Finding]:
    """Judge claims on all cores."""
    from grosmc_mj.chapter.claims.judging import judge_claims
    from grosmc_mj.ground.executors import executor_for

    # The runs of one claim are drawn afterwards: its executor makes them in this process.
    return judge_claims(lab, claims, executor_for(len(claims)), advance, screen.notice)
