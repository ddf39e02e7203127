"""Exported laws on emulated processors of controllers: the same numbers, and what a call costs."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from test_export import LAWS, SWITCHED, law_of
from test_export_loop import law_in

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.export.compiler import RunningLaw, compile_law, find_compiler, write_law
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

each_processor = pytest.mark.parametrize("name", ["cortex-m4", "cortex-m7"])
STATES = 60


def inputs(law: LawInC, running: RunningLaw, runs: list[Array]) -> Array:
    ends = [False] * sum(map(len, runs))
    return np.array([answer.u for answer in c_answers(law, running, runs, ends)])


@each_processor
@pytest.mark.parametrize(("target", "law", "settings"), [*LAWS, *SWITCHED])
def test_a_processor_gives_the_numbers_of_the_python_law(
    target: str, law: str, settings: dict[str, str], name: str, tmp_path: Path
) -> None:
    """To the last bit; where the law calls sin, exp and the like, up to their rounding."""
    in_c = law_of(target, law, **settings)
    runs = random_runs(Experiment.load(target).x0, STATES)
    with emulated_law(in_c, PROCESSORS[name], tmp_path) as emulated:
        compared = compare_at_samples(in_c, emulated, runs)
        assert compared.samples >= STATES
        if not library_functions(in_c):
            assert compared.different == 0
            return

        u = inputs(in_c, emulated, runs[:1])
    folder = tmp_path / "host"
    folder.mkdir()
    write_law(in_c, folder)
    compiler = find_compiler()
    assert compiler is not None
    on_host = inputs(in_c, compile_law(in_c, folder, compiler), runs[:1])
    # The last bit of a function, times the condition of the law's equations.
    size = np.abs(on_host).max()
    np.testing.assert_allclose(u, on_host, rtol=1e-11, atol=1e-12 * size)


@each_processor
@pytest.mark.parametrize(("loop", "predict"), [("eso", True), ("kalman", False), ("delay", True)])
def test_software_of_a_loop_runs_on_a_processor(loop: str, predict: bool, name: str) -> None:
    experiment, law = law_in(loop, predict=predict)
    on = on_processor(experiment, law, name)
    assert on.proof.equal, on.words
    assert on.proof.samples == 300


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


def test_a_long_computing_time_is_a_delay_of_the_loop() -> None:
    """The bench keeps its requirements with a tick more delay, and not with forty."""
    experiment = Experiment.load("servo/bench")
    law = law_of("servo/bench", "lqr")
    timestep = experiment.settings.timestep
    assert computing_delay(experiment, 0.4 * timestep) == timestep
    kept = dict.fromkeys((timestep, 400 * timestep), True)
    for delay in kept:
        kept[delay] = all(j.kept for j in judged_with_delay(experiment, law, delay))
    assert list(kept.values()) == [True, False]


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
    command = ["arm-none-eabi-gcc", *flags, "-Werror", "-c", "main.c", "servo_case1_grosmc.c"]
    subprocess.run(command, cwd=tmp_path, check=True)
