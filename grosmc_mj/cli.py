"""The command line: the only place that prints, picks paths and exits."""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro
from rich.console import Console

from grosmc_mj.commands import ABOUT, Bench, Command, Compare, List, Readme, Validate
from grosmc_mj.errors import ArgumentError, GrosmcError, SetupError

if TYPE_CHECKING:
    from grosmc_mj.validation.agreement import Agreement
    from grosmc_mj.validation.runs import RunResult

PROGRAM = "grosmc-mj"
DONE, DIFFERS, WRONG = 0, 1, 2

# Wide enough for the table of results when standard output is no terminal.
_WIDTH = 120


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit."""
    try:
        command = _parse(arguments)
        _import_mujoco()
        code = _run(command)
        sys.stdout.flush()
    except GrosmcError as error:
        code = _complain(str(error))
    except KeyboardInterrupt:
        code = _complain("interrupted; run the same command again to start over")
    except BrokenPipeError:
        # The reader of our output has gone; there is nobody left to tell.
        sys.stderr.close()
        code = DONE
    except OSError as error:
        code = _complain(f"{error.filename or 'output'}: {error.strerror}")
        # What is still buffered cannot be written either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(code)


def _import_mujoco() -> None:
    """Import MuJoCo, which fails in many ways when MUJOCO_GL asks for what is not there.

    Raises:
        SetupError: If it cannot be imported.
    """
    try:
        import mujoco  # noqa: F401
    except Exception as error:
        backend = os.environ.get("MUJOCO_GL")
        hint = f" with MUJOCO_GL={backend} (unset it or install its library)" if backend else ""
        raise SetupError(f"MuJoCo cannot be imported{hint}: {error}") from error


def _complain(message: str) -> int:
    """Say in one line what was wrong."""
    print(f"{PROGRAM}: {' '.join(message.split())}", file=sys.stderr)
    return WRONG


def _parse(arguments: Sequence[str] | None) -> Any:
    """The command that the arguments describe, or one line about what is wrong with them."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    if not arguments:
        arguments = ["--help"]
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(
                Command,
                prog=PROGRAM,
                description=ABOUT,
                args=arguments,
                config=(tyro.conf.OmitArgPrefixes,),
            )
    except SystemExit as stop:
        if not stop.code:
            raise
        raise ArgumentError(_condense(said.getvalue())) from None


def _condense(box: str) -> str:
    """What a framed message says, without its title and the help that it repeats.

    The frame is of line-drawing characters or, where the terminal lacks them, of ASCII ones.
    """
    lines = [line.strip("│| ") for line in box.splitlines()[1:]]
    parts = [part.strip("╰╯+─- ") for part in re.split(r"[─-]{5,}", " ".join(lines))]
    words = [part for part in parts if part and "helptext" not in part]
    return "; ".join([*words, f"for help: {PROGRAM} --help"])


def _run(command: Any) -> int:
    """Carry out a command."""
    actions = {
        Validate: _validate,
        List: _list,
        Compare: _compare,
        Bench: _bench,
        Readme: _readme,
    }
    return actions[type(command)](command)


def _console() -> Console:
    """Standard output, never narrower than the table of results."""
    return Console(highlight=False, width=max(_WIDTH, Console().width))


