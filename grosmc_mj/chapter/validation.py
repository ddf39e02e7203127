"""validation.json: all that was measured, and the table of results in the documentation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import groupby
from typing import Any

from grosmc_mj.chapter import expected_results
from grosmc_mj.chapter.claims.claim import Finding, Kind, Verdict, verdicts_of
from grosmc_mj.chapter.claims.judging import verdict_differences
from grosmc_mj.chapter.claims.results import (
    claim_numbers,
    claims_sheets,
    claims_values,
    counts_words,
)
from grosmc_mj.experiments.case import Case, case_document
from grosmc_mj.experiments.document import run_document, standings
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.metrics import Metric, tolerance_of
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.experiments.tables import metric_cell
from grosmc_mj.results.document import plain
from grosmc_mj.results.result import KEPT, NOT_KEPT, OPEN, Answer, Sheet, Standing, Value, result
from grosmc_mj.results.tables import Table, number, numbers, table, words
from grosmc_mj.sweep.agreement import Agreement, agreement_table, disagreements

_COLUMNS = {
    "max |x1 − x1*|": "deviation",
    "settled": "settling_time",
    "max |s|": "max_sliding",
    "J(u_c) / J*": "continuous",
    "J(u_d) / J* per s": "rest",
    "max |u|": "max_input",
    "cart travel": "cart_travel",
}
_TITLE = "Runs in MuJoCo"


@dataclass
class Validation:
    """All that is computed of the selected cases, as far as it is.

    Attributes:
        selected: The cases.
        seed: Of the random states of the agreements.
        results: Runs.
        agreements: Analytic plants against physics.
        findings: Claims.
        complete: Whether everything is there.
        differing: Results that are not as recorded, a line each.
    """

    selected: Sequence[Case]
    seed: int = 0
    results: list[RunResult] = field(default_factory=list)
    agreements: list[Agreement] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    complete: bool = False
    differing: list[str] = field(default_factory=list)

    def compare(self) -> None:
        """Compare with the record; everything is there."""
        self.differing = expected_results.differences(self.results)
        self.complete = True

    @property
    def differences(self) -> list[str]:
        """All that is not as the repository has it, a line each.

        Results, equations that differ from MuJoCo, and verdicts that are not the expected ones.
        """
        if not self.complete:
            return []
        judged = [*disagreements(self.agreements), *verdict_differences(self.findings)]
        return [*self.differing, *judged]

    def document(self, lab: Laboratory) -> dict[str, Any]:
        """The content of validation.json."""
        verdict = OPEN if not self.complete else NOT_KEPT if self.differences else KEPT
        tables = [
            systems_table(self), deviations_table(self.results), results_table(self.results)
        ]  # fmt: skip
        if self.agreements:
            tables.append(agreement_table(self.agreements))
        answer = Answer(
            question=f"Validation: {len(self.results)} runs, {len(self.findings)} claims",
            verdict=verdict,
            words=self.words,
            more=counts_words(self.findings),
        )
        return result(
            "validation",
            {**asdict(lab.settings), "cases": [case_document(case) for case in self.selected]},
            seed=self.seed,
            complete=self.complete,
            answers=[answer],
            standings=self._standings(),
            sheets=[*(Sheet(table=one) for one in tables), *claims_sheets(self.findings)],
            values=[*self._values(), *claims_values(self.findings)],
            as_recorded=not self.differences if self.complete else None,
            differences=self.differences,
            runs=[run_document(run) for run in self.results],
            agreement=[agreement._asdict() for agreement in self.agreements],
            claims=[claim_numbers(finding, lab) for finding in self.findings],
        )

    @property
    def words(self) -> str:
        """Whether the results are as recorded."""
        if not self.complete:
            return f"Not complete: {len(self.results)} runs are done."
        if self.differences:
            return f"{len(self.differences)} results differ from the recorded ones."
        words = f"All {len(self.results)} runs are as recorded."
        if self.findings:
            words += f" All {len(self.findings)} verdicts of the claims are as expected."
        return words

    def _standings(self) -> Iterator[Standing]:
        """How each law stands in each case: by what is required of it, else by its run on record.

        On record is the run in MuJoCo; its number is how far the law strays from its optimum.
        """
        recorded = expected_results.load_expected()["runs"]
        other = {line.partition(": ")[0] for line in self.differing}
        for target, group in groupby(self.results, lambda run: run.key.rsplit("/", 2)[0]):
            runs = list(group)
            judged = [item for run in runs for item in run.requirements]
            yield from standings(target, runs, judged, complete=self.complete)
            required = {item.controller for item in judged}
            for run in runs:
                if run.plant != "physics" or run.controller.name in required:
                    continue
                before = recorded.get(run.key, {"metrics": {}})["metrics"].get("deviation")
                now = _cell(run.metrics["deviation"])
                yield Standing(
                    case=target,
                    law=run.controller.name,
                    breaks_at="record" if run.key in other else "",
                    words=f"deviation: {now}, recorded {number(before)}",
                    complete=self.complete,
                    required=False,
                )

    def _values(self) -> Iterator[Value]:
        """How each run ended, and its metrics."""
        if self.complete:
            words = "not as recorded" if self.differences else "as recorded"
            yield Value(name="all runs", value=words)
        for run in self.results:
            name = f"{run.case.system}/{run.case.name} {run.plant} {run.controller.name}"
            yield Value(name=f"{name}: status", value=run.status.name.lower())
            switched = run.trajectory.sliding is not None
            for key, metric in run.metrics.items():
                relative, absolute = tolerance_of(key, switched=switched)
                yield Value(
                    name=f"{name}: {key}", value=plain(metric.value), unit=metric.unit,
                    relative=relative, absolute=absolute,
                )  # fmt: skip


def systems_table(done: Validation) -> Table:
    """Of each system: runs, those that ended early, accelerations against MuJoCo's, verdicts."""
    rows = []
    for system in dict.fromkeys(case.system for case in done.selected):
        runs = [run for run in done.results if run.case.system == system]
        ended = sum(bool(run.ended) for run in runs)
        corrected = [row for row in done.agreements if row.variant == "corrected"]
        errors = [row.acceleration for row in corrected if row.system == system]
        own = [finding for finding in done.findings if finding.claim.system == system]
        kinds = [kind for kind in Kind if kind is not Kind.QUESTION]
        counts = Counter(verdict for kind in kinds for verdict in verdicts_of(own, kind))
        cells = [str(counts[verdict]) if counts else "-" for verdict in Verdict]
        count = f"{len(runs)}" + (f" ({ended} early)" if ended else "")
        rows.append((system, count, number(max(errors, default=None)), *cells))
    headers = ("runs", "to MuJoCo", *(verdict.value for verdict in Verdict))
    legend = "Verdicts of the chapter's sentences, equations and proofs: grosmc-mj claims has all."
    return table("Systems", [*words("system"), *numbers(*headers)], rows, legend=legend)


