"""Proof that an exported law is the Python law: both run the same simulations."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.experiments.experiment import Experiment, run_on
from grosmc_mj.experiments.file.reading import read_case_file
from grosmc_mj.experiments.file.shipped import campaign_files
from grosmc_mj.experiments.requirements.judging import Judgement, judge_runs
from grosmc_mj.export.compiler import RunningLaw
from grosmc_mj.export.in_simulation import (
    LawInSimulation,
    answers_of,
    compared_places,
    in_simulation,
    remembered_by,
)
from grosmc_mj.export.law import LawInC
from grosmc_mj.export.samples import c_answers, compare_at_samples, random_runs, unequal_bits
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.wording import counted, counted_of, unit_after
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.studies.sweep.family import family_of, random_points
from grosmc_mj.studies.sweep.quantities import with_values
from grosmc_mj.studies.sweep.runs import plant_of
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import Plant

# States at which a law alone is sampled.
RANDOM_STATES = 1000
# Random plants of a batch: the trajectories of all of them are in memory.
_BATCH = 25
# Random plants of a law with its loop, which runs in the Python engine.
RANDOM_LOOPS = 5
_SEED = 1


class Difference(NamedTuple):
    """Difference of an input by two laws.

    Attributes:
        value: Magnitude, in the unit of the input.
        unit: That unit.
        time: Instant [s].
        place: Plant on which it was.
    """

    value: float
    unit: str
    time: float
    place: str


class Verdict(NamedTuple):
    """A requirement that both laws were judged by.

    Attributes:
        python: Judgement of the Python law.
        in_c: Judgement of the C.
    """

    python: Judgement
    in_c: Judgement


@dataclass
class Proof:
    """Comparison of an exported law with the Python law.

    Attributes:
        timestep: Timestep of the runs [s].
        stride: Timesteps in a control period.
        places: Places in the law's memory, flat, that the C remembers.
        samples: Samples of both laws that were compared.
        different: Samples in which inputs, memory or states differ in any bit.
        runs: Runs of the case.
        random_plants: Runs on random plants.
        random_states: Samples of the law alone at random states.
        blind: Whether no changed digit of the C was noticed.
        largest: Largest difference of an input; None where all are equal.
        early_end: Words on the last run that one of the laws ended earlier; empty if there is none.
        verdicts: Verdicts on the runs of the case.
    """

    timestep: float
    stride: int
    places: Sequence[int]
    samples: int = 0
    different: int = 0
    runs: int = 0
    random_plants: int = 0
    random_states: int = 0
    blind: bool = False
    largest: Difference | None = None
    early_end: str = ""
    verdicts: Sequence[Verdict] = ()

    @property
    def equal(self) -> bool:
        """Whether all samples are equal to the last bit."""
        return self.different == 0

    @property
    def overturned(self) -> list[Verdict]:
        """Requirements that one law keeps and the other does not."""
        return [verdict for verdict in self.verdicts if verdict.python.kept != verdict.in_c.kept]

    @property
    def words(self) -> str:
        """The result in a sentence."""
        runs = f"{counted(self.runs, 'run')} of the case"
        if self.random_plants:
            runs += f", {counted(self.random_plants, 'random plant')}"
        if self.random_states:
            runs += f", {counted(self.random_states, 'random state')}"
        samples = counted(self.samples, "sample")
        if self.blind:
            return f"not proven: a changed digit is not noticed in {samples}, {runs}"
        if self.equal:
            return f"equal to the last bit in {samples}, {runs}"
        different = counted_of(self.different, self.samples, "sample", "differs", "differ")
        text = f"{different}, {runs}"
        largest = self.largest
        if largest is not None and not largest.value:
            text += "; all inputs are equal"
        elif largest is not None:
            text += (
                f"; the input by at most {largest.value:.3g}{unit_after(largest.unit)}, at "
                f"{largest.time:g} s on {largest.place}"
            )
        if self.early_end:
            text += f"; {self.early_end}"
        return text

    def add(self, python: Trajectory, in_c: Trajectory, place: str) -> None:
        """Compare two runs of the same simulation.

        Args:
            python: Run of the Python law.
            in_c: Run of the C.
            place: Plant on which they ran.
        """
        ends = (float(python.valid_until), float(in_c.valid_until))
        first, last = sorted(round(end / self.timestep) for end in ends)
        rows = slice(0, first, self.stride)
        unequal = _unequal(python.command[rows], in_c.command[rows])
        unequal |= _unequal(python.state[rows], in_c.state[rows])
        # The Python law would have ended the run with another answer.
        unequal |= answers_of(in_c)[rows] != 0
        memory = np.ascontiguousarray(python.memory[rows])
        numbers = memory.view(np.float64).reshape(len(memory), memory.dtype.itemsize // 8)
        remembered = numbers[:, self.places]
        unequal |= _unequal(remembered, remembered_by(in_c)[rows])

        # Samples that only one of them made.
        further = len(range(0, last, self.stride)) - len(unequal)
        self.samples += len(unequal) + further
        self.different += int(unequal.sum()) + further
        if further:
            ended = "Python" if ends[0] < ends[1] else "C"
            self.early_end = f"{ended} ends its run at {min(ends):g} s on {place}"
        if unequal.any():
            self._note_largest(python, in_c, rows, place)

    def _note_largest(self, python: Trajectory, in_c: Trajectory, rows: slice, place: str) -> None:
        """Keep the largest difference of an input so far."""
        inputs = python.system.inputs
        shape = (-1, len(inputs))
        difference = np.abs(python.command - in_c.command)[rows].reshape(shape)
        # An input that is not finite ends a run: the difference is in memory or states.
        difference = np.nan_to_num(difference, nan=0.0)
        row, column = np.unravel_index(np.argmax(difference), difference.shape)
        time = float(python.time[rows][row])
        value = float(difference[row, column])
        if self.largest is None or value > self.largest.value:
            self.largest = Difference(value, inputs[int(column)].unit, time, place)


def _unequal(a: Array, b: Array) -> Any:
    """Whether rows differ in any bit, (N,)."""
    unequal = unequal_bits(a, b)
    return unequal.any(axis=tuple(range(1, unequal.ndim)))


def prove(
    experiment: Experiment,
    law: LawInC,
    compiled: RunningLaw,
    plants: int = 1000,
    advance: Callable[[str, int], None] = lambda text, by: None,
    changed: Iterable[RunningLaw] = (),
) -> Proof:
    """Run an exported law beside the Python law.

    A law alone is sampled at random states, too. A law with its loop runs in the Python engine,
    where the C gets what is measured in place of the state that the Python software has estimated.

    Args:
        experiment: The case; its runs on each plant are compared, and judged.
        law: The export.
        compiled: The same, compiled.
        plants: Number of random plants, of the case's ``[[uncertain]]`` tables or else of the
            system's campaign.
        advance: Told the progress: text and number of runs.
        changed: The export with one digit changed, each time of another number: one of them must
            differ; none for no such check.

    Returns:
        The comparison.

    Raises:
        ArgumentError: If no run of the case gets beyond its start.
    """
    settings = experiment.settings
    stride = round(settings.control_period / settings.timestep)
    proof = Proof(settings.timestep, stride, compared_places(law))
    in_c = in_simulation(law, compiled)
    proof.verdicts = _prove_on_case(proof, experiment, law, in_c, advance)
    if not proof.samples:
        raise ArgumentError(
            f"{law.controller.name}: no sample to compare: each run of the case ends at its start, "
            "where the law is not defined: start elsewhere"
        )

    if law.loop is None:
        _prove_at_random_states(proof, experiment, law, compiled)
    proof.blind = _is_blind(experiment, law, compiled, changed)

    uncertain = uncertain_experiment(experiment)
    if uncertain is None:
        return proof
    for first in range(0, plants, _BATCH):
        count = min(_BATCH, plants - first)
        _prove_on_random_plants(proof, uncertain, law, in_c, range(first, first + count))
        advance(f"{law.controller.name} on random plants", count)
    return proof


def _prove_on_case(
    proof: Proof,
    experiment: Experiment,
    law: LawInC,
    in_c: LawInSimulation,
    advance: Callable[[str, int], None],
) -> list[Verdict]:
    """Compare the runs of the case, and judge them."""
    verdicts: list[Verdict] = []
    for name in experiment.plant_names:
        plant = experiment.plant(name)
        loop = _loop_around(experiment, law, experiment, experiment.run_number)
        python = run_on(experiment, name, law.controller, plant, loop)
        compiled = run_on(experiment, name, in_c.controller, plant, in_c.loop or loop)
        proof.runs += 1
        proof.add(python.trajectory, compiled.trajectory, name)
        judgements = [judge_runs(experiment.limits, [run]) for run in (python, compiled)]
        verdicts += map(Verdict, *judgements)
        advance(f"{law.controller.name} on {name}", 1)
    return verdicts


def _prove_at_random_states(
    proof: Proof, experiment: Experiment, law: LawInC, compiled: RunningLaw
) -> None:
    """Compare the laws alone at random states."""
    compared = compare_at_samples(law, compiled, random_runs(experiment.x0, RANDOM_STATES))
    proof.random_states = compared.samples
    proof.samples += compared.samples
    proof.different += compared.different


def _is_blind(
    experiment: Experiment, law: LawInC, compiled: RunningLaw, changed: Iterable[RunningLaw]
) -> bool:
    """Whether samples tell none of the changed exports from the right one; False for no export."""
    right = None
    for other in changed:
        if right is None:
            right = _written(experiment, law, compiled)
        numbers = _written(experiment, law, other)
        # A run that ends early has fewer.
        if numbers.shape != right.shape or unequal_bits(numbers, right).any():
            return False
    return right is not None


def _written(experiment: Experiment, law: LawInC, version: RunningLaw) -> Array:
    """Return all numbers that an export writes, one after the other.

    A law alone is sampled at random states, one with its loop in the case's first run.
    """
    if law.loop is None:
        runs = random_runs(experiment.x0, RANDOM_STATES)
        ends = [False] * sum(map(len, runs))
        answers = c_answers(law, version, runs, ends)
        return np.concatenate([[item.code, *item.memory, *item.u] for item in answers])

    name = next(iter(experiment.plant_names))
    in_c = in_simulation(law, version)
    run = run_on(experiment, name, in_c.controller, experiment.plant(name), in_c.loop)
    return np.ravel(run.trajectory.command)


def _prove_on_random_plants(
    proof: Proof,
    uncertain: Experiment,
    law: LawInC,
    in_c: LawInSimulation,
    numbers: range,
) -> None:
    """Compare the runs on random plants of these numbers."""
    cases, plants = _random_plants(uncertain, numbers)
    loops = []
    for number, case in zip(numbers, cases, strict=True):
        loops.append(_loop_around(uncertain, law, case, number))
    python = _simulated(uncertain, cases, plants, law.controller, loops)
    own_loops = [in_c.loop or loop for loop in loops]
    compiled = _simulated(uncertain, cases, plants, in_c.controller, own_loops)
    for run in range(len(cases)):
        proof.random_plants += 1
        proof.add(python[run], compiled[run], f"random plant {proof.random_plants}")


def uncertain_experiment(experiment: Experiment) -> Experiment | None:
    """Return the experiment whose ``[[uncertain]]`` tables random plants are drawn from.

    It is the case's own, or else that of the system's campaign; None without any.
    """
    if experiment.file.uncertain:
        return experiment
    path = campaign_files().get(experiment.system)
    if path is None:
        return None
    settings = experiment.settings
    of_campaign = Experiment.of_file(read_case_file(path), path)
    return of_campaign.changed(control_period=settings.control_period, timestep=settings.timestep)


def _random_plants(uncertain: Experiment, numbers: range) -> tuple[list[Experiment], list[Plant]]:
    """Random cases of an experiment with ``[[uncertain]]`` tables, and their plants."""
    nominal = uncertain.plant(uncertain.nominal.truest)
    family = family_of(uncertain.file, uncertain)
    points = random_points(len(family.quantities), _SEED, numbers.start, len(numbers))
    rows = family.values(points).tolist()
    cases = [with_values(uncertain, zip(family.quantities, row, strict=True)) for row in rows]
    return cases, [plant_of(case, nominal) for case in cases]


def _loop_around(experiment: Experiment, law: LawInC, case: Experiment, run: int) -> Any:
    """The loop of a case around a law: of an export with its loop that one; None for an ideal one.

    Args:
        experiment: The case, or the campaign, that tells whether the law predicts.
        law: The export.
        case: The case with the loop.
        run: Number of the run, of which the loop's noise is.
    """
    if law.loop is not None:
        # Its numbers stand in the C.
        return law.loop
    if case.loop is None:
        return None
    name = law.controller.name
    predict = name in experiment.controllers and experiment.predicts(name)
    return experiment.loop_around(law.controller, case.loop, predict=predict, run=run)


def _simulated(
    experiment: Experiment,
    cases: Sequence[Experiment],
    plants: Sequence[Plant],
    controller: Controller,
    loops: Sequence[Any],
) -> Trajectory:
    """Runs of one law as a batch."""
    settings = experiment.settings
    return simulate(
        list(plants),
        controller,
        np.array([case.x0 for case in cases]),
        duration=experiment.duration,
        loop=list(loops),
        control_period=settings.control_period,
        timestep=settings.timestep,
        disturbances=[list(case.disturbances) for case in cases],
        engine=settings.engine_for(controller),
    )
