"""grosmc-mj export."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import KW_ONLY, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.answering import AnsweringCommand, Question
from grosmc_mj.cli.command import Flag, Out, Target, WholeNumber, command
from grosmc_mj.cli.targets import result_name, shown_experiment
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError, SetupError, placed
from grosmc_mj.ground.files import name_in_files

if TYPE_CHECKING:
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.export.law import LawInC
    from grosmc_mj.export.processor.on_processor import OnProcessor
    from grosmc_mj.export.proof import Proof
    from grosmc_mj.output.results.result import Result


@command
class ExportCommand(AnsweringCommand):
    """Write a law of a case as C99, and prove that it is the same law.

    NAME.h and NAME.c need nothing but the C library: no allocation, NAME_init and NAME_step, a
    structure of what the law remembers and a constant one of its numbers, with their units.

    With a C compiler the law is compiled here and run in place of the Python law, on each plant of
    the case, on random plants of its [[uncertain]] tables (or of the system's campaign) and at
    random states: it is equal to the last bit, or the largest difference is told, and the verdicts
    under both. Of copies with one number changed (40 at most) one must differ, or nothing is
    proven. Without a compiler the C is not proven, and says so.

    With --fmu the same C is packed as a source FMU (FMI 2.0, co-simulation), too.

    With --on the C also runs on an emulated processor of Arm, in the place of the Python law: its
    answers are compared, its instructions, code and stack are counted. With the processor's --clock
    the time of a call is estimated; if it is not small, the case is judged once more with it as a
    further delay.

    With --loop the C has the estimators, the filter and the prediction of the case's loop too, and
    gets what is measured.

    Exit code: 0 if no verdict differs, or without a compiler; 1 if one differs, or if in double
    precision a bit does on this machine, or if the case is not kept with the computing time; 2 if
    the law has no C.

    Attributes:
        target: A system, of which it is case1, a case (SYSTEM/CASE) or a case file (FILE.toml).
        law: A law that grosmc-mj list shows, or a law of the file.
        float32: In single precision; the proof tells what that changes.
        loop: With the software of the case's loop.
        fmu: As an FMU, too.
        plants: Number of random plants.
        on: Processor to run it on, too.
        clock: Clock of that processor, such as "168 MHz".
        out: Folder for the files.
    """

    target: Target
    _: KW_ONLY
    law: Annotated[str, Parameter(metavar="NAME")]
    float32: Flag = False
    loop: Flag = False
    fmu: Flag = False
    plants: Annotated[
        WholeNumber | None,
        Parameter(show_default="1000, with --loop 5"),
    ] = None
    on: Annotated[str | None, Parameter(metavar="cortex-m4|cortex-m7|cortex-m33")] = None
    clock: Annotated[str | None, Parameter(metavar="TEXT", show_default="none")] = None
    out: Out = Path("renders")

    def questions(self) -> Sequence[Question]:
        """Return the one question of the law."""
        if self.plants is not None and self.plants < 0:
            raise ArgumentError(f"--plants {self.plants} must not be below 0")
        self._require_processor()
        experiment = shown_experiment(self.target)
        return [_ExportQuestion(self, experiment, self._exported(experiment))]

    def _require_processor(self) -> None:
        """Refuse a processor that cannot be run on, before all work.

        Raises:
            ArgumentError: If it is not known, or a clock is given without one.
            SetupError: If a tool is missing.
        """
        from grosmc_mj.export.processor.emulated import missing_tools
        from grosmc_mj.export.processor.processors import PROCESSORS

        if self.on is None:
            if self.clock is not None:
                raise ArgumentError(f"--clock {self.clock} is of a processor: name it with --on")
            return
        require_known("--on", self.on, PROCESSORS)
        _ = self.frequency
        missing = missing_tools()
        if missing:
            raise SetupError(f"--on {self.on}: {missing}")

    @property
    def frequency(self) -> float | None:
        """Clock of the processor [Hz]; None if it is not given.

        Raises:
            ArgumentError: If it is no positive frequency.
        """
        from grosmc_mj.ground.units import typed_number

        if self.clock is None:
            return None
        try:
            turns = typed_number(self.clock, "rad/s")
        except ArgumentError:
            turns = math.nan
        if not turns > 0:
            raise ArgumentError(f'--clock {self.clock} must be a frequency, such as "168 MHz"')
        return turns / (2 * math.pi)

    def _exported(self, experiment: Experiment) -> LawInC:
        """Return the law in C, without a word on its proof.

        Raises:
            ArgumentError: If there is no such law, or it has no C.
        """
        import numpy as np

        from grosmc_mj.experiments.file.user_code import blamed
        from grosmc_mj.export.c_names import c_prefix
        from grosmc_mj.export.law import LawInC
        from grosmc_mj.simulation.law_inputs import require_answer

        controller = experiment.law(experiment.nominal.truest, self.law)
        name = f"{result_name(experiment.path)}_{name_in_files(self.law)}"
        applied = None
        if self.loop:
            applied = experiment.applied_loop(experiment.nominal.truest, self.law)
            if applied is None:
                raise ArgumentError(f"{experiment.path}: --loop: the case has no loop")
        law = LawInC(
            controller=controller,
            name=c_prefix(name),
            system=experiment.nominal.system,
            period=experiment.settings.control_period,
            real="float" if self.float32 else "double",
            loop=applied,
        )
        # A law that cannot be written in C, or has no answer, is refused before anything runs.
        _ = law.source
        with placed(f"{experiment.path}: "), blamed(experiment.path.parent):
            require_answer(controller, np.array(experiment.x0), len(law.system.inputs))
        return law


class _ExportQuestion(Question):
    """Is the law in C the same law?"""

    def __init__(self, command: ExportCommand, experiment: Experiment, law: LawInC) -> None:
        self.path = command.out / f"export_{law.name}.json"
        self._command = command
        self._experiment = experiment
        self._law = law
        self._proof: Proof | None = None
        self._on: OnProcessor | None = None
        self._written: list[Path] = []

    @property
    def files(self) -> Sequence[Path]:
        """The files of the law."""
        suffixes = [".h", ".c", *[".fmu"] * self._command.fmu]
        return [self._command.out / f"{self._law.name}{suffix}" for suffix in suffixes]

    def measure(self) -> None:
        """Prove the law, and write it with its proof."""
        from grosmc_mj.export.answer import NOT_PROVEN, about
        from grosmc_mj.export.compiler import write_law
        from grosmc_mj.export.fmu import write_fmu

        self._proof = self._proven()
        self._on = self._run_on_processor()
        words = NOT_PROVEN if self._proof is None else self._proof.words
        law = self._law
        text = about(self._experiment, law.controller, words, law.real)
        self._law = replace(law, about=text)
        self._written = [*write_law(self._law, self._command.out)]
        if self._command.fmu:
            self._written.append(write_fmu(self._law, self._experiment.x0, self._command.out))

    def _proven(self) -> Proof | None:
        """Run the law beside the Python law; None without a compiler."""
        from grosmc_mj.export.changed_digit import compile_changed
        from grosmc_mj.export.compiler import compile_law, find_compiler, write_law
        from grosmc_mj.export.proof import RANDOM_LOOPS, prove, uncertain_experiment

        compiler = find_compiler()
        if compiler is None:
            return None
        plants = self._command.plants
        if plants is None:
            plants = RANDOM_LOOPS if self._command.loop else 1000
        if uncertain_experiment(self._experiment) is None:
            plants = 0
        law = self._law
        with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as other:
            write_law(law, Path(folder))
            compiled = compile_law(law, Path(folder), compiler)
            changed = compile_changed(law, Path(other), compiler)
            with screen.progress(len(self._experiment.plant_names) + plants) as advance:
                return prove(self._experiment, law, compiled, plants, advance, changed)

    def _run_on_processor(self) -> OnProcessor | None:
        """Run the law on the processor that is asked for."""
        from grosmc_mj.export.processor.on_processor import on_processor

        command = self._command
        if command.on is None:
            return None
        with screen.progress(len(self._experiment.plant_names)) as advance:
            return on_processor(self._experiment, self._law, command.on, command.frequency, advance)

    def result(self, *, complete: bool) -> Result | None:
        """Return the proof, once the law is written."""
        from grosmc_mj.export.answer import export_result

        if not complete:
            return None
        return export_result(self._experiment, self._law, self._proof, self._on)

    def close(self) -> None:
        """Print the files of the law."""
        screen.say_files(screen.console(), *self._written)

    @property
    def kept(self) -> bool:
        """Whether no verdict differs and, in double precision, no bit."""
        on = self._on
        if on is not None and (on.proof.overturned or on.lost):
            return False
        proof = self._proof
        if proof is None:
            return True
        proven = proof.equal or self._law.real != "double"
        return proven and not proof.blind and not proof.overturned