def deviations_table(results: Sequence[RunResult]) -> Table:
    """How far each law strays from its nominal optimum in MuJoCo."""
    cells: dict[Case, dict[str, str]] = {}
    for run in results:
        if run.plant == "physics":
            cell = metric_cell(run.metrics.get("deviation")) + (" (!)" if run.ended else "")
            cells.setdefault(run.case, {})[run.controller.name] = cell
    laws = list(dict.fromkeys(law for own in cells.values() for law in own))
    rows = [
        (f"{case.system}/{case.name}", *(own.get(law, "") for law in laws))
        for case, own in cells.items()
    ]
    title = "In MuJoCo, max|x1-x1*|: how far each law strays from its nominal optimum"
    return table(title, [*words("case"), *numbers(*laws)], rows)


def results_table(results: Sequence[RunResult]) -> Table:
    """The runs on physics."""
    rows = []
    for run in (run for run in results if run.plant == "physics"):
        shares = dict(zip(("continuous", "rest"), run.cost_shares, strict=True))
        metrics = {**run.metrics, **shares}
        cells = (_cell(metrics.get(name)) for name in _COLUMNS.values())
        rows.append((run.case.system, run.case.name, run.controller.name, *cells))
    return table(_TITLE, [*words("system", "case", "law"), *numbers(*_COLUMNS)], rows)


def results_markdown(document: Mapping[str, Any]) -> str:
    """The table of the runs on physics in a validation.json, in Markdown."""
    tables = (Table.model_validate(sheet["table"]) for sheet in document["sheets"])
    return "\n".join(next(one for one in tables if one.title == _TITLE).markdown())


def _cell(metric: Metric | None) -> str:
    """A value with its unit."""
    if metric is None or metric.value is None:
        return "not reached" if metric is not None and metric.note == "not reached" else ""
    return number(metric.value) + ("" if metric.unit in ("1", "1/s") else f" {metric.unit}")
