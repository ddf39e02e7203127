"""Runs of a region: how a law ends from each start, judged at a few looks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.output.palette import BLACK, BLUE, ORANGE, PURPLE, SKY, YELLOW
from grosmc_mj.studies.sweep.draws import drawn_case
from grosmc_mj.studies.sweep.runs import Outcomes, Row, run_rows
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.law import Law, wrapped
from grosmc_mj.theory.plants import Plant, System

Letters = NDArray[np.str_]

# Largest size of a regulated error at the end that counts as none, by its unit. It is far above the
# chatter that a switching law leaves at a control period of 1 ms (below 0.2 degrees and 0.01 rad/s)
# and about a hundredth of the default starts. Position and rate count together: a swing through
# zero is fast there.
TOLERANCES: Mapping[str, float] = {"rad": math.radians(1.0), "rad/s": 0.1, "m": 0.02, "m/s": 0.1}
# Parts of the duration after which runs are judged; those that are decided end there. Most that
# leave the region do so in the first part.
_LOOKS = (1 / 16, 1 / 4, 1.0)
# To count as converged before the end, errors must be within this part of their tolerances.
_EARLY = 0.25


class Outcome(Enum):
    """Outcome of a start: its letter in the file, its name and its colour.

    A start varies if it converges in some draws of what is random, not in all.
    """

    CONVERGED = ("c", "converged", BLUE)
    LEFT = ("l", "left the region", ORANGE)
    SINGULAR = ("s", "singular plant", PURPLE)
    NOT_CONVERGED = ("n", "not converged", YELLOW)
    VARIES = ("v", "in some draws", SKY)
    DIVERGED = ("d", "diverged", BLACK)

    def __init__(self, letter: str, title: str, colour: str) -> None:
        self.letter = letter
        self.title = title
        self.colour = colour


# Outcomes by the status of a run. No law of the package ends with an undefined input while its
# state is bounded.
_ENDED_EARLY = {
    "undefined_law": Outcome.LEFT,
    "singular_plant": Outcome.SINGULAR,
    "diverged": Outcome.DIVERGED,
    "undefined_input": Outcome.DIVERGED,
}


def judge(status: Iterable[str], errors: Array, tolerance: ArrayLike) -> Letters:
    """Return the outcomes of runs of a guarded law, as letters.

    Args:
        status: How each run ended, a status of ``Outcomes``, (nsim,).
        errors: Error states at the end, (nsim, errors).
        tolerance: Largest size of each error that counts as none, (errors,).
    """
    near = np.all(np.abs(errors) <= np.asarray(tolerance), axis=1)
    letters = []
    for name, is_near in zip(status, near, strict=True):
        at_end = Outcome.CONVERGED if is_near else Outcome.NOT_CONVERGED
        outcome = _ENDED_EARLY.get(name, at_end)
        letters.append(outcome.letter)
    return np.array(letters)


@dataclass(frozen=True, eq=False)
class RegionLoop:
    """A law on the physics of an experiment, stopped where it leaves the region of the laws.

    Attributes:
        experiment: Its case and settings.
        controller: The law, guarded; designed for the nominal plant.
        plant: The experiment's plant, or its equations, which take steps of RK4.
        predict: Whether the law knows the experiment's loop.
        draw: Draw of what is random in the experiment's loop.
    """

    experiment: Experiment
    controller: Controller
    plant: Plant
    predict: bool = False
    draw: int = 0

    @classmethod
    def of(cls, experiment: Experiment, controller: str) -> RegionLoop:
        """Return the loop of a named controller."""
        law = guarded(experiment.law("physics", controller), experiment.nominal.system)
        return cls(experiment, law, experiment.plant("physics"), experiment.predicts(controller))

    @property
    def system(self) -> System:
        """The plant's system."""
        return self.experiment.nominal.system

    def run(self, starts: Array, duration: float) -> Outcomes:
        """Return the runs from the starts (nsim, n)."""
        case = drawn_case(self.experiment.changed(duration=duration), self.draw)
        rows = []
        for start in starts.tolist():
            row = Row(
                self.controller,
                case=replace(case, x0=tuple(start)),
                plant=self.plant,
                predict=self.predict,
            )
            rows.append(row)
        return run_rows(self.experiment, rows, ())

    @property
    def sensitivity(self) -> Array:
        """C of the error state at the start, z = C x + c: 1, -1 or 0, (errors, n)."""
        n = len(self.system.states)
        at_origin = self.errors(0.0, np.zeros((1, n)))
        return (self.errors(0.0, np.eye(n)) - at_origin).T

    @property
    def equilibrium(self) -> Array:
        """State without error at t = 0; states that the law does not regulate are zero, (n,)."""
        origin = np.zeros((1, len(self.system.states)))
        return -np.linalg.pinv(self.sensitivity) @ self.errors(0.0, origin)[0]

    @property
    def regulated(self) -> list[int]:
        """The state that each error is measured on."""
        return np.abs(self.sensitivity).argmax(axis=1).tolist()

    @property
    def tolerances(self) -> dict[str, tuple[float, str]]:
        """Largest size of each regulated error that counts as none: by state, with unit."""
        tolerances = {}
        for index in self.regulated:
            state = self.system.states[index]
            require_known("unit of an error with a tolerance", state.unit, TOLERANCES)
            tolerances[state.symbol] = (TOLERANCES[state.unit], state.unit)
        return tolerances

    def errors(self, time: float, states: Array) -> Array:
        """Return the error states (nsim, errors) of states (nsim, n) at one time [s].

        Raises:
            ArgumentError: If the law regulates outputs that are no states.
        """
        error = self.controller.designed.error
        if error.outputs is not None:
            raise ArgumentError(
                f"{self.controller.name} in {self.experiment.name} of {self.system.name} "
                "regulates outputs that are no states: take another case"
            )
        return error.along(np.full(len(states), time), states, self.controller.parameters)


