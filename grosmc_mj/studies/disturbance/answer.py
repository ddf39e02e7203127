"""Answer of a search for the worst disturbance: words, table, charts, document, case files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import Content, read_content
from grosmc_mj.experiments.file.paths import place_of
from grosmc_mj.experiments.file.schema import UncertainTable
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.experiments.file.text import text_of
from grosmc_mj.experiments.file.user_code import is_named, named_in
from grosmc_mj.experiments.films import film_of
from grosmc_mj.experiments.number import written
from grosmc_mj.experiments.requirements.signals import DEVIATION, named_units, signals_of
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError, name_list
from grosmc_mj.ground.wording import counted, counted_of, titled, unit_after
from grosmc_mj.output.films.film import Film, Format
from grosmc_mj.output.results.result import (
    KEPT,
    NOT_KEPT,
    OPEN,
    Answer,
    LineChart,
    ReportTable,
    Result,
    Series,
    result,
)
from grosmc_mj.output.results.tables import Table, names, numbers, table, words
from grosmc_mj.output.results.verdicts import first_failed, standings, values_of
from grosmc_mj.simulation.disturbances import AnyDisturbance
from grosmc_mj.studies.disturbance.bounded import BoundedDisturbance
from grosmc_mj.studies.disturbance.disturbance import AGREES, DisturbanceStudy, watched
from grosmc_mj.studies.disturbance.row import ENDED, WorstDisturbance
from grosmc_mj.studies.sweep.runs import Row, recorded_runs

# Points of a curve.
_POINTS = 400
# Name of the signal that was found, in figures and films.
_WORST = "worst found"


# -- words and table -------------------------------------------------------------------------------


def words_of(study: DisturbanceStudy, worst: WorstDisturbance) -> str:
    """Return the answer for a law in a line."""
    calm = _calm_words(worst)
    if worst.calm_share > ENDED:
        return f"{worst.law}: {calm}"
    if worst.ends:
        return f"{worst.law}: {calm}the run ends early; {counted(worst.runs, 'run')}"
    beside = _beside(study, worst)
    switches = counted(worst.switches, "switch", "switches")
    line = (
        f"{worst.law}: {calm}{worst.share:.3g} of {worst.words}, {beside}; {switches}; "
        f"{counted(worst.runs, 'run')}, and random telegraph signals in as many reach "
        f"{worst.telegraph_share:.3g}"
    )
    if worst.change > AGREES:
        line += f"; {counted(worst.pieces, 'piece')} may be too few"
    if worst.largest_kept is not None:
        line += f"; all is kept {_largest_words(worst, study.disturbance.unit)}"
    return line


def _beside(study: DisturbanceStudy, worst: WorstDisturbance) -> str:
    """The share under the disturbance that it is compared with, and of a formula the margin."""
    compared = study.disturbance.compared
    formulas = [
        limit
        for limit in study.limits(worst.law)
        if limit.name == worst.tightest and limit.quantity == "formula"
    ]
    if formulas:
        # The share of a formula is about 1 whatever happens, so that a ratio tells nothing.
        margin = (1 - worst.share) * formulas[0].number
        kept = "kept" if worst.kept else "missed"
        unit = unit_after(formulas[0].unit)
        return f"{kept} by {abs(margin):.3g}{unit}; {compared} {worst.compared_share:.3g}"
    if worst.compared_share <= 0:
        return f"{compared} 0"
    ratio = f"{worst.share / worst.compared_share:.2g}"
    return f"as much as {compared}" if ratio == "1" else f"{ratio} times {compared}"


def _calm_words(worst: WorstDisturbance) -> str:
    """Beginning of a law's line if it fails without any disturbance; else empty."""
    if worst.calm_share > ENDED:
        return "the run ends early without any disturbance"
    if not worst.kept_when_calm:
        return f"not kept without any disturbance, {worst.calm_share:.3g} of the limit; "
    return ""


def _largest_words(worst: WorstDisturbance, unit: str) -> str:
    """The range of the largest bound: both of its ends."""
    kept = worst.largest_kept
    failed = worst.smallest_failed
    if failed is None:
        return f"up to {kept:.3g}{unit_after(unit)} at least, where the search ends"
    if kept == 0:
        return f"at no bound that was tried, down to {failed:.3g}{unit_after(unit)}"
    return f"up to {kept:.3g} and not at {failed:.3g}{unit_after(unit)}"


def verdict(study: DisturbanceStudy, rows: Sequence[WorstDisturbance]) -> str:
    """Return which laws keep everything under the worst disturbance that was found."""
    disturbance = study.disturbance
    keeping = [worst.law for worst in rows if worst.kept]
    kept = counted_of(len(keeping), len(rows), "law", "keeps", "keep")
    sentence = (
        f"{study.experiment.target}, {disturbance.bound:g}{unit_after(disturbance.unit)} on "
        f"{disturbance.place}: {kept} all under the worst "
        f"disturbance found{': ' if keeping else ''}{name_list(keeping)}."
    )
    failing = [worst.law for worst in rows if not worst.kept_when_calm]
    if failing:
        sentence = f"Without any disturbance {name_list(failing)}: not kept. {sentence}"
    return sentence


