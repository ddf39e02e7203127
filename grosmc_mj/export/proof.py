"""Proof that an exported law is the Python law: both run the same simulations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.experiment import Experiment, experiment_without_designs, run_on
from grosmc_mj.experiments.file.reading import read_case_file
from grosmc_mj.experiments.file.shipped import campaign_files
from grosmc_mj.export.compiler import CompiledLaw
from grosmc_mj.export.law_in_simulation import controller_in_c
from grosmc_mj.export.loop import LoopInC
from grosmc_mj.export.loop_in_simulation import run_in_loop
from grosmc_mj.physics.hooks import warnings_counted_only
from grosmc_mj.plants import Plant
from grosmc_mj.requirements.judging import Judgement, judge_runs
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.simulation.python_engine import run_python
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.sweep.family import family_of, random_points
from grosmc_mj.sweep.parameters import plant_of, with_values

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
        samples: Samples of both laws that were compared.
        different: Samples in which inputs, memory or states differ in any bit.
        runs: Runs of the case.
        random_plants: Runs on random plants.
        largest: Largest difference of an input; None where all are equal.
        verdicts: Verdicts on the runs of the case.
    """

    samples: int = 0
    different: int = 0
    runs: int = 0
    random_plants: int = 0
    largest: Difference | None = None
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
        runs = f"{self.runs} runs of the case and {self.random_plants} random plants"
        if self.equal:
            return f"equal to the last bit in {self.samples} samples, {runs}"
        text = f"{self.different} of {self.samples} samples differ, {runs}"
        if self.largest is not None:
            largest = self.largest
            text += (
                f"; the input by at most {largest.value:.3g} {largest.unit}, at "
                f"{largest.time:g} s on {largest.place}"
            )
        return text

    def add(self, python: Trajectory, in_c: Trajectory, stride: int, place: str) -> None:
        """Compare two runs of the same simulation.

        Args:
            python: Run of the Python law.
            in_c: Run of the C.
            stride: Timesteps in a control period.
            place: Plant on which they ran.
        """
        period = python.time[1] - python.time[0]
        valid = round(float(python.valid_until) / period)
        rows = slice(0, valid, stride)
        unequal = _unequal(python.command[rows], in_c.command[rows])
        unequal |= _unequal(python.state[rows], in_c.state[rows])
        names = python.memory.dtype.names
        assert names is not None
        for name in names:
            unequal |= _unequal(python.memory[name][rows], in_c.memory[name][rows])

        self.samples += len(unequal)
        self.different += int(unequal.sum())
        if unequal.any():
            self._note_largest(python, in_c, rows, place)

    def _note_largest(self, python: Trajectory, in_c: Trajectory, rows: slice, place: str) -> None:
        """Keep the largest difference of an input so far."""
        inputs = python.system.inputs
        shape = (-1, len(inputs))
        difference = np.abs(python.command - in_c.command)[rows].reshape(shape)
        row, column = np.unravel_index(np.nanargmax(difference), difference.shape)
        time = float(python.time[rows][row])
        value = float(difference[row, column])
        self.note(Difference(value, inputs[int(column)].unit, time, place))

    def note(self, difference: Difference) -> None:
        """Keep a difference if it is the largest so far."""
        if self.largest is None or difference.value > self.largest.value:
            self.largest = difference


def _unequal(a: Array, b: Array) -> Any:
    """Whether rows differ in any bit, (N,); NaN is equal to itself."""
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    return ~same.reshape(len(same), -1).all(axis=1)


def prove(
    experiment: Experiment,
    python: Controller,
    compiled: CompiledLaw,
    plants: int = 1000,
    advance: Callable[[str, int], None] = lambda text, by: None,
) -> Proof:
    """Run an exported law beside the Python law.

    Args:
        experiment: The case; its runs on each plant are compared, and judged.
        python: The controller, with its control period in its parameters.
        compiled: Its law in C.
        plants: Number of random plants, of the case's ``[[uncertain]]`` tables or else of the
            system's campaign.
        advance: Told the progress: text and number of runs.

    Returns:
        The comparison.
    """
    proof = Proof()
    stride = round(experiment.settings.control_period / experiment.settings.timestep)
    verdicts: list[Verdict] = []
    controllers = python, controller_in_c(python, compiled)
    for plant_name in experiment.plant_names:
        plant = experiment.plant(plant_name)
        runs = []
        for controller in controllers:
            loop = _loop_around(experiment, experiment, controller, experiment.run_number)
            runs.append(run_on(experiment, plant_name, controller, plant, loop))
        proof.runs += 1
        proof.add(runs[0].trajectory, runs[1].trajectory, stride, plant_name)
        judgements = [judge_runs(experiment.limits, [run]) for run in runs]
        verdicts += map(Verdict, *judgements)
        advance(f"{python.name} on {plant_name}", 1)
    proof.verdicts = verdicts

    for first in range(0, plants, _BATCH):
        count = min(_BATCH, plants - first)
        for pair in _random_runs(experiment, controllers, first, count):
            proof.random_plants += 1
            proof.add(*pair, stride, f"random plant {proof.random_plants}")
        advance(f"{python.name} on random plants", count)
    return proof


