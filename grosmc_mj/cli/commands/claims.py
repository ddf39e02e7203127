"""grosmc-mj claims: judge them, vary their choices, check premises."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.answering import AnsweringCommand, Question
from grosmc_mj.cli.command import OUTPUT, Flag, Out, command
from grosmc_mj.cli.targets import CASES
from grosmc_mj.ground.errors import ArgumentError

if TYPE_CHECKING:
    from grosmc_mj.chapter.claims.claim import Claim, ClaimFinding
    from grosmc_mj.experiments.assumptions.audit import Audit
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.run_cache import RunCache
    from grosmc_mj.output.results.result import Result

_Claims = Annotated[str | None, Parameter(show_default="all claims")]


@command
class JudgeCommand(AnsweringCommand):
    """Judge the chapter's claims, each with its number: supported, refuted, undetermined, ...

    Every claim is measured on each plant that it can be asked of, at the control period and at half
    of it; a verdict that changes in between is inconclusive. What turns on something that the
    chapter does not print is undetermined; a claim that fails because a premise failed says so.
    The chapter's claims are counted by the sentence that they rest on: it is refuted if any of them
    is, and supported only if all are. Of one claim the whole story is told, and drawn.
    Writes claims.json or, of one claim, claims/CLAIM.json and claims/CLAIM.png. Exit code 1 if a
    verdict is not the one that the repository expects.

    Attributes:
        target: servo, cart_pendulum, arm or two_link_arm; one claim; or "Fig. 3" or "eq. (37)".
        page: Write the page on all claims too, with its figures beside it.
        out: Folder for JSON and figures.
    """

    target: _Claims = None
    _: KW_ONLY
    page: Annotated[
        Path | None,
        Parameter(metavar="FILE.md", group=OUTPUT, show_default="none"),
    ] = None
    out: Out = Path("renders")

    @property
    def case_target(self) -> None:
        """None: a claim is no case."""
        return None

    def questions(self) -> Sequence[Question]:
        """Return the one question of the claims."""
        from grosmc_mj.chapter.claims.ledger import select_claims

        self._refuse_page()
        return [_JudgeQuestion(self, select_claims(self.target))]

    def _refuse_page(self) -> None:
        """Refuse a page that is no Markdown, or is about some claims only."""
        if self.page is None:
            return
        if self.page.suffix != ".md":
            raise ArgumentError(f"--page {self.page} must end in .md")
        if self.target:
            raise ArgumentError(f"--page {self.page} is about all claims: leave out {self.target}")


class _JudgeQuestion(Question):
    """Are the claims supported or refuted, and as the repository expects?"""

    def __init__(self, command: JudgeCommand, claims: Sequence[Claim]) -> None:
        self.path = command.out / "claims.json"
        self._one = claims[0].id == command.target
        if self._one:
            self.path = command.out / f"claims/{command.target}.json"
        self._of = command.target or "the chapter"
        self._page = command.page
        self._claims = claims
        self._lab = _run_cache()
        self._findings: list[ClaimFinding] = []

    def measure(self) -> None:
        """Judge the claims with a progress bar."""
        with screen.progress(len(self._claims), "claims") as advance:
            # One by one: an interrupt leaves the first ones.
            self._findings.extend(judge_in_processes(self._lab, self._claims, advance))

    def result(self, *, complete: bool) -> Result | None:
        """Return the judged claims."""
        from grosmc_mj.chapter.claims.results import claims_result

        if not self._findings:
            return None
        # They come in the order in which processes finish them.
        order = [claim.id for claim in self._claims]
        self._findings.sort(key=lambda finding: order.index(finding.claim.id))
        differences = [f"differs: {line}" for line in self._differences]
        return claims_result(self._findings, self._lab.settings, differences, self._of)

    @property
    def missing(self) -> Sequence[str]:
        """Claims that are not judged."""
        judged = [finding.claim.id for finding in self._findings]
        return [claim.id for claim in self._claims if claim.id not in judged]

    def draw(self) -> Sequence[Path]:
        """Draw the story of a single claim."""
        from grosmc_mj.chapter.claims.picture import write_picture

        if not self._one:
            return ()
        return (write_picture(self._findings[0], self._lab, self.path.with_suffix(".png")),)

    def close(self) -> None:
        """Write the page on all claims, if it is asked for."""
        from grosmc_mj.chapter.claims.page import write_page

        if self._page is not None:
            files = write_page(self._findings, self._lab, self._page)
            screen.say_files(screen.console(), *files)

    @property
    def kept(self) -> bool:
        """Whether all verdicts are as expected."""
        return not self._differences

    @property
    def _differences(self) -> list[str]:
        from grosmc_mj.chapter.claims.judging import verdict_differences

        return verdict_differences(self._findings)


@command
class SweepCommand(AnsweringCommand):
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

    @property
    def case_target(self) -> None:
        """None: a claim is no case."""
        return None

    def questions(self) -> Sequence[Question]:
        """Return the one question of the sweeps."""
        from grosmc_mj.chapter.claims.ledger import select_claims
        from grosmc_mj.chapter.claims.sweep import STORED

        if self.record and self.target:
            raise ArgumentError(f"--record keeps the sweeps of all claims: leave out {self.target}")
        path = STORED if self.record else self.out / "sweeps.json"
        return [_SweepQuestion(path, select_claims(self.target), record=self.record)]


class _SweepQuestion(Question):
    """Where the answers of claims turn as their choices vary."""

    def __init__(self, path: Path, claims: Sequence[Claim], *, record: bool) -> None:
        self.path = path
        self._claims = claims
        self._record = record
        self._lab = _run_cache()
        self._sweeps: list[dict[str, Any]] = []

    def measure(self) -> None:
        """Vary the choices."""
        from grosmc_mj.chapter.claims.sweep import sweep

        with screen.progress(len(self._claims), "claims") as advance:
            # One by one: an interrupt leaves the first ones.
            self._sweeps.extend(sweep(self._lab, self._claims, advance))

    def result(self, *, complete: bool) -> Result | None:
        """Return the finished sweeps; a part of them is no record."""
        from grosmc_mj.chapter.claims.results import sweeps_result

        if not complete and (self._record or not self._sweeps):
            return None
        return sweeps_result(self._sweeps, self._lab.settings)

    @property
    def missing(self) -> Sequence[str]:
        """Claims from that of the last choice on: it may have more choices."""
        varied = [claim.id for claim in self._claims if claim.choices]
        return varied[varied.index(self._sweeps[-1]["claim"]) :]


@command
class PremisesCommand(AnsweringCommand):
    """Check the premises of the theorems in each case.

    Controllability, G B, relative degree, matching, the input-gain ratio, the switching gain
    required against the one configured (with the input gain's uncertainty counted), s(0), singular
    states. Over the declared operating region and along the run: the least margin, where it is, how
    often it is violated, and the smallest gain that restores it. Writes premises_SYSTEM.json or, of
    one case, premises_SYSTEM_CASE.json.

    Attributes:
        target: A system, or one of its cases.
        laws: The law whose premises are checked.
        out: Folder for the JSON.
    """

    target: Annotated[str, Parameter(metavar=CASES)]
    _: KW_ONLY
    laws: Annotated[str, Parameter(metavar="NAME")] = "grosmc"
    out: Out = Path("renders")

    def questions(self) -> Sequence[Question]:
        """Return the one question of the premises."""
        from grosmc_mj.experiments.catalogue import find_experiments

        experiments = find_experiments(self.target)
        # The theorems know of no loop: of a system its benches are left out.
        without_loop = [item for item in experiments if item.loop is None]
        return [_PremisesQuestion(self, without_loop or experiments)]


class _PremisesQuestion(Question):
    """Do the premises of the theorems hold in each case?"""

    def __init__(self, command: PremisesCommand, experiments: Sequence[Experiment]) -> None:
        of = experiments[0].system
        if command.target != of:
            of = f"{of}_{experiments[0].name}"
        self.path = command.out / f"premises_{of}.json"
        self._law = command.laws
        self._experiments = experiments
        self._lab = _run_cache()
        self._audits: list[Audit] = []

    def measure(self) -> None:
        """Check the premises of each case."""
        from grosmc_mj.experiments.assumptions.robot import audit_of

        for experiment in self._experiments:
            self._audits.append(audit_of(self._lab, experiment, self._law))

    def result(self, *, complete: bool) -> Result | None:
        """Return the finished audits."""
        from grosmc_mj.chapter.premises import premises_result

        if not self._audits:
            return None
        return premises_result(self._audits, self._lab.settings)

    @property
    def missing(self) -> Sequence[str]:
        """Cases that are not checked."""
        return [case.target for case in self._experiments[len(self._audits) :]]


def _run_cache() -> RunCache:
    """Return an empty cache of runs with the default settings."""
    from grosmc_mj.experiments.run_cache import RunCache
    from grosmc_mj.experiments.settings import Settings

    return RunCache(Settings())


def judge_in_processes(
    lab: RunCache,
    claims: Sequence[Claim],
    advance: Callable[[str], object],
) -> Iterator[ClaimFinding]:
    """Judge claims on all cores, in the order in which processes finish them."""
    from grosmc_mj.chapter.claims.judging import judge_claims
    from grosmc_mj.ground.executors import executor_for

    # The runs of one claim are drawn afterwards: its executor makes them in this process.
    return judge_claims(lab, claims, executor_for(len(claims)), advance, screen.notice)
