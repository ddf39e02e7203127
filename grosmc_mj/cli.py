"""The command line: the only place that prints, picks paths and exits."""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.console import Console
from tyro.conf import Positional, arg, subcommand

from grosmc_mj.errors import ArgumentError, GrosmcError, SetupError

if TYPE_CHECKING:
    from grosmc_mj.validation.runs import RunResult

PROGRAM = "grosmc-mj"
DONE, DIFFERS, WRONG = 0, 1, 2

# Wide enough for the table of results when standard output is no terminal.
_WIDTH = 120

Systems = Annotated[
    Positional[tuple[str, ...]],
    arg(metavar="[SYSTEM ...]", name="system", help_behavior_hint="(default: all of them)"),
]
System = Annotated[Positional[str], arg(metavar="SYSTEM", name="system")]


@dataclass(frozen=True)
class Validate:
    """Run the chapter's cases and say whether they come out as recorded.

    Every case of each SYSTEM (servo, cart_pendulum, arm; all of them, if none is named) runs on
    the analytic plants (the chapter's printed equations where they are misprinted, and the
    corrected ones) and in MuJoCo, under LQR and under GROSMC. A table goes to standard output;
    figures (PNG and SVG, numbered as in the chapter) and validation.json go to --out.

    Exit code: 0 if every result is as the repository records it, 1 if one differs, 2 if the
    command or the set-up is wrong.

    Attributes:
        systems: Systems to run.
        case: Only this case: nominal, case1 or case2.
        engine: native compiles law and loop; python steps the same law in an ordinary loop,
            a few times slower and the same to rounding.
        control_period: Time between two samples of the law, in s; a multiple of the timestep.
        timestep: Physics timestep, in s.
        integrator: MuJoCo's integrator: RK4, implicitfast, implicit or Euler.
        out: Folder for validation.json and the figures.
        figures: Whether to draw the figures.
        record: Record the results as expected, for review; needs the default settings.
    """

    systems: Systems = ()
    case: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="(default: every case)")] = (
        None
    )
    engine: Annotated[str, arg(metavar="native|python")] = "native"
    control_period: Annotated[float, arg(metavar="S")] = 1e-3
    timestep: Annotated[float, arg(metavar="S")] = 1e-3
    integrator: Annotated[str, arg(metavar="NAME")] = "RK4"
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")
    figures: bool = True
    record: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False


@dataclass(frozen=True)
class List:
    """List the systems with their cases, plants and controllers."""


@dataclass(frozen=True)
class Compare:
    """Compare the analytic plants of a SYSTEM with MuJoCo.

    Prints the largest difference of the accelerations at random states, inputs and wrenches,
    and of an open-loop trajectory under wrenches, for the nominal model and for random edits of
    mass and length. Exit code 1 if the corrected equations do not agree to 1e-10.

    Attributes:
        system: servo, cart_pendulum or arm.
        states: Random states of each comparison.
        edits: Random edits of mass (x0.25 to x4) and length (x0.5 to x4).
        seed: Of the random numbers.
        out: Folder for compare_SYSTEM.json.
    """

    system: System
    states: Annotated[int, arg(metavar="N")] = 1000
    edits: Annotated[int, arg(metavar="N")] = 5
    seed: Annotated[int, arg(metavar="N")] = 0
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")


@dataclass(frozen=True)
class Bench:
    """Measure the closed loop's throughput as ratios to MuJoCo's own open loop.

    The pendulum runs under the full GROSMC law at every timestep, once and 1024 times at once.
    All loops are measured in turn in each round; ratios are medians over the rounds. Leave the
    machine alone meanwhile.

    Attributes:
        integrator: MuJoCo's integrator; by default both RK4, the model's own, and implicitfast.
        rounds: How often each loop is measured.
    """

    integrator: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None
    rounds: Annotated[int, arg(metavar="N")] = 15


@dataclass(frozen=True)
class Readme:
    """Write the table of results in a README anew from a validation.json.

    Attributes:
        readme: The file with the table between its two marks.
        results: What validate wrote.
    """

    readme: Path = Path("README.md")
    results: Path = Path("renders/validation.json")


Command = (
    Annotated[Validate, subcommand("validate")]
    | Annotated[List, subcommand("list")]
    | Annotated[Compare, subcommand("compare")]
    | Annotated[Bench, subcommand("bench")]
    | Annotated[Readme, subcommand("readme")]
)

_ABOUT = (
    "Does a robust controller keep its promise on real physics, and where does it break? "
    "GROSMC (LQR made robust by an integral sliding surface) on the servo rotor, the "
    "cart-pendulum and the 1-DOF arm: printed equations, corrected ones and MuJoCo, side by side. "
    "Exit codes: 0 done and as recorded, 1 a result differs, 2 wrong use or broken set-up."
)


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
                description=_ABOUT,
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
    from grosmc_mj.validation import expected, tables
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
    found: list[Any] = []
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
            for table in tables.results_tables(results):
                console.print(table)
                console.print()
            console.print(tables.LEGEND, style="dim")
            for line in tables.endings(results):
                console.print(line, style="red", soft_wrap=True)
            console.print(tables.gains_table(results))
            if found:
                console.print(tables.agreement_table(found))
        if results and not complete:
            write_json(
                target, document(results, found, settings, selected, seed, None, complete=False)
            )
    console.print(
        f"{len(results)} runs and {len(figures)} figures in "
        f"{time.perf_counter() - started:.1f} s; {target}"
    )
    return _verdict(console, differing, len(results))


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
