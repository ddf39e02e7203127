"""grosmc-mj claims, and the claims of grosmc-mj validate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.commands.premises import audit_premises
from grosmc_mj.cli.targets import CASES
from grosmc_mj.errors import ArgumentError, shown

if TYPE_CHECKING:
    from rich.console import Console

    from grosmc_mj.chapter.claims.claim import Claim, Finding
    from grosmc_mj.experiments.laboratory import Laboratory
    from grosmc_mj.experiments.runs import Settings
    from grosmc_mj.results.tables import Table

# So many claims that are not supported fit on a screen.
_MOST = 24


@dataclass(frozen=True)
class ClaimsCommand(Command):
    """Judge the chapter's claims, each with its number: SUPPORTED, REFUTED, UNDETERMINED, ...

    Every claim is measured on each plant that it can be asked of, at the control period and at half
    of it; a verdict that changes in between is inconclusive. What turns on something that the
    chapter does not print is undetermined; a claim that fails because a premise failed says so.
    The chapter's claims are counted by the sentence that they rest on: it is refuted if any of them
    is, and supported only if all are.
    Writes claims.json to --out, with --explain claims/CLAIM.json, with --sweep sweeps.json, with
    --self-test self_test.json. Exit code 1 if a verdict is not the one that the repository expects.

    With --premises those of the theorems are checked instead, for each case: controllability, G B,
    relative degree, matching, the input-gain ratio, the switching gain required against the one
    configured (with the input gain's uncertainty counted), s(0), singular states. Over the declared
    operating region and along the run: the least margin, where it is, how often it is violated, and
    the smallest gain that restores it. Writes premises_SYSTEM.json.

    Attributes:
        target: servo, cart_pendulum, arm or two_link_arm; for --premises one of its cases too.
        explain: Tell the whole story of this claim, and write its figure to --out.
        premises: Check the premises of the theorems instead.
        controller: Whose premises.
        json: Print JSON instead of tables.
        sweep: Vary every choice that a claim depends on, and show where its answer turns.
        record: With --sweep of all claims, keep it as what the package knows.
        self_test: Put faults into laws and plants, one at a time, and show which claims notice; a
            claim that has noticed one is asked no more, but with --verbose.
        page: Write the page on the chapter's defects, with its figures beside it.
        out: Folder for claims.json and figures.
    """

    target: Annotated[
        Positional[str | None],
        arg(metavar=f"[{CASES}]", name="target", help_behavior_hint="(default: all systems)"),
    ] = None
    explain: Annotated[str | None, arg(metavar="CLAIM", help_behavior_hint="")] = None
    premises: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    controller: Annotated[
        str | None, arg(metavar="NAME", help_behavior_hint="(default: grosmc)")
    ] = None
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    sweep: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    record: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    self_test: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    page: Annotated[Path | None, arg(metavar="FILE.md", help_behavior_hint="")] = None
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")

    def execute(self) -> int:
        """Judge, write, print, compare."""
        from grosmc_mj.chapter.claims.ledger import find_claim, select_claims
        from grosmc_mj.chapter.claims_document import claims_document
        from grosmc_mj.experiments.laboratory import Laboratory
        from grosmc_mj.experiments.runs import Settings
        from grosmc_mj.results.document import json_text, origin, write_json

        self._check()
        if self.premises:
            assert self.target is not None
            return audit_premises(
                self.target, self.controller or "grosmc", self.out, full=self.verbose
            )
        chosen = select_claims(self.target) if self.explain is None else [find_claim(self.explain)]
        settings = Settings()
        if self.self_test:
            return self._self_test(settings, chosen)
        lab = Laboratory(settings)
        if self.sweep:
            return self._sweep(lab, chosen)
        findings = judge_with_progress(lab, chosen)
        content = {**origin(0), **claims_document(findings, lab)}
        name = "claims" if self.explain is None else f"claims/{findings[0].claim.id}"
        write_json(self.out / f"{name}.json", content)
        if self.json:
            print(json_text(content), end="")
            return _code(findings)
        console = screen.console()
        _say_verdict(console, findings, full=self.verbose)
        if self.explain is not None:
            _explain(console, findings[0], lab, self.out)
        elif self.page is not None:
            self._write_page(console, findings, lab)
        else:
            console.print(verdicts_table(findings))
            console.print(_unsupported(findings))
            screen.say_files(console, self.out / "claims.json")
            if self.verbose:
                _ledger(console, findings)
        return _code(findings)

    def _check(self) -> None:
        """Refuse options that exclude each other."""
        if self.premises:
            if self.explain or self.json or self.self_test or self.page:
                raise ArgumentError(
                    "--premises checks premises: leave out --explain, --json, --self-test and "
                    "--page"
                )
            if self.target is None:
                raise ArgumentError(f"--premises needs a target: {CASES}")
            return
        if self.controller is not None:
            raise ArgumentError("--controller is for --premises: claims say whose they are")
        if self.explain is not None and self.target is not None:
            raise ArgumentError("--explain names one claim: leave out the system")
        if self.page is not None and (self.target or self.explain):
            raise ArgumentError("--page is about all claims: leave out the system and --explain")
        if self.page is not None and (self.page.suffix != ".md" or self.page.is_dir()):
            raise ArgumentError(f"--page {self.page} must be a file that ends in .md")
        if self.json and (self.explain or self.page or self.self_test):
            raise ArgumentError(
                "--json is for the ledger: leave out --explain, --page and --self-test"
            )
        if self.sweep and (self.json or self.page or self.self_test):
            raise ArgumentError("--sweep varies choices: leave out --json, --page and --self-test")
        if self.record and (not self.sweep or self.target or self.explain):
            raise ArgumentError("--record keeps --sweep of all claims: give that, and no other")
        if self.self_test and (self.explain or self.page):
            raise ArgumentError("--self-test tries claims: leave out --explain and --page")
        if self.target is not None and "/" in self.target:
            raise ArgumentError(
                f"{shown(self.target, str)}: claims are about a SYSTEM; SYSTEM/CASE is for "
                "--premises"
            )

    def _write_page(self, console: Console, findings: Sequence[Finding], lab: Laboratory) -> None:
        """The page on the chapter's defects."""
        from grosmc_mj.chapter.claims_page import write_page

        assert self.page is not None
        for path in write_page(findings, lab, self.page):
            screen.say_files(console, path)

    def _sweep(self, lab: Laboratory, chosen: Sequence[Claim]) -> int:
        """What each claim turns on."""
        from grosmc_mj.chapter.claims.sweep import STORED, sweep, sweep_document
        from grosmc_mj.chapter.claims_tables import sweep_table
        from grosmc_mj.results.document import origin, write_json

        path = STORED if self.record else self.out / "sweeps.json"
        with screen.progress(len(chosen), "claims") as advance:
            found = list(sweep(lab, chosen, advance))
        write_json(path, {**origin(0), "sweeps": sweep_document(found)})
        console = screen.console()
        open_ones = {each.claim for each in found if each.flips and not each.printed}
        words = f"{len(open_ones)} of {len(chosen)} answers turn on a choice that is not printed."
        screen.say_verdict(console, words, good=not open_ones)
        console.print(sweep_table(found))
        screen.say_files(console, path)
        return screen.DONE

    def _self_test(self, settings: Settings, chosen: Sequence[Claim]) -> int:
        """Faults, and who notices."""
        from grosmc_mj.chapter.claims.faults import FAULTS
        from grosmc_mj.chapter.claims.self_test import self_test
        from grosmc_mj.chapter.claims_tables import caught_table
        from grosmc_mj.executors import executor_for
        from grosmc_mj.results.document import origin, write_json

        with screen.progress(len(chosen), "claims") as advance:
            found = self_test(
                settings, chosen, FAULTS, executor_for(len(chosen)), advance, thorough=self.verbose
            )
        noticed_by = {caught.fault.name: list(caught.claims) for caught in found}
        write_json(self.out / "self_test.json", {**origin(0), "noticed_by": noticed_by})
        missed = [caught.fault.name for caught in found if not caught.claims]
        noticed = {name for caught in found for name in caught.claims}
        blind = [claim.id for claim in chosen if claim.id not in noticed]
        console = screen.console()
        if not missed and not blind:
            screen.say_verdict(
                console, "Every fault is noticed, and every claim notices one.", good=True
            )
        for words, names in (("not noticed by any claim", missed), ("notices no fault", blind)):
            if names:
                screen.say_verdict(console, f"{', '.join(names)}: {words}", good=False)
        rows = [
            (each.fault.name, f"{len(each.claims)} of {each.tried}")
            for each in sorted(found, key=lambda each: len(each.claims))
        ]
        columns = ("fault", "claims that notice it, of those asked")
        console.print(screen.brief_table("", columns, rows, most=_MOST))
        if self.verbose:
            console.print(caught_table(found))
        return screen.DIFFERS if missed or blind else screen.DONE


def judge_with_progress(lab: Laboratory, chosen: Sequence[Claim]) -> list[Finding]:
    """Judge claims with a progress bar."""
    with screen.progress(len(chosen), "claims") as advance:
        return judge_in_processes(lab, chosen, advance)


def judge_in_processes(
    lab: Laboratory, chosen: Sequence[Claim], advance: Callable[[str], object]
) -> list[Finding]:
    """Judge claims on all cores."""
    from grosmc_mj.chapter.claims.judging import judge_claims
    from grosmc_mj.executors import executor_for

    # Of one claim the runs are drawn afterwards: they are made here.
    return judge_claims(lab, chosen, executor_for(len(chosen)), advance, screen.notice)


def verdicts_table(findings: Sequence[Finding]) -> Table:
    """How many sentences and statements have which verdict."""
    from grosmc_mj.chapter.claims.claim import Kind, Verdict, verdicts_of

    rows = [
        (kind.plural, *(str(own.count(each)) for each in Verdict), str(len(own)))
        for kind in Kind
        if (own := verdicts_of(findings, kind))
    ]
    columns = ("", *(verdict.value for verdict in Verdict), "all")
    return screen.brief_table("What physics says", columns, rows)


def _unsupported(findings: Sequence[Finding]) -> Table:
    """Why claims are not supported, a line a cause; what most of them fail for first."""
    from grosmc_mj.chapter.claims.ledger import by_cause

    rows = [
        (cause, ", ".join(each.claim.id for each in own), str(len(own)))
        for cause, own in by_cause(findings).items()
    ]
    columns = ("not supported since", "statements", "")
    return screen.brief_table("", columns, rows, words=2, most=_MOST)


def _ledger(console: Console, findings: Sequence[Finding]) -> None:
    """Every sentence and claim, and which premises failed."""
    from grosmc_mj.chapter.claims.claim import RULE
    from grosmc_mj.chapter.claims_tables import LEGEND, ledger_tables, sentences_table

    console.print(sentences_table(findings))
    console.print(RULE, style="dim")
    for table in ledger_tables(findings):
        console.print(table)
    console.print(LEGEND, style="dim")
    for finding in findings:
        if finding.because:
            console.print(f"{finding.claim.id}: a premise failed: {finding.because}", markup=False)


def _say_verdict(console: Console, findings: Sequence[Finding], *, full: bool) -> None:
    """Whether the verdicts are the expected ones, and which are not."""
    from grosmc_mj.chapter.claims.ledger import verdict_differences

    differing = verdict_differences(findings)
    words = "All verdicts are as expected."
    if differing:
        words = f"{len(differing)} verdicts differ from the expected ones."
    screen.say_verdict(console, words, good=not differing)
    screen.say_lines(console, [f"differs: {line}" for line in differing], all=full)


def _code(findings: Sequence[Finding]) -> int:
    """The exit code."""
    from grosmc_mj.chapter.claims.ledger import verdict_differences

    return screen.DIFFERS if verdict_differences(findings) else screen.DONE


def _explain(console: Console, finding: Finding, lab: Laboratory, out: Path) -> None:
    """The story of one claim, and its figure."""
    from grosmc_mj.chapter.claims_figures import write_picture
    from grosmc_mj.chapter.claims_tables import story

    for line in story(finding, lab):
        console.print(line, soft_wrap=True)
    path = write_picture(finding, lab, out / "claims" / f"{finding.claim.id}.png")
    console.print(f"  {'figure':<12}{path}", soft_wrap=True)
