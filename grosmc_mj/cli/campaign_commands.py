"""What the command line offers of campaigns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional, arg


@dataclass(frozen=True)
class Campaign:
    """Run thousands of uncertain plants and say what share of them keeps what is required.

    The uncertainty is a case file's [[uncertain]] tables; the package has a file for servo,
    cart_pendulum and arm. Every plant meets every controller, in MuJoCo, and nothing is recorded
    but what it did: pass rates with exact intervals, margins, differences between the controllers
    and what drives the margins go to standard output. The folder keeps manifest.json, one row a run
    in parts/*.parquet, results.json and figures; grosmc-mj replay repeats any of the runs.

    Exit code: 0 if done, 1 if --at-least is missed, 2 if the command or the set-up is wrong.

    Attributes:
        target: A system, a case of the package or a case file.
        runs: Plants.
        shard: Plants of one part, the smallest piece of work that is done, kept and handed out.
        seed: Of the sampler; run i depends on it and on i alone.
        sampler: sobol, lhs, random or corners.
        controllers: Those of the file to run.
        control_period: Time between two samples of the laws, in s, instead of the file's.
        duration: Of each run, in s, instead of the file's.
        integrator: MuJoCo's, instead of the file's. implicitfast takes less than half the time of
            RK4, the packaged models' own, and passes plants that RK4 fails: in 7 verdicts on 5 of
            256 arms RK4 was right, by steps a tenth as long.
        out: The campaign's folder; by default renders/campaigns/NAME.
        resume: Go on with what is in the folder.
        executor: batch runs in this process, on all cores; processes in workers of their own; dask
            in those of a Dask scheduler.
        workers: Processes, for processes and for dask without a scheduler.
        scheduler: Address or file of a Dask scheduler.
        confidence: Of the intervals.
        worst: Search for the worst plant under each controller, and shrink it.
        evaluations: Runs that this search may take for a controller.
        radius: Bisect the scale of the uncertainty at which each controller first fails.
        axes: Two uncertain numbers that the map is drawn over.
        at_least: Share of plants that must be shown to keep everything, under each controller:
            exit code 1 if the lower end of an interval is below it.
        figures: Whether to draw the figures.
    """

    target: Annotated[Positional[str], arg(metavar="SYSTEM|FILE", name="target")]
    runs: Annotated[int, arg(metavar="N")] = 1024
    shard: Annotated[int, arg(metavar="N")] = 512
    seed: Annotated[int, arg(metavar="N")] = 0
    sampler: Annotated[str, arg(metavar="NAME")] = "sobol"
    controllers: Annotated[
        tuple[str, ...],
        arg(metavar="NAME [NAME ...]", help_behavior_hint="(default: all of the file)"),
    ] = ()
    control_period: Annotated[float | None, arg(metavar="S", help_behavior_hint="")] = None
    duration: Annotated[float | None, arg(metavar="S", help_behavior_hint="")] = None
    integrator: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None
    out: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")] = None
    resume: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    executor: Annotated[str, arg(metavar="NAME")] = "batch"
    workers: Annotated[int | None, arg(metavar="N", help_behavior_hint="(default: one a core)")] = (
        None
    )
    scheduler: Annotated[str | None, arg(metavar="ADDRESS", help_behavior_hint="")] = None
    confidence: Annotated[float, arg(metavar="SHARE")] = 0.95
    worst: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    evaluations: Annotated[int, arg(metavar="N")] = 1024
    radius: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    axes: Annotated[
        tuple[str, ...],
        arg(metavar="X Y", help_behavior_hint="(default: those that drive margins most)"),
    ] = ()
    at_least: Annotated[float | None, arg(metavar="SHARE", help_behavior_hint="")] = None
    figures: bool = True


@dataclass(frozen=True)
class Replay:
    """Repeat one run of a campaign, recorded, and say whether it is the same to the last bit.

    Writes RUN.json, the figure and the film to replays in the campaign's folder, or to --out. The
    folder is data: no Python is imported from it.

    Exit code 1 if the run is not what the campaign stored.

    Attributes:
        campaign: The campaign's folder.
        run: Number of the run; or worst, shrunk or outside, the plants that --worst and --radius
            found.
        controller: Whose run; by default the campaign's last controller.
        engine: native or python.
        case_file: The campaign's case file, if that names Python, which is imported from beside it
            if it is what the campaign recorded; a model is taken from there too.
        out: Where to write instead.
        film: Whether to film it in MuJoCo: films/RUN.mp4.
        figures: Whether to draw it.
    """

    campaign: Annotated[Positional[Path], arg(metavar="CAMPAIGN", name="campaign")]
    run: Annotated[Positional[str], arg(metavar="ID", name="id")]
    controller: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None
    engine: Annotated[str, arg(metavar="native|python")] = "native"
    case_file: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None
    out: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")] = None
    film: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    figures: bool = True
