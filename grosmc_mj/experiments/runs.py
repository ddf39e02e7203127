"""One run of an experiment, and how experiments are run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from grosmc_mj.arguments import require_known
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.switching import SWITCHINGS
from grosmc_mj.errors import DivergenceError
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.metrics import (
    Comparison,
    Metric,
    compare_with_optimum,
    cost_shares,
    measure,
)
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.physics.mujoco_plant import Integrator
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.simulate import Engine, simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory

if TYPE_CHECKING:
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.requirements import Judgement

Surface = Literal["printed", "discrete"]

# What a run is told to cost.
_SHARES = ("J(u_c)/J*", "J(u_d)/J*")


@dataclass(frozen=True)
class Settings:
    """How the cases are run.

    Attributes:
        engine: ``native`` or ``python``.
        control_period: [s]; the chapter prints none.
        timestep: Physics timestep [s].
        integrator: MuJoCo's integrator.
        switching: Name of the switching law of the sliding mode laws.
        surface: Their surface: ``printed``, or ``discrete`` for the one that is zero at every
            sample of the nominal plant.
    """

    engine: Engine = "native"
    control_period: float = 1e-3
    timestep: float = 1e-3
    integrator: Integrator = "RK4"
    switching: str = "sign"
    surface: Surface = "printed"

    def __post_init__(self) -> None:
        for kind, value, valid in (
            ("engine", self.engine, get_args(Engine)),
            ("surface", self.surface, get_args(Surface)),
            ("switching law", self.switching, SWITCHINGS),
        ):
            require_known(kind, value, valid)

    def changes(self) -> dict[str, Any]:
        """The settings that are not the defaults."""
        default = vars(Settings())
        return {name: value for name, value in vars(self).items() if value != default[name]}

    def engine_for(self, law: Controller) -> Engine:
        """The engine, or ``python`` for a law that can't be compiled."""
        return "python" if getattr(law.law, "python_only", False) else self.engine


@dataclass(frozen=True, eq=False)
class RunResult:
    """An experiment on one plant under one controller.

    Attributes:
        experiment: The experiment.
        plant: ``printed``, ``corrected`` or ``physics``.
        controller: With the numbers of its design.
        trajectory: Up to the end or to where the run stopped being valid.
        comparison: The run beside the optimum that its law was designed for.
        metrics: By name.
        ended: Empty, or why the run ended early.
        true: The plant itself.
    """

    experiment: Experiment
    plant: PlantName
    controller: Controller
    trajectory: Trajectory
    comparison: Comparison
    metrics: Mapping[str, Metric]
    ended: str = ""
    true: Plant | None = None

    @property
    def case(self) -> Case:
        """Start, duration, edits, disturbances."""
        return self.experiment.case

    @property
    def requirements(self) -> list[Judgement]:
        """What the experiment requires of this run, and whether it is kept."""
        from grosmc_mj.experiments.requirements import judge_all

        return judge_all(self.experiment.limits, [self])

    @property
    def cost_shares(self) -> tuple[Metric, Metric]:
        """J(u_c)/J* and J(u_d)/J* a second, see ``metrics.cost_shares``."""
        return cost_shares(self.metrics, float(self.trajectory.time[-1]))

    def film(self, path: str | Path) -> Path:
        """Write a film of the run, and return where it is.

        Raises:
            ArgumentError: If the run is not on physics.
            SetupError: If it cannot be rendered or written.
        """
        from grosmc_mj.experiments.films import film_of, write_case_film

        film = film_of([self])
        return write_case_film(self.case, film, Path(path), settings=self.experiment.settings).film

    def save(self, path: str | Path) -> Path:
        """Write the trajectory as ``.parquet`` or ``.csv``; see ``Trajectory.save``."""
        unit = self.controller.design.sliding_unit if self.controller.design else ""
        return self.trajectory.save(path, sliding_unit=unit)

    def __repr__(self) -> str:
        """What was run and what came out, in five lines."""
        kept = [item.kept for item in self.requirements]
        words = f"{sum(kept)} of {len(kept)} kept" if kept else "none"
        until, status = self.trajectory.time[-1], self.status.name.lower()
        named = ("deviation", "settling_time", "max_input")
        values = [f"{name.replace('_', ' ')} {_shown(self.metrics[name])}" for name in named]
        for name, share in zip(_SHARES, self.cost_shares, strict=True):
            values.append(f"{name} {_shown(share)}")
        return "\n".join(
            [
                f"{self.key}: {self.case.title}",
                f"{status} at {until:g} s" + (f": {self.ended}" if self.ended else ""),
                ", ".join(values[:3]),
                ", ".join(values[3:]),
                f"requirements: {words}",
            ]
        )

    @property
    def key(self) -> str:
        """Name of the run in files: system/case/plant/controller."""
        return "/".join((self.case.system, self.case.name, self.plant, self.controller.name))

    @property
    def plant_parameters(self) -> Any:
        """The true plant's numbers; None where it has no equations."""
        return self.true.parameters if self.true else None

    @property
    def status(self) -> Status:
        """How the run ended."""
        return self.trajectory.status  # pyright: ignore[reportReturnType]


def _shown(metric: Metric) -> str:
    """A metric with its unit, or why it has no value."""
    if metric.value is None:
        return f"- ({metric.note})"
    unit = "" if metric.unit == "1" else f" {metric.unit}"
    return f"{metric.value:.4g}{unit}"


def run_on(experiment: Experiment, name: PlantName, law: Controller, plant: Plant) -> RunResult:
    """Run an experiment with this very law on this very plant, whatever they are called.

    A run that ends early is a result like any other.
    """
    case, settings, ended = experiment.case, experiment.settings, ""
    try:
        run = simulate(
            plant,
            law,
            case.x0,
            duration=case.duration,
            control_period=settings.control_period,
            timestep=settings.timestep,
            disturbances=case.disturbances,
            engine=settings.engine_for(law),
        )
    except DivergenceError as error:
        run, ended = error.trajectory, str(error)
    comparison = compare_with_optimum(run, law)
    metrics = measure(run, law, comparison, case.onset)
    return RunResult(experiment, name, law, run, comparison, metrics, ended, plant)