def guarded(controller: Controller, system: System) -> Controller:
    """Return the controller with runs that end at the first sample outside the region.

    The Jacobian LQR is defined everywhere and could swing the pole right round; its run ends
    where those of the linearizing laws do.
    """
    return replace(controller, law=_guarded_law(controller.law, system))


# Cached since each law that is made here is compiled once.
@cache
def _guarded_law(law: Law, system: System) -> Law:
    inner = jitable(law)
    linearizable = system.linearizable

    # numba compiles the law with both functions as constants.
    def guarded_law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        inner(t, x, memory, p, u)
        if not linearizable(x):
            memory.undefined = 1.0

    return wrapped(guarded_law, law)


def outcomes(
    loop: RegionLoop, starts: Array, duration: float, looks: Sequence[float] = _LOOKS
) -> Letters:
    """Return the outcome of each start (nsim, n), as letters.

    A run ends at a look if it has left the region, met a singularity or diverged. It also ends
    there as converged if it began beyond a tolerance and is well within all of them, unless a
    disturbance could still carry it away.

    Args:
        loop: The law on its plant.
        starts: Starts.
        duration: Duration of a run that is not decided before [s].
        looks: Parts of it after which runs are judged, ending with 1.
    """
    tolerance = np.array([value for value, _ in loop.tolerances.values()])
    away = np.any(np.abs(loop.errors(0.0, starts)) > tolerance, axis=1)
    may_end_early = away & (not loop.experiment.disturbances)

    letters = np.full(len(starts), Outcome.NOT_CONVERGED.letter)
    for look in looks:
        undecided = np.flatnonzero(letters == Outcome.NOT_CONVERGED.letter)
        if not len(undecided):
            break
        last = look == looks[-1]
        bound = tolerance if last else _EARLY * tolerance
        runs = loop.run(starts[undecided], look * duration)
        errors = loop.errors(look * duration, runs["last"])
        ends = judge(runs["status"], errors, bound)

        decided = (ends != Outcome.CONVERGED.letter) | last | may_end_early[undecided]
        letters[undecided[decided]] = ends[decided]
    return letters