def answer_table(study: DisturbanceStudy, rows: Sequence[WorstDisturbance]) -> Table:
    """Return a row for each law, the one that breaks most first."""
    disturbance = study.disturbance
    columns = [
        *names("law"),
        *numbers("share of\nits limit", "compared\nwith", "switches", "pieces", "runs"),
        *numbers("as many\ntelegraphs"),
        *words("worse\nis"),
        *numbers("in\nMuJoCo", "largest\nbound"),
    ]
    texts = []
    for worst in sorted(rows, key=lambda worst: -worst.share):
        row = [
            worst.law,
            _share_text(worst.share),
            _share_text(worst.compared_share),
            str(worst.switches),
            str(worst.pieces),
            str(worst.runs),
            _share_text(worst.telegraph_share),
            "telegraph" if worst.telegraph_won else "search",
            _share_text(worst.confirmed),
            _largest_text(worst),
        ]
        texts.append(row)
    title = f"Worst disturbance within {disturbance.bound:g}{unit_after(disturbance.unit)}"
    legend = f"Shares: measured over allowed value. Compared with {disturbance.compared}."
    return table(title, columns, texts, legend=legend)


def _largest_text(worst: WorstDisturbance) -> str:
    """Write the range of the largest bound."""
    if worst.largest_kept is None:
        return "-"
    if worst.smallest_failed is None:
        return f"≥{worst.largest_kept:.3g}"
    return f"{worst.largest_kept:.3g} to {worst.smallest_failed:.3g}"


def _share_text(share: float | None) -> str:
    """Write a share of a limit."""
    if share is None:
        return "-"
    return "run ends" if share > ENDED else f"{share:.3g}"


# -- charts and film -------------------------------------------------------------------------------


def charts(study: DisturbanceStudy, worst: WorstDisturbance) -> list[LineChart]:
    """Return the worst disturbance of a law over time, and the quantity nearest to its limit.

    Each is shown beside that of the disturbance that it is compared with.
    """
    disturbance = study.disturbance
    cases = _cases(study, worst)
    rows = [Row(worst.law, case=case) for case in cases.values()]
    (limit, *_) = [item for item in study.limits(worst.law) if item.name == worst.tightest]

    signals: list[Series] = []
    courses: list[Series] = []
    quantity = ""
    runs = recorded_runs(study.experiment, rows, study.plant)
    for (name, case), (run, law) in zip(cases.items(), runs, strict=True):
        signal = DEVIATION
        if limit.figure != DEVIATION:
            (signal, *_) = watched([limit], law.designed.error)
        unit = named_units(law, law.designed.sliding_unit or "1")[signal]
        quantity = titled(signal, unit)

        some = np.unique(np.linspace(0, len(run.time) - 1, _POINTS).astype(int))
        time = run.time[some].tolist()
        profile = disturbance.applied_in(case).profile
        values = [disturbance.bound * profile(t) for t in time[:-1]]
        course = signals_of(run, law, [signal])[signal][some]
        signals.append(Series(name=name, x=time[:-1], y=values))
        courses.append(Series(name=name, x=time, y=course.tolist()))

    seconds = "time [s]"
    place = titled(disturbance.place, disturbance.unit)
    level = limit.number if limit.is_level else None
    return [
        LineChart(name=f"{worst.law}: disturbance", titles=(seconds, place), lines=signals),
        LineChart(
            name=f"{worst.law}: {worst.words}",
            titles=(seconds, quantity),
            lines=courses,
            limit=level,
        ),
    ]


def _cases(study: DisturbanceStudy, worst: WorstDisturbance) -> dict[str, Experiment]:
    """Return the cases of the compared disturbance and of the worst one, by name."""
    disturbance = study.disturbance
    return {
        disturbance.compared: disturbance.compared_case,
        _WORST: disturbance.case_of(np.array(worst.signal)),
    }


def require_filmable(study: DisturbanceStudy, law: str) -> None:
    """Refuse a film of a law that is not studied, or of a case without MuJoCo.

    Raises:
        ArgumentError: With the reason.
    """
    require_known("law", law, study.experiment.controllers)
    if study.experiment.nominal.truest != "physics":
        raise ArgumentError(
            f"--film {law}: a film is of runs in MuJoCo, and {study.experiment.target} has none"
        )


def disturbance_film(
    study: DisturbanceStudy, worst: WorstDisturbance, form: Format | None = None
) -> Film:
    """Return a film of a law under the worst disturbance, beside the one it is compared with."""
    cases = _cases(study, worst)
    runs = [case.run("physics", worst.law) for case in cases.values()]
    film = film_of(runs, form, list(cases))
    return replace(film, title=f"{study.experiment.target}: {_title(study)} for {worst.law}")


# -- document --------------------------------------------------------------------------------------


