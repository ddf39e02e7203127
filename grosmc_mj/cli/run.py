"""grosmc-mj run and new."""

from __future__ import annotations

import keyword
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from grosmc_mj.cli import screen
from grosmc_mj.cli.commands import New, Run
from grosmc_mj.cli.films import FOLDER, film_runs
from grosmc_mj.errors import ArgumentError, GrosmcError, shown, unknown_name

if TYPE_CHECKING:
    from collections.abc import Sequence

    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.runs import RunResult
    from grosmc_mj.premises.audit import Audit

_NAME = re.compile(r"[A-Za-z_]\w*")


def run(command: Run) -> int:
    """Run a case file, print, write, judge."""
    from grosmc_mj.chapter.claims_document import audit_document
    from grosmc_mj.experiments.document import experiment_document
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.file.shipped import shipped_files
    from grosmc_mj.experiments.requirements import failed, judge_all
    from grosmc_mj.premises.robot import audits
    from grosmc_mj.report.document import write_json

    experiment = Experiment.load(command.file)
    _check_uncertain(experiment)
    # A case of the package is called system/case, a file by its own name.
    shipped = command.file in shipped_files()
    name = command.file.replace("/", "_") if shipped else Path(command.file).stem
    console = screen.console()
    command.out.mkdir(parents=True, exist_ok=True)
    target = command.out / f"{name}.json"
    results: list[RunResult] = []
    complete, found = False, []
    try:
        with screen.progress(len(experiment.laws)) as advance:
            for result in experiment.runs():
                results.append(result)
                advance(result.key)
        complete = True
        found = audits(results)
    finally:
        # What was computed is shown and kept, whatever happened since.
        judgements = judge_all(experiment.limits, results)
        if results:
            content = experiment_document(
                experiment,
                results,
                judgements,
                complete=complete,
                premises=[audit_document(audit) for audit in found],
            )
            write_json(target, content)
            _show(console, results)
            _converted(console, experiment)
    _requirements(console, experiment, judgements)
    _premises(console, found)
    files = [target]
    if command.figures:
        files.append(_draw(results, command.out / f"{name}.png"))
    console.print(f"{len(results)} runs; {', '.join(map(str, files))}", soft_wrap=True)
    if command.film:
        film_runs(console, results, experiment.settings, command.out / FOLDER / f"{name}.mp4")
    ended = not experiment.limits and any(result.ended for result in results)
    return screen.DIFFERS if ended or failed(judgements) else screen.DONE


def _check_uncertain(experiment: Experiment) -> None:
    """Refuse wrong [[uncertain]] tables, as a campaign would; a single run does not need them."""
    from grosmc_mj.campaign.family.family import family_of

    if experiment.file.uncertain:
        try:
            family_of(experiment.file, experiment.case, experiment.nominal.plant)
        except GrosmcError as error:
            raise ArgumentError(f"{experiment.path}: {error}") from error


def _show(console: Console, results: list[RunResult]) -> None:
    """Print what was measured."""
    from grosmc_mj.experiments import tables

    console.print(tables.results_table(results))
    console.print()
    console.print(tables.LEGEND, style="dim")
    for line in tables.endings(results):
        console.print(line, style="red", soft_wrap=True)
    console.print(tables.gains_table(results))
    console.print()


def _converted(console: Console, experiment: Experiment) -> None:
    """Say what of a robot's model was changed for torque control, and what its laws leave out."""
    robot = experiment.nominal.robot
    for sentence in robot.converted if robot is not None else ():
        console.print(f"{robot.plant.system.name}: {sentence}", style="dim", soft_wrap=True)  # pyright: ignore


def _draw(results: list[RunResult], path: Path) -> Path:
    """The figure."""
    from grosmc_mj.experiments.figure import SIZE, draw_experiment
    from grosmc_mj.report.figure import figure_written

    with figure_written(path, SIZE) as figure:
        draw_experiment(figure, results)
    return path


def _requirements(console: Console, experiment: Experiment, judgements: list) -> None:
    """Say what was required and whether it was kept."""
    from grosmc_mj.experiments import tables
    from grosmc_mj.experiments.requirements import failed

    if not experiment.limits:
        console.print("The file requires nothing: give it a [[requirement]].", markup=False)
        return
    console.print(tables.requirements_table(judgements))
    console.print()
    wrong = failed(judgements)
    if wrong:
        said = f"{len(wrong)} of {len(judgements)} requirements are not kept."
        console.print(said, style="bold red")
    else:
        console.print(f"All {len(judgements)} requirements are kept.", style="bold green")


def _premises(console: Console, found: Sequence[Audit]) -> None:
    """Say what the theory of each law presumes of a robot, and whether it was so."""
    from grosmc_mj.chapter.claims_tables import audit_table, worst_points

    for audit in found:
        console.print(audit_table(audit))
        for line in worst_points(audit):
            console.print(line, soft_wrap=True)


def _like(name: str) -> str:
    """The text of a case of the package."""
    from grosmc_mj.experiments.file.reading import resolved_text
    from grosmc_mj.experiments.file.shipped import shipped_files

    if name not in shipped_files():
        raise ArgumentError(unknown_name("case", name, shipped_files()))
    return resolved_text(shipped_files()[name])


def new(command: New) -> int:
    """Write a case file to begin with."""
    from grosmc_mj.experiments.file.shipped import own_plant, starter
    from grosmc_mj.files import written_aside

    name = command.name.removesuffix(".toml")
    if not _NAME.fullmatch(name) or keyword.iskeyword(name) or name in sys.stdlib_module_names:
        raise ArgumentError(
            f"{shown(command.name)} must be a name of letters, digits and underscores"
        )
    if command.like is not None and command.python:
        raise ArgumentError("--like copies a case, --python writes one: give one of them")
    files = {f"{name}.toml": starter()}
    if command.like is not None:
        files = {f"{name}.toml": _like(command.like)}
    elif command.python:
        files = own_plant(name)
    for file in files:
        if Path(file).exists():
            raise ArgumentError(f"{file} is there already: take another name or remove it")
    for file, text in files.items():
        with written_aside(Path(file)) as part:
            part.write_text(text, encoding="utf-8")
    screen.console().print(
        f"{' and '.join(files)} written; run: grosmc-mj run {name}.toml", soft_wrap=True
    )
    return screen.DONE
