"""Exported laws on emulated processors of controllers: the same numbers, and what a call costs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from exported import LAWS, compiled, law_of
from test_export_loop import law_in

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.export.compiler import RunningLaw, run_compiler, write_law
from grosmc_mj.export.law import LawInC
from grosmc_mj.export.processor.emulated import emulated_law, missing_tools
from grosmc_mj.export.processor.on_processor import (
    computing_delay,
    judged_with_delay,
    library_functions,
    on_processor,
)
from grosmc_mj.export.processor.processors import PROCESSORS
from grosmc_mj.export.samples import c_answers, compare_at_samples, random_runs
from grosmc_mj.ground.arrays import Array

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(missing_tools()), reason=f"laws on a processor: {missing_tools()}"),
]

STATES = 60


def inputs(law: LawInC, running: RunningLaw, runs: list[Array]) -> Array:
    ends = [False] * sum(map(len, runs))
    return np.array([answer.u for answer in c_answers(law, running, runs, ends)])


@pytest.mark.parametrize(
    ("target", "law", "processor"),
    [
        *[(target, law, "cortex-m4") for target, law in LAWS],
        ("servo/case1", "grosmc", "cortex-m7"),
        ("two_link_arm/case1", "grosmc", "cortex-m7"),
    ],
)
def test_a_processor_gives_the_numbers_of_the_python_law(
    target: str, law: str, processor: str, tmp_path: Path
) -> None:
    """To the last bit; where the law calls sin, exp and the like, up to their rounding."""
    in_c = law_of(target, law)
    runs = random_runs(Experiment.load(target).x0, STATES)
    with emulated_law(in_c, PROCESSORS[processor], tmp_path) as emulated:
        compared = compare_at_samples(in_c, emulated, runs)
        assert compared.samples >= STATES
        if not library_functions(in_c):
            assert compared.different == 0
            return
        u = inputs(in_c, emulated, runs[:1])
    folder = tmp_path / "host"
    folder.mkdir()
    on_host = inputs(in_c, compiled(in_c, folder), runs[:1])
    # The last bit of a function, times the condition of the law's equations.
    size = np.abs(on_host).max()
    np.testing.assert_allclose(u, on_host, rtol=1e-11, atol=1e-12 * size)


@pytest.mark.parametrize(
    ("loop", "predict", "name"),
    [("eso", True, "cortex-m4"), ("kalman", False, "cortex-m7"), ("delay", True, "cortex-m4")],
)
def test_software_of_a_loop_runs_on_a_processor(loop: str, predict: bool, name: str) -> None:
    experiment, law = law_in(loop, predict=predict)
    on = on_processor(experiment, law, name)
    assert on.proof.equal, on.words
    assert on.proof.samples == 100


def test_doubles_in_software_take_ten_times_the_instructions() -> None:
    experiment = Experiment.load("servo/case1").changed(duration=0.1)
    law = law_of("servo/case1", "grosmc")
    in_software = on_processor(experiment, law, "cortex-m4")
    in_hardware = on_processor(experiment, law, "cortex-m7")
    assert 10 * in_hardware.mean < in_software.mean <= in_software.most
    assert in_hardware.size.code < in_software.size.code
    assert in_software.memory == 8 * len(law.memory.places)


def test_single_precision_runs_in_hardware_on_both() -> None:
    experiment = Experiment.load("servo/case1").changed(duration=0.1)
    law = law_of("servo/case1", "grosmc", "float")
    assert on_processor(experiment, law, "cortex-m4").most < 500


@pytest.mark.parametrize(("ticks", "kept"), [(1, True), (400, False)])
def test_a_long_computing_time_is_a_delay_of_the_loop(ticks: int, kept: bool) -> None:
    """The bench keeps its requirements with a tick more delay, and not with 400."""
    experiment = Experiment.load("servo/bench")
    law = law_of("servo/bench", "lqr")
    delay = ticks * experiment.settings.timestep
    assert computing_delay(experiment, delay - 0.6 * experiment.settings.timestep) == delay
    judged = judged_with_delay(experiment, law, delay)
    assert all(judgement.kept for judgement in judged) is kept


def test_the_main_loop_of_the_docs_compiles_for_a_processor(tmp_path: Path) -> None:
    text = Path(__file__).parents[2].joinpath("docs/export.md").read_text(encoding="utf-8")
    main = text.partition("```c\n")[2].partition("```")[0]
    functions = "void wait_for_tick(void), stop_motor(void);\n"
    functions += "void read_angle_and_speed(double x[2]), set_current(double current);\n"
    (tmp_path / "main.c").write_text(functions + main, encoding="utf-8")
    law = law_of("servo/case1", "grosmc")
    renamed = LawInC(law.controller, "servo_case1_grosmc", law.system, law.period)
    write_law(renamed, tmp_path)
    flags = [*PROCESSORS["cortex-m4"].flags, "-mthumb", "-mfloat-abi=hard", "-std=c99", "-Wall"]
    for source in ("main.c", "servo_case1_grosmc.c"):
        command = ["arm-none-eabi-gcc", *flags, "-Werror", "-c", tmp_path / source]
        assert run_compiler([*command, "-o", tmp_path / "object.o"]) == ""