def prove_loop(
    experiment: Experiment,
    law: LoopInC,
    compiled: CompiledLaw,
    plants: int = RANDOM_LOOPS,
    advance: Callable[[str, int], None] = lambda text, by: None,
) -> Proof:
    """Run an exported law with its loop beside the Python law in its loop.

    It runs in the Python engine, where the C gets what is measured in place of the state that
    the Python software has estimated.

    Args:
        experiment: The case.
        law: The export.
        compiled: The same, compiled.
        plants: Number of random plants.
        advance: Told the progress: text and number of runs.

    Returns:
        The comparison, without verdicts: equal runs have equal ones.
    """
    proof = Proof()
    for name in experiment.plant_names:
        _compare_in_loop(proof, experiment, experiment.plant(name), law, compiled, name)
        proof.runs += 1
        advance(f"{law.controller.name} on {name}", 1)

    uncertain = uncertain_experiment(experiment)
    if uncertain is None or not plants:
        return proof
    cases, true_plants = _random_plants(uncertain, 0, plants)
    for case, plant in zip(cases, true_plants, strict=True):
        # The loop is the exported one: its numbers stand in the C.
        case = replace(case, loop=experiment.loop, known_loop=experiment.known_loop)
        proof.random_plants += 1
        place = f"random plant {proof.random_plants}"
        _compare_in_loop(proof, case, plant, law, compiled, place)
        advance(f"{law.controller.name} on random plants", 1)
    return proof


def _compare_in_loop(
    proof: Proof, case: Case, plant: Plant, law: LoopInC, compiled: CompiledLaw, place: str
) -> None:
    """Compare the runs of a law and of its export on one plant of a case."""
    settings = case.settings
    problem, _ = prepare(
        plant,
        law.controller,
        case.x0,
        loop=law.loop,
        duration=case.duration,
        control_period=settings.control_period,
        timestep=settings.timestep,
        disturbances=list(case.disturbances),
    )
    with np.errstate(all="ignore"), warnings_counted_only():
        python = run_python(problem)
        in_c = run_in_loop(problem, law, compiled)

    rows = min(int(python.valid[0]), int(in_c.valid[0]))
    unequal = _unequal(python.rows[0, :rows], in_c.rows[0, :rows])
    proof.samples += rows // problem.stride
    proof.different += -(-int(unequal.sum()) // problem.stride)
    if python.status[0] != in_c.status[0] or python.valid[0] != in_c.valid[0]:
        proof.different += 1
    if unequal.any():
        columns = problem.columns["command"]
        commands = np.abs(python.rows[0, :rows, columns] - in_c.rows[0, :rows, columns])
        row, column = np.unravel_index(np.nanargmax(commands), commands.shape)
        unit = problem.system.inputs[int(column)].unit
        time = float((row - 1) * problem.timestep)
        proof.note(Difference(float(commands[row, column]), unit, time, place))


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
    of_campaign = experiment_without_designs(read_case_file(path), path)
    return of_campaign.with_settings(
        control_period=settings.control_period, timestep=settings.timestep
    )


def _random_runs(
    experiment: Experiment,
    controllers: Sequence[Controller],
    first: int,
    count: int,
) -> Iterator[tuple[Trajectory, Trajectory]]:
    """Run both laws on random plants, from the first of these numbers on."""
    uncertain = uncertain_experiment(experiment)
    if uncertain is None:
        return
    cases, true_plants = _random_plants(uncertain, first, count)
    batches = []
    for controller in controllers:
        loops = []
        for number, case in enumerate(cases):
            loops.append(_loop_around(uncertain, case, controller, first + number))
        batches.append(_simulated(uncertain, cases, true_plants, controller, loops))
    for number in range(count):
        yield batches[0][number], batches[1][number]


def _random_plants(
    uncertain: Experiment, first: int, count: int
) -> tuple[list[Experiment], list[Plant]]:
    """Random cases of an experiment with ``[[uncertain]]`` tables, and their plants."""
    nominal = uncertain.plant(uncertain.nominal.truest)
    family = family_of(uncertain.file, uncertain, nominal)
    points = random_points(len(family.quantities), _SEED, first, count)
    rows = family.values(points).tolist()
    cases = [with_values(uncertain, zip(family.quantities, row, strict=True)) for row in rows]
    return cases, [plant_of(case, nominal) for case in cases]


def _loop_around(experiment: Experiment, case: Case, controller: Controller, run: int) -> Any:
    """The loop of a case around a controller; None for an ideal one."""
    if case.loop is None:
        return None
    name = controller.name
    predict = name in experiment.controllers and experiment.predicts(name)
    return experiment.loop_around(controller, case.loop, predict=predict, run=run)


def _simulated(
    experiment: Experiment,
    cases: Sequence[Case],
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
