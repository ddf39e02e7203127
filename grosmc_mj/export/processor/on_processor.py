"""Proof and cost of an exported law on a processor, and the case with its computing time."""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from grosmc_mj.experiments.experiment import Experiment, run_on
from grosmc_mj.experiments.requirements.judging import Judgement, judge_runs
from grosmc_mj.export.law import LawInC
from grosmc_mj.export.processor.emulated import Size, emulated_law
from grosmc_mj.export.processor.processors import PROCESSORS, Processor
from grosmc_mj.export.proof import Proof, prove
from grosmc_mj.simulation.loop import Loop

# Functions of the C library whose last digit depends on the library.
_ROUNDED = ("sin", "cos", "tan", "exp", "log", "pow", "atan2", "sinh", "cosh", "tanh", "fmod")
# Computing time in control periods below which it is no part of the loop.
_SMALL = 0.05


@dataclass(frozen=True)
class OnProcessor:
    """An exported law on a processor.

    Attributes:
        processor: The processor.
        proof: Comparison of its samples with the Python law.
        size: Its code and data.
        memory: Memory of the law, of its caller [bytes].
        stack: Largest depth of the stack [bytes].
        mean: Mean of the instructions of a call.
        most: Most of them.
        functions: Functions of the C library that it calls and that may round otherwise.
        period: Control period [s].
        clock: Clock of the processor [Hz]; None if it is not known.
        delayed: Judgements of the case with the computing time as further delay of its computer;
            empty if the time is small, or no clock is known.
        delay: That delay [s].
    """

    processor: Processor
    proof: Proof
    size: Size
    memory: int
    stack: int
    mean: float
    most: float
    functions: Sequence[str]
    period: float
    clock: float | None = None
    delayed: Sequence[Judgement] = ()
    delay: float = 0.0

    @property
    def seconds(self) -> float | None:
        """Estimated longest time of a call, an instruction a cycle [s]; None without a clock."""
        return None if self.clock is None else self.most / self.clock

    @property
    def lost(self) -> list[Judgement]:
        """Requirements that the case keeps without the computing time and not with it."""
        kept = set()
        for verdict in self.proof.verdicts:
            if verdict.python.kept:
                kept.add((verdict.python.plant, verdict.python.requirement.words))
        return [
            judged
            for judged in self.delayed
            if not judged.kept and (judged.plant, judged.requirement.words) in kept
        ]

    @property
    def words(self) -> str:
        """The comparison in a sentence."""
        words = f"{self.proof.words}, on {self.processor.title}"
        if not self.proof.equal and self.functions:
            words += f"; its C library rounds {' and '.join(self.functions)} otherwise"
        return words


def on_processor(
    experiment: Experiment,
    law: LawInC,
    name: str,
    clock: float | None = None,
    advance: Callable[[str, int], None] = lambda text, by: None,
) -> OnProcessor:
    """Run an exported law on an emulated processor, beside the Python law.

    The law's answers close the loop of the case's runs, which the Python engine makes; a law alone
    is sampled at random states, too.

    Args:
        experiment: The case.
        law: The export.
        name: Name of the processor, one of ``PROCESSORS``.
        clock: Clock of the processor [Hz], for an estimate of the time.
        advance: Told the progress: text and number of runs.

    Raises:
        SetupError: If a tool is missing, or the law does not compile.
    """
    processor = PROCESSORS[name]
    with (
        tempfile.TemporaryDirectory() as folder,
        emulated_law(law, processor, Path(folder)) as emulated,
    ):
        proof = prove(experiment, law, emulated, 0, advance)
        result = OnProcessor(
            processor,
            proof,
            emulated.size,
            len(law.memory.places) * (4 if law.real == "float" else 8),
            emulated.stack,
            float(np.mean(emulated.instructions)),
            max(emulated.instructions),
            library_functions(law),
            law.period,
            clock,
        )
    seconds = result.seconds
    if seconds is None or seconds < _SMALL * law.period:
        return result
    delay = computing_delay(experiment, seconds)
    return replace(result, delay=delay, delayed=judged_with_delay(experiment, law, delay))


def library_functions(law: LawInC) -> list[str]:
    """Return the functions of the C library that a law calls and that libraries round otherwise."""
    called = set(re.findall(r"\b(\w+?)f?_?\(", law.source))
    return [name for name in _ROUNDED if name in called]


def computing_delay(experiment: Experiment, seconds: float) -> float:
    """Return a computing time as the case's timesteps take it: the next whole number of them [s].

    Args:
        experiment: The case.
        seconds: The time [s].
    """
    timestep = experiment.settings.timestep
    return math.ceil(seconds / timestep) * timestep


def judged_with_delay(experiment: Experiment, law: LawInC, delay: float) -> list[Judgement]:
    """Judge the case with a further delay of its computer.

    Args:
        experiment: The case.
        law: The export, whose Python law runs.
        delay: The delay, a whole number of timesteps [s].
    """
    own = experiment.loop or Loop()
    computing = replace(own.computing, delay=own.computing.delay + delay)
    slower = replace(own, computing=computing)
    delayed = experiment.changed(loop=slower)
    name = law.controller.name
    predict = name in experiment.controllers and experiment.predicts(name)
    judgements: list[Judgement] = []
    for plant in delayed.plant_names:
        loop = delayed.loop_around(law.controller, slower, predict=predict)
        run = run_on(delayed, plant, law.controller, delayed.plant(plant), loop)
        judgements += judge_runs(delayed.limits, [run])
    return judgements