def disturbance_result(
    study: DisturbanceStudy, rows: Sequence[WorstDisturbance], *, complete: bool
) -> Result:
    """Return the result of a search; ``complete`` if it has every law."""
    target = study.experiment.target
    lines = {worst.law: words_of(study, worst) for worst in rows}
    panels = [chart for worst in rows for chart in charts(study, worst)]
    answer = Answer(
        question=f"Worst disturbance of {target}",
        verdict=_verdict(rows, complete=complete),
        words=verdict(study, rows),
        notes=[*lines.values(), *study.not_asked, *study.about_recovery],
    )
    return result(
        "disturbance",
        study.configuration(),
        seed=0,
        complete=complete,
        answers=[answer],
        standings=standings(
            target, rows, first_failed, lambda of_law: lines[of_law[0].law], complete=complete
        ),
        sheets=[ReportTable(table=answer_table(study, rows), charts=panels, brief=True)],
        values=values_of(target, rows),
        verdicts=[worst.model_dump() for worst in rows],
    )


def _verdict(rows: Sequence[WorstDisturbance], *, complete: bool) -> Any:
    """Return whether all laws keep everything; open as long as a missing law may not."""
    if not all(worst.kept for worst in rows):
        return NOT_KEPT
    return KEPT if complete else OPEN


# -- case files ------------------------------------------------------------------------------------


def require_replayable(study: DisturbanceStudy) -> None:
    """Refuse a case of the package that names files beside it, where nothing is written.

    Raises:
        ArgumentError: With the copy that can be studied.
    """
    path = study.experiment.path
    file = study.experiment.file
    model = file.plant.model
    laws = [file.law(law).law for law in study.experiment.controllers]
    beside = any(map(is_named, (*named_in(file), *laws))) or (model and ":" not in model)
    if beside and path in shipped_files().values():
        raise ArgumentError(
            f"{study.experiment.target} names files beside it, and nothing is written there: copy "
            f"{path.parent}, and study {path.name} of the copy"
        )


def case_text(study: DisturbanceStudy, worst: WorstDisturbance) -> str:
    """Return a complete case file that has the worst disturbance, and so replays it."""
    disturbance = study.disturbance
    case = disturbance.case_of(np.array(worst.signal))
    content = read_content(study.experiment.path)
    content.pop("name", None)
    title = _title(study)
    content["title"] = f"{study.experiment.title}: {title} for {worst.law}"

    states = study.experiment.nominal.system.states
    for index in disturbance.starts:
        start = content["run"].setdefault("start", {})
        start[states[index].name] = written(case.x0[index], states[index].unit)
    if worst.law not in [table.called for table in study.experiment.file.controller]:
        content["controller"].append({"law": worst.law})

    applied = _disturbance_table(disturbance, disturbance.applied_in(case))
    if disturbance.replaced is None:
        content.setdefault("disturbance", []).append(applied)
    else:
        _replace(content, disturbance.replaced_index, applied)
    share = f"{worst.share!r} of {worst.words}"
    return f"# {title} under {worst.law}: {share}.\n{text_of(content)}"


def _replace(content: Content, index: int, applied: Content) -> None:
    """Put a table in the place of a disturbance, of which nothing is uncertain any more."""
    certain = []
    kept = []
    for uncertain in content.pop("uncertain", []):
        place = place_of(content, uncertain["number"])
        if place.owner == "disturbance" and place.row == index:
            certain.append(UncertainTable.model_validate(uncertain).called)
        else:
            kept.append(uncertain)
    if kept:
        content["uncertain"] = kept

    pairs = content.pop("correlation", [])
    correlated = [pair for pair in pairs if not set(certain) & set(pair["between"])]
    if correlated:
        content["correlation"] = correlated

    tables = content["disturbance"]
    labels = [load.get("label") for load in tables]
    label = labels[index]
    if label and labels.count(label) > 1:
        # Other numbers are counted among the tables of this label.
        applied["label"] = label
    tables[index] = applied


def _title(study: DisturbanceStudy) -> str:
    """The worst disturbance in words."""
    disturbance = study.disturbance
    return f"worst {disturbance.bound:g}{unit_after(disturbance.unit)} on {disturbance.place}"


def _disturbance_table(disturbance: BoundedDisturbance, applied: AnyDisturbance) -> dict[str, Any]:
    """Return the table of a disturbance with a table of values."""
    profile: Any = applied.profile
    key = {"w": "body", "input_disturbance": "input", "output_disturbance": "measured"}[
        applied.part
    ]
    content: dict[str, Any] = {key: applied.of}
    if key == "body":
        content["force"] = [written(part, "N") for part in applied.amplitudes[:3]]
        content["torque"] = [written(part, "N m") for part in applied.amplitudes[3:]]
    else:
        content["amplitude"] = written(applied.amplitudes[0], disturbance.unit)
    return {
        **content,
        "profile": "table",
        "values": list(profile.values),
        "hold": written(profile.hold, "s"),
        "label": applied.label,
    }
