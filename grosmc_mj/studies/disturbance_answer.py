"""Answer of a search for the worst disturbance: words, table, charts, document, case files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from grosmc_mj.arguments import require_known
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import read_content
from grosmc_mj.experiments.file.user_code import is_named, named_in
from grosmc_mj.experiments.films import film_of
from grosmc_mj.films.film import Film, Format
from grosmc_mj.requirements.signals import DEVIATION, named_units, signals_of
from grosmc_mj.results.result import (
    KEPT,
    NOT_KEPT,
    OPEN,
    Answer,
    LineChart,
    ReportTable,
    Series,
    StudyVerdict,
    Value,
    finite,
    result,
)
from grosmc_mj.results.tables import Table, names, numbers, table, words
from grosmc_mj.simulation.disturbances import AnyDisturbance
from grosmc_mj.studies.bounded_disturbance import BoundedDisturbance
from grosmc_mj.studies.disturbance import AGREES, ENDED, DisturbanceStudy, Found, watched
from grosmc_mj.sweep.plant_file import written
from grosmc_mj.sweep.runs import Row, recorded_runs

# Points of a curve.
_POINTS = 400
# Name of the signal that was found, in figures and films.
_WORST = "worst found"


# -- words and table -------------------------------------------------------------------------------


def words_of(study: DisturbanceStudy, found: Found) -> str:
    """Return the answer for a law in a line."""
    if found.ends:
        return f"{found.law}: the run ends early; {found.runs} runs"
    ratio = found.share / found.compared_share if found.compared_share > 0 else math.inf
    switches = "1 switch" if found.switches == 1 else f"{found.switches} switches"
    line = (
        f"{found.law}: {found.share:.3g} of {found.requirement}, {ratio:.2g} times "
        f"{study.disturbance.compared}; {switches}; {found.runs} runs; telegraph "
        f"{found.telegraph_share:.3g} ({found.runs})"
    )
    if found.change > AGREES:
        line += f"; {found.pieces} pieces may be too few"
    if found.largest:
        line += f"; all is kept up to {found.largest[0]:.3g} {study.disturbance.unit}"
    return line


def verdict(study: DisturbanceStudy, rows: Sequence[Found]) -> str:
    """Return which laws keep everything under the worst disturbance that was found."""
    disturbance = study.disturbance
    keeping = [found.law for found in rows if found.kept]
    return (
        f"{study.experiment.target}, {disturbance.bound:g} {disturbance.unit} on "
        f"{disturbance.place}: {len(keeping)} of {len(rows)} laws keep all under the worst "
        f"disturbance found{': ' if keeping else ''}{', '.join(keeping)}."
    )


def answer_table(study: DisturbanceStudy, rows: Sequence[Found]) -> Table:
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
    for found in sorted(rows, key=lambda found: -found.share):
        row = [
            found.law,
            _share_text(found.share),
            _share_text(found.compared_share),
            str(found.switches),
            str(found.pieces),
            str(found.runs),
            _share_text(found.telegraph_share),
            "telegraph" if found.telegraph_won else "search",
            _share_text(found.confirmed),
            f"{found.largest[0]:.3g}" if found.largest else "-",
        ]
        texts.append(row)
    title = f"Worst disturbance within {disturbance.bound:g} {disturbance.unit}"
    legend = f"Shares: measured over allowed value. Compared with {disturbance.compared}."
    return table(title, columns, texts, legend=legend)


def _share_text(share: float | None) -> str:
    """Write a share of a limit."""
    if share is None:
        return "-"
    return "run ends" if share > ENDED else f"{share:.3g}"


# -- charts and film -------------------------------------------------------------------------------


def charts(study: DisturbanceStudy, found: Found) -> list[LineChart]:
    """Return the worst disturbance of a law over time, and the quantity nearest to its limit.

    Each is shown beside that of the disturbance that it is compared with.
    """
    disturbance = study.disturbance
    cases = _cases(study, found)
    rows = [Row(found.law, case=case) for case in cases.values()]
    (limit, *_) = [item for item in study.limits(found.law) if item.words == found.requirement]

    signals: list[Series] = []
    courses: list[Series] = []
    quantity = ""
    runs = recorded_runs(study.experiment, rows, study.plant)
    for (name, case), (run, law) in zip(cases.items(), runs, strict=True):
        signal = DEVIATION
        if limit.figure != DEVIATION:
            (signal, *_) = watched([limit], law.designed.error)
        unit = named_units(law, law.designed.sliding_unit or "1")[signal]
        quantity = f"{signal} [{unit}]"

        some = np.unique(np.linspace(0, len(run.time) - 1, _POINTS).astype(int))
        time = run.time[some].tolist()
        profile = case.disturbances[-1].profile
        values = [disturbance.bound * profile(t) for t in time[:-1]]
        course = signals_of(run, law, [signal])[signal][some]
        signals.append(Series(name=name, x=time[:-1], y=values))
        courses.append(Series(name=name, x=time, y=course.tolist()))

    seconds = "time [s]"
    place = f"{disturbance.place} [{disturbance.unit}]"
    level = limit.number if limit.figure and limit.is_level else None
    return [
        LineChart(name=f"{found.law}: disturbance", titles=(seconds, place), lines=signals),
        LineChart(
            name=f"{found.law}: {found.requirement}",
            titles=(seconds, quantity),
            lines=courses,
            limit=level,
        ),
    ]


def _cases(study: DisturbanceStudy, found: Found) -> dict[str, Experiment]:
    """Return the cases of the compared disturbance and of the worst one, by name."""
    disturbance = study.disturbance
    worst = disturbance.case_of(np.array(found.signal))
    return {disturbance.compared: disturbance.compared_case, _WORST: worst}


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


def disturbance_film(study: DisturbanceStudy, found: Found, form: Format | None = None) -> Film:
    """Return a film of a law under the worst disturbance, beside the one it is compared with."""
    cases = _cases(study, found)
    runs = [case.run("physics", found.law) for case in cases.values()]
    film = film_of(runs, form, list(cases))
    return replace(film, title=f"{study.experiment.target}: {_title(study)} for {found.law}")


# -- document --------------------------------------------------------------------------------------


def disturbance_document(
    study: DisturbanceStudy, rows: Sequence[Found], *, complete: bool
) -> dict[str, Any]:
    """Return the content of disturbance_NAME.json; ``complete`` if it has every law."""
    target = study.experiment.target
    standings = []
    values = []
    panels: list[LineChart] = []
    for found in rows:
        breaks_at = "" if found.kept else "worst disturbance"
        standings.append(
            StudyVerdict(
                case=target,
                law=found.law,
                breaks_at=breaks_at,
                words=words_of(study, found),
                complete=complete,
            )
        )
        name = f"{target} {found.law} {study.disturbance.place} worst share"
        values.append(Value(name=name, value=finite(found.share), better=-1, relative=0.1))
        panels += charts(study, found)

    answer = Answer(
        question=f"Worst disturbance of {target}",
        verdict=_verdict(rows, complete=complete),
        words=verdict(study, rows),
        notes=[words_of(study, found) for found in rows],
    )
    return result(
        "disturbance",
        study.configuration(),
        seed=0,
        complete=complete,
        answers=[answer],
        standings=standings,
        sheets=[ReportTable(table=answer_table(study, rows), charts=panels)],
        values=values,
        found=[found.model_dump() for found in rows],
    )


def _verdict(rows: Sequence[Found], *, complete: bool) -> Any:
    """Return whether all laws keep everything; open as long as a missing law may not."""
    if not all(found.kept for found in rows):
        return NOT_KEPT
    return KEPT if complete else OPEN


# -- case files ------------------------------------------------------------------------------------


def require_replayable(study: DisturbanceStudy, folder: Path) -> None:
    """Refuse a folder for case files that lack the files beside the target.

    Raises:
        ArgumentError: With the folder that has them.
    """
    path = study.experiment.path
    file = study.experiment.file
    model = file.plant.model
    laws = [file.law(law).law for law in study.experiment.controllers]
    beside = any(map(is_named, (*named_in(file), *laws))) or (model and ":" not in model)
    if beside and folder.resolve() != path.parent.resolve():
        raise ArgumentError(f"{path} names files beside it: give --out {path.parent}")


def case_text(study: DisturbanceStudy, found: Found) -> str:
    """Return a complete case file that has the worst disturbance, and so replays it."""
    disturbance = study.disturbance
    case = disturbance.case_of(np.array(found.signal))
    content = read_content(study.experiment.path)
    content.pop("name", None)
    title = _title(study)
    content["title"] = f"{study.experiment.title}: {title} for {found.law}"

    states = study.experiment.nominal.system.states
    for index in disturbance.starts:
        start = content["run"].setdefault("start", {})
        start[states[index].name] = written(case.x0[index], states[index].unit)
    if found.law not in [table.called for table in study.experiment.file.controller]:
        content["controller"].append({"law": found.law})

    tables = content.setdefault("disturbance", [])
    if disturbance.own is not None:
        tables.pop(disturbance.own_index)
    tables.append(_disturbance_table(disturbance, case.disturbances[-1]))
    share = f"{found.share!r} of {found.requirement}"
    return f"# {title} under {found.law}: {share}.\n{tomli_w.dumps(content)}"


def _title(study: DisturbanceStudy) -> str:
    """The worst disturbance in words."""
    disturbance = study.disturbance
    return f"worst {disturbance.bound:g} {disturbance.unit} on {disturbance.place}"


def _disturbance_table(disturbance: BoundedDisturbance, worst: AnyDisturbance) -> dict[str, Any]:
    """Return the table of a disturbance with a table of values."""
    profile: Any = worst.profile
    key = {"w": "body", "input_disturbance": "input", "output_disturbance": "measured"}[worst.part]
    content: dict[str, Any] = {key: worst.of}
    if key == "body":
        content["force"] = [written(part, "N") for part in worst.amplitudes[:3]]
        content["torque"] = [written(part, "N m") for part in worst.amplitudes[3:]]
    else:
        content["amplitude"] = written(worst.amplitudes[0], disturbance.unit)
    return {
        **content,
        "profile": "table",
        "values": list(profile.values),
        "hold": written(profile.hold, "s"),
        "label": worst.label,
    }
