"""validation.json: all measurements, and the table of results in the documentation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import groupby
from typing import Any

from grosmc_mj.chapter import expected_results
from grosmc_mj.chapter.agreement import Agreement, agreement_table, disagreements
from grosmc_mj.chapter.claims.claim import ClaimFinding
from grosmc_mj.chapter.claims.judging import verdict_differences
from grosmc_mj.chapter.claims.results import claim_numbers, claims_values, counts_words
from grosmc_mj.chapter.claims.story import claims_tables
from grosmc_mj.experiments.answer.document import (
    run_document,
    run_standings,
    run_values,
    verdicts_of,
)
from grosmc_mj.experiments.answer.tables import metric_cell
from grosmc_mj.experiments.case_document import case_document
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.requirements.metrics import Metric, largest_of
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.wording import counted, plural, unit_after
from grosmc_mj.output.results.result import (
    KEPT,
    NOT_KEPT,
    OPEN,
    Answer,
    ReportTable,
    Result,
    Standing,
    Value,
    report_tables,
    result,
)
from grosmc_mj.output.results.tables import Table, number, numbers, table, words

# Columns of the table of results, and the metric in each.
_COLUMNS = {
    "max |y − y*|": "deviation",
    "settled": "settling_time",
    "max |s|": "max_sliding",
    "J(u_c) / J*": "continuous",
    "J(u_d) / J* per s": "switching",
    "max |u|": "max_input",
    "max |internal position|": "internal",
}
_TITLE = "Runs in MuJoCo"


@dataclass
class Validation:
    """Results of the selected cases, as far as they are computed.

    Attributes:
        selected: The cases.
        seed: Seed of the random states at which accelerations are compared.
        results: Runs.
        agreements: Analytic plants against physics.
        findings: Judged claims.
        complete: Whether everything is computed.
        differing: Results that are not as recorded, a line each.
    """

    selected: Sequence[Experiment]
    seed: int = 0
    results: list[RunResult] = field(default_factory=list)
    agreements: list[Agreement] = field(default_factory=list)
    findings: list[ClaimFinding] = field(default_factory=list)
    complete: bool = False
    differing: list[str] = field(default_factory=list)

    def compare(self) -> None:
        """Compare with the record, once everything is computed."""
        self.differing = expected_results.unexpected_results(self.results)
        self.complete = True

    @property
    def differences(self) -> list[str]:
        """Differences from what the repository has, a line each.

        Results, equations that differ from MuJoCo, and verdicts that are not the expected ones.
        """
        if not self.complete:
            return []
        return [
            *self.differing,
            *disagreements(self.agreements),
            *verdict_differences(self.findings),
        ]

    @property
    def words(self) -> str:
        """One sentence: whether the results are as recorded."""
        done = counted(len(self.results), "run")
        if not self.complete:
            return f"{done} {plural(len(self.results), 'is', 'are')} done, and not compared yet."
        if self.differences:
            count = len(self.differences)
            differ = plural(count, "differs", "differ")
            return f"{counted(count, 'result')} {differ} from the recorded ones."

        sentence = f"All {done} are as recorded."
        if self.findings:
            sentence += (
                f" All {counted(len(self.findings), 'verdict')} of the claims are as expected."
            )
        return sentence

    def result(self) -> Result:
        """Return the result of the validation."""
        differences = self.differences
        configuration = asdict(Settings())
        configuration["cases"] = [case_document(case) for case in self.selected]
        return result(
            "validation",
            configuration,
            seed=self.seed,
            complete=self.complete,
            answers=[self._answer()],
            standings=self._standings(),
            sheets=self._sheets(),
            values=self._values(),
            as_recorded=not differences if self.complete else None,
            differences=differences,
            runs=[run_document(run) for run in self.results],
            agreement=[agreement._asdict() for agreement in self.agreements],
            claims=[claim_numbers(finding) for finding in self.findings],
        )

    def _answer(self) -> Answer:
        verdict = KEPT
        if not self.complete:
            verdict = OPEN
        elif self.differences:
            verdict = NOT_KEPT
        runs = counted(len(self.results), "run")
        return Answer(
            question=f"Validation: {runs}, {counted(len(self.findings), 'claim')}",
            verdict=verdict,
            words=self.words,
            more=counts_words(self.findings),
            standard="recorded",
            faults=[f"differs: {line}" for line in self.differences],
        )

    def _sheets(self) -> list[ReportTable]:
        """The two tables that answer on the terminal come first."""
        claims = claims_tables(self.findings)
        tables = [
            deviations_table(self.results),
            claims[0],
            cases_table(self.results),
            agreement_table(self.agreements),
            *claims[1:],
        ]
        return report_tables(tables, 2)

    def _standings(self) -> Iterator[Standing]:
        """Verdict on each law in each case: by its requirements, else by its run on record."""
        recorded = expected_results.load_expected()["runs"]
        differing = {line.partition(": ")[0] for line in self.differing}
        for target, group in groupby(self.results, lambda run: run.case.target):
            runs = list(group)
            judgements = [judgement for run in runs for judgement in run.requirements]
            rows = verdicts_of(runs[0].case.name, runs, judgements)
            yield from run_standings(target, rows, complete=self.complete)

            required = {judgement.controller for judgement in judgements}
            for run in runs:
                if run.plant == "physics" and run.controller.name not in required:
                    yield self._by_record(target, run, recorded, differing)

    def _by_record(
        self,
        target: str,
        run: RunResult,
        recorded: Mapping[str, Any],
        differing: set[str],
    ) -> Standing:
        """Verdict on a law by its run in MuJoCo: its deviation beside the recorded one."""
        before = None
        if run.key in recorded:
            before = recorded[run.key]["metrics"].get("deviation")
        now = _cell(run.metrics["deviation"])
        return Standing(
            case=target,
            law=run.controller.name,
            breaks_at="record" if run.key in differing else "",
            words=f"deviation: {now}, recorded {number(before)}",
            complete=self.complete,
            required=False,
        )

    def _values(self) -> Iterator[Value]:
        """Whether all is as recorded, status and metrics of each run, and the claims."""
        if self.complete:
            words = "not as recorded" if self.differences else "as recorded"
            yield Value(name="all runs", value=words)
        yield from run_values(self.results)
        yield from claims_values(self.findings)


def deviations_table(results: Sequence[RunResult]) -> Table:
    """Return the table of each law's deviation from its nominal optimum in MuJoCo."""
    cells: dict[str, dict[str, str]] = {}
    for run in results:
        if run.plant == "physics":
            cell = metric_cell(run.metrics.get("deviation"))
            if run.ended:
                cell += " (!)"
            cells.setdefault(run.case.target, {})[run.controller.name] = cell

    # In the order in which they first occur.
    laws = {}
    for cells_of_case in cells.values():
        laws |= dict.fromkeys(cells_of_case)

    rows = []
    for target, cells_of_case in cells.items():
        row = [cells_of_case.get(law, "") for law in laws]
        rows.append([target, *row])

    title = "In MuJoCo, max|y-y*|: how far each law strays from its nominal optimum"
    return table(title, [*words("case"), *numbers(*laws)], rows)


