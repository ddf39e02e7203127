"""grosmc-mj claims: judge them, vary their choices, try them with faults, check premises."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.targets import CASES
from grosmc_mj.errors import ArgumentError
from grosmc_mj.results.palette import FAILED

if TYPE_CHECKING:
    from grosmc_mj.chapter.claims.claim import Claim, Finding
    from grosmc_mj.experiments.laboratory import Laboratory

_Claims = Annotated[
    Positional[str | None],
    arg(metavar="[SYSTEM|CLAIM]", name="target", help_behavior_hint="(default: all claims)"),
]
_Out = Annotated[Path, arg(metavar="DIR")]


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
    out: _Out = Path("renders")

    def execute(self) -> int:
        """Judge, write, print, compare."""
        from grosmc_mj.chapter.claims.judging import verdict_differences
        from grosmc_mj.chapter.claims.ledger import select_claims
        from grosmc_mj.chapter.claims.page import write_page
        from grosmc_mj.chapter.claims.picture import write_picture
        from grosmc_mj.chapter.claims.results import claims_result
        from grosmc_mj.chapter.claims.story import claim_tables, claims_tables
        from grosmc_mj.results.document import write_json

        if self.page is not None and (self.target or self.page.suffix != ".md"):
            raise ArgumentError(f"--page {self.page} is about all claims, and ends in .md")
        lab, console = _laboratory(), screen.console()
        findings = judge_with_progress(lab, select_claims(self.target))
        single = findings[0].claim.id == self.target
        path = self.out / (f"claims/{self.target}.json" if single else "claims.json")
        write_json(path, claims_result(findings, lab))
        differing = verdict_differences(findings)
        words = "All verdicts are as expected."
        if differing:
            words = f"{len(differing)} verdicts differ from the expected ones."
        screen.say_verdict(console, words, good=not differing)
        screen.say_lines(console, [f"differs: {x}" for x in differing], all=self.verbose)
        tables = claim_tables(findings[0]) if single else claims_tables(findings)
        console.print(*(tables if single or self.verbose else tables[:2]))
        files = [path]
        if single:
            files.append(write_picture(findings[0], lab, path.with_suffix(".png")))
        if self.page is not None:
            files += write_page(findings, lab, self.page)
        screen.say_files(console, *files)
        return screen.DIFFERS if differing else screen.DONE


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
    record: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    out: _Out = Path("renders")

    def execute(self) -> int:
        """Vary, write, print."""
        from grosmc_mj.chapter.claims.ledger import select_claims
        from grosmc_mj.chapter.claims.results import sweeps_result
        from grosmc_mj.chapter.claims.story import turning_table
        from grosmc_mj.chapter.claims.sweep import STORED, sweep
        from grosmc_mj.results.document import write_json

        if self.record and self.target:
            raise ArgumentError(f"--record keeps the sweeps of all claims: leave out {self.target}")
        lab, claims = _laboratory(), select_claims(self.target)
        with screen.progress(len(claims), "claims") as advance:
            content = sweeps_result(list(sweep(lab, claims, advance)), lab)
        path = STORED if self.record else self.out / "sweeps.json"
        write_json(path, content)
        console, words = screen.console(), content["answers"][0]["words"]
        screen.say_verdict(console, f"{words}.", good=words.startswith("0 "))
        console.print(turning_table(content["sweeps"]))
        screen.say_files(console, path)
        return screen.DONE


@dataclass(frozen=True)
class SelfTestCommand(Command):
    """Put faults into laws and plants, one at a time, and show which claims notice.

    A claim that has noticed one is asked no more, but with --verbose. Writes self_test.json. Exit
    code 1 if a fault is not noticed, or a claim notices none.

    Attributes:
        target: servo, cart_pendulum, arm or two_link_arm; or one claim.
        out: Folder for self_test.json.
    """

    target: _Claims = None
    out: _Out = Path("renders")

    def execute(self) -> int:
        """Try, write, print."""
        from grosmc_mj.chapter.claims.faults import FAULTS
        from grosmc_mj.chapter.claims.ledger import select_claims
        from grosmc_mj.chapter.claims.results import self_test_result
        from grosmc_mj.chapter.claims.self_test import self_test
        from grosmc_mj.chapter.claims.story import noticed_table
        from grosmc_mj.executors import executor_for
        from grosmc_mj.experiments.runs import Settings
        from grosmc_mj.results.document import write_json

        claims, console = select_claims(self.target), screen.console()
        with screen.progress(len(claims), "claims") as advance:
            caught = self_test(
                Settings(), claims, FAULTS, executor_for(len(claims)), advance, screen.notice,
                thorough=self.verbose,
            )  # fmt: skip
        write_json(self.out / "self_test.json", self_test_result(caught))
        missed = [each.fault.name for each in caught if not each.claims]
        noticing = {name for each in caught for name in each.claims}
        blind = [claim.id for claim in claims if claim.id not in noticing]
        if not missed and not blind:
            words = "Every fault is noticed, and every claim notices one."
            screen.say_verdict(console, words, good=True)
        for words, names in (("not noticed by any claim", missed), ("notices no fault", blind)):
            if names:
                screen.say_verdict(console, f"{', '.join(names)}: {words}", good=False)
        console.print(noticed_table(caught))
        return screen.DIFFERS if missed or blind else screen.DONE


@dataclass(frozen=True)
class PremisesCommand(Command):
    """Check the premises of the theorems in each case.

    Controllability, G B, relative degree, matching, the input-gain ratio, the switching gain
    required against the one configured (with the input gain's uncertainty counted), s(0), singular
    states. Over the declared operating region and along the run: the least margin, where it is, how
    often it is violated, and the smallest gain that restores it. Writes premises_SYSTEM.json.

    Attributes:
        target: A system, or one of its cases.
        controller: Whose premises.
        out: Folder for premises_SYSTEM.json.
    """

    target: Annotated[Positional[str], arg(metavar=CASES, name="target")]
    controller: Annotated[str, arg(metavar="NAME")] = "grosmc"
    out: _Out = Path("renders")

    def execute(self) -> int:
        """Check, write, print what fails."""
        from grosmc_mj.assumptions.robot import audit_of
        from grosmc_mj.chapter.premises import (
            audit_table,
            failures_table,
            premises_result,
            premises_words,
            worst_points,
        )
        from grosmc_mj.experiments.catalogue import find_experiments
        from grosmc_mj.results.document import write_json

        lab, experiments = _laboratory(), find_experiments(self.target)
        # The theorems know of no loop: of a system its benches are left out.
        experiments = [one for one in experiments if one.case.loop is None] or experiments
        audits = [audit_of(lab, experiment, self.controller) for experiment in experiments]
        file = self.out / f"premises_{experiments[0].case.system}.json"
        write_json(file, premises_result(audits, lab.settings))
        console, good = screen.console(), not any(audit.failed() for audit in audits)
        screen.say_verdict(console, premises_words(audits), good=good)
        if not good:
            console.print(failures_table(audits))
            points = [f"{each.case.name}: {line}" for each in audits for line in worst_points(each)]
            screen.say_lines(console, points, FAILED, all=self.verbose)
        screen.say_files(console, file)
        for audit in audits if self.verbose else ():
            console.print(audit_table(audit))
        return screen.DONE


CLAIMS = {
    "judge": JudgeCommand,
    "sweep": SweepCommand,
    "self-test": SelfTestCommand,
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