@contextlib.contextmanager
def _progress(total: int) -> Iterator[Any]:
    """A progress bar on standard error, where that is a terminal; advance it by calling."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    error_console = Console(stderr=True)
    with Progress(
        *columns,
        TimeElapsedColumn(),
        console=error_console,
        transient=True,
        disable=not error_console.is_terminal,
    ) as progress:
        task = progress.add_task("", total=total)
        yield lambda text: progress.update(task, advance=1, description=f"{text:<40}")


def _validate(command: Validate) -> int:
    """Run, print, write, compare."""
    from grosmc_mj.validation import expected
    from grosmc_mj.validation.agreement import agreements, disagreements
    from grosmc_mj.validation.figures import drawable, write_figures
    from grosmc_mj.validation.results_file import document, write_json
    from grosmc_mj.validation.runs import Settings, plan, run_all, select_cases

    started, seed = time.perf_counter(), 0
    settings = Settings(
        command.engine,  # pyright: ignore[reportArgumentType]  checked by Settings
        command.control_period,
        command.timestep,
        command.integrator,  # pyright: ignore[reportArgumentType]  checked by the plant
    )
    selected = select_cases(command.systems, command.case)
    if command.record and settings != Settings():
        raise ArgumentError(
            "--record needs the default settings: leave out --engine, --control-period, "
            "--timestep and --integrator"
        )
    systems = list(dict.fromkeys(case.system for case in selected))
    results: list[RunResult] = []
    found: list[Agreement] = []
    differing: list[str] | None = None
    figures: list[Path] = []
    console, target = _console(), command.out / "validation.json"
    complete = False
    try:
        pictures = len(drawable(selected)) if command.figures else 0
        with _progress(len(plan(selected)) + len(systems) + pictures) as advance:
            for result in run_all(selected, settings):
                results.append(result)
                advance(result.key)
            for system in systems:
                found += agreements(system, seed=seed)
                advance(f"{system}: analytic against physics")
            if command.record:
                expected.record_expected(results, settings)
            differing = expected.differences(results, settings)
            if wrong := disagreements(found):
                differing = [*(differing or []), *wrong]
            complete = True
            write_json(
                target,
                document(results, found, settings, selected, seed, differing, complete=True),
            )
            if command.figures:
                for path in write_figures(results, command.out):
                    figures.append(path)
                    advance(path.name)
    finally:
        # What was computed is shown and kept, whatever happened since.
        if results:
            _show(console, results, found)
        if results and not complete:
            write_json(
                target, document(results, found, settings, selected, seed, None, complete=False)
            )
    console.print(
        f"{len(results)} runs and {len(figures)} figures in "
        f"{time.perf_counter() - started:.1f} s; {target}"
    )
    return _verdict(console, differing, len(results))


def _show(console: Console, results: Sequence[RunResult], found: Sequence[Agreement]) -> None:
    """Print the tables of what was computed."""
    from grosmc_mj.validation import tables

    for table in tables.results_tables(results):
        console.print(table)
        console.print()
    console.print(tables.LEGEND, style="dim")
    for line in tables.endings(results):
        console.print(line, style="red", soft_wrap=True)
    console.print(tables.gains_table(results))
    if found:
        console.print(tables.agreement_table(found))


def _verdict(console: Console, differing: list[str] | None, count: int) -> int:
    """Say whether the results are as recorded."""
    if differing is None:
        console.print("Not compared with the recorded results: they hold for other settings.")
        return DONE
    for line in differing:
        console.print(f"differs: {line}", style="red", soft_wrap=True)
    if differing:
        console.print(f"{len(differing)} results differ from the recorded ones.", style="bold red")
        return DIFFERS
    console.print(f"All {count} runs are as recorded.", style="bold green")
    return DONE


def _list(_: List) -> int:
    """Systems, cases, plants, controllers."""
    from grosmc_mj.plants import SYSTEMS
    from grosmc_mj.validation.cases import cases
    from grosmc_mj.validation.designs import DESIGNS, controller_names
    from grosmc_mj.validation.runs import plant_names

    console = _console()
    for name, system in SYSTEMS.items():
        console.print(f"[bold]{name}[/]  {system.title}")
        for case in cases(name):
            console.print(f"  {case.name:<8} {case.title}  [dim]({case.source})[/]")
        console.print(f"  plants       {', '.join(plant_names(name))}")
        console.print(f"  controllers  {', '.join(controller_names(name))}")
        for alias, (same, why) in DESIGNS[name].aliases.items():
            console.print(f"  {alias} is {same}: {why}", style="dim")
        console.print()
    return DONE


def _compare(command: Compare) -> int:
    """Analytic against physics plants."""
    from grosmc_mj.validation import tables
    from grosmc_mj.validation.agreement import AGREEMENT_BOUND, agreements, disagreements
    from grosmc_mj.validation.results_file import comparison_document, write_json

    for name, value, least in (("states", command.states, 1), ("edits", command.edits, 0)):
        if value < least:
            raise ArgumentError(f"--{name} {value} must be {least} or more")
    if command.seed < 0:
        raise ArgumentError(f"--seed {command.seed} must be 0 or more")
    rows = agreements(command.system, seed=command.seed, states=command.states, edits=command.edits)
    found = disagreements(rows)
    console = _console()
    console.print(tables.agreement_table(rows))
    for line in found:
        console.print(f"differs: {line}", style="red", soft_wrap=True)
    target = command.out / f"compare_{command.system}.json"
    write_json(target, comparison_document(rows, found, command.seed))
    worst = max(row.acceleration for row in rows if row.variant == "corrected")
    console.print(
        f"Accelerations of the corrected equations and of MuJoCo differ by up to {worst:.1e} of "
        f"the largest term (bound {AGREEMENT_BOUND:.0e}), at {command.states} states of each "
        f"model, seed {command.seed}; {target}"
    )
    return DIFFERS if found else DONE


def _bench(command: Bench) -> int:
    """Throughput ratios."""
    from grosmc_mj.validation import tables
    from grosmc_mj.validation.benchmark import benchmark

    if command.rounds < 1:
        raise ArgumentError(f"--rounds {command.rounds} must be 1 or more")
    console = _console()
    for integrator in [command.integrator] if command.integrator else ["RK4", "implicitfast"]:
        rows = benchmark(integrator, command.rounds)  # pyright: ignore[reportArgumentType]
        console.print(tables.throughput_table(rows, integrator))
    return DONE


def _readme(command: Readme) -> int:
    """The README's table."""
    from grosmc_mj.validation.readme_table import write_table

    write_table(command.readme, command.results)
    return DONE


if __name__ == "__main__":
    main()