def cases_table(results: Sequence[RunResult]) -> Table:
    """Return the table of the runs in MuJoCo."""
    rows = []
    for run in results:
        if run.plant != "physics":
            continue
        continuous, switching = run.cost_shares
        metrics = {**run.metrics, "continuous": continuous, "switching": switching}
        for position in run.trajectory.system.internal_positions:
            metrics["internal"] = metrics[largest_of(position.name)]
        cells = [_cell(metrics.get(name)) for name in _COLUMNS.values()]
        rows.append([run.case.system, run.case.name, run.controller.name, *cells])

    columns = [*words("system", "case", "law"), *numbers(*_COLUMNS)]
    return table(_TITLE, columns, rows)


def results_markdown(document: Mapping[str, Any]) -> str:
    """Return the table of the runs in MuJoCo of a validation.json, in Markdown."""
    for sheet in document["sheets"]:
        rows = Table.model_validate(sheet["table"])
        if rows.title == _TITLE:
            return "\n".join(rows.markdown())
    raise LookupError(f"there is no table {_TITLE!r}")


def _cell(metric: Metric | None) -> str:
    """A value with its unit."""
    if metric is None:
        return ""
    if metric.value is None:
        return "not reached" if metric.note == "not reached" else ""

    cell = number(metric.value)
    if metric.unit == "1/s":
        return cell
    return f"{cell}{unit_after(metric.unit)}"
