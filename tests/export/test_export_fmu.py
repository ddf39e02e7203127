"""An export as an FMU: valid, and the same law as the C in it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import COMPILER, compiled, law_of, needs_compiler
from test_export_loop import law_in

from grosmc_mj.export.compiler import FLAGS, run_compiler
from grosmc_mj.export.fmu import write_fmu
from grosmc_mj.export.law import LawInC
from grosmc_mj.ground.arrays import Array

fmpy: Any = pytest.importorskip("fmpy")
pytestmark = needs_compiler
SAMPLES = 30


def built(law: LawInC, x0: Any, folder: Path) -> Path:
    """The FMU with a library for this machine, as an importer builds it; its folder."""
    from fmpy.validation import validate_fmu

    path = write_fmu(law, x0, folder)
    assert validate_fmu(str(path)) == []
    unpacked = folder / "unpacked"
    fmpy.extract(str(path), str(unpacked))
    library = unpacked / "binaries" / fmpy.platform / f"{law.name}.so"
    library.parent.mkdir(parents=True)
    headers = Path(fmpy.__file__).parent / "c-code"
    sources = sorted((unpacked / "sources").glob("*.c"))
    command = [COMPILER, *FLAGS, "-isystem", headers, "-fPIC", "-shared", *sources]
    assert run_compiler([*command, "-o", library, "-lm"]) == ""
    return unpacked


def outputs(
    law: LawInC, unpacked: Path, signals: Mapping[str, Array], step: float, begin: float = 0.0
) -> Array:
    """First output of the FMU after each step, for inputs at the begin of each step."""
    inputs = np.zeros(SAMPLES, dtype=[(name, float) for name in ("time", *signals)])
    inputs["time"] = begin + np.arange(SAMPLES) * law.period
    for name, values in signals.items():
        inputs[name] = values
    result = fmpy.simulate_fmu(
        str(unpacked),
        start_time=begin,
        stop_time=begin + SAMPLES * law.period,
        step_size=step,
        output_interval=step,
        input=inputs,
        fmi_type="CoSimulation",
    )
    return result[law.system.inputs[0].name][1:]


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> tuple[LawInC, Path]:
    """A law without a loop, and its FMU."""
    law = law_of("servo/case1", "grosmc", "float")
    return law, built(law, np.zeros(2), tmp_path_factory.mktemp("alone"))


@pytest.mark.parametrize(("samples_a_step", "begin"), [(0.5, 0.25), (2, 0.0)])
def test_an_fmu_makes_the_samples_of_the_law(
    samples_a_step: float, begin: float, alone: tuple[LawInC, Path], tmp_path: Path
) -> None:
    """Between samples it holds its output; a step of two periods makes two samples."""
    law, unpacked = alone
    x = np.random.default_rng(1).normal(size=(SAMPLES, 2))
    if samples_a_step > 1:
        # An importer would shorten a step to a change of an input.
        x[:] = x[0]
    signals = dict(zip([state.name for state in law.system.states], x.T, strict=True))
    u = outputs(law, unpacked, signals, law.period * samples_a_step, begin)

    in_c = compiled(law, tmp_path)
    memory = np.zeros(len(law.memory.places))
    expected = np.zeros((SAMPLES, 1))
    in_c.begin(memory, x[0])
    for k in range(SAMPLES):
        in_c.step(k * law.period, x[k], memory, expected[k])
    # The last sample before the end of each step.
    ends = np.arange(1, SAMPLES / samples_a_step + 1) * samples_a_step
    last = np.ceil(ends).astype(int) - 1
    np.testing.assert_array_equal(u[: len(last)], expected[last, 0])


def test_an_fmu_ends_where_an_input_is_not_finite(alone: tuple[LawInC, Path]) -> None:
    law, unpacked = alone
    with pytest.raises(Exception, match="fmi2DoStep failed with status 3"):
        outputs(law, unpacked, {"rotor speed": np.full(SAMPLES, np.nan)}, law.period)


def test_after_a_reset_an_fmu_is_as_it_was_made(alone: tuple[LawInC, Path]) -> None:
    """Its memory begins anew, and its inputs are their start values of zero."""
    law, unpacked = alone
    about = fmpy.read_model_description(str(unpacked))
    angle, _, current = [variable.valueReference for variable in about.modelVariables]
    fmu = fmpy.fmi2.FMU2Slave(
        guid=about.guid, unzipDirectory=str(unpacked), modelIdentifier=law.name
    )

    def third_output(*inputs: int) -> float:
        fmu.setupExperiment(startTime=0.0)
        fmu.exitInitializationMode()
        fmu.setReal(inputs, [0.5] * len(inputs))
        for k in range(3):
            fmu.doStep(k * law.period, law.period)
        return fmu.getReal([current])[0]

    fmu.instantiate()
    first = third_output()
    fmu.reset()
    assert third_output(angle) != first
    fmu.reset()
    assert third_output() == first
    fmu.freeInstance()


def test_an_fmu_of_a_loop_reads_what_sensors_measure(tmp_path: Path) -> None:
    _, law = law_in("unsettled", predict=True)
    y = np.linspace(0.0, 0.1, SAMPLES)
    start = np.array([0.0, 1.0])
    u = outputs(law, built(law, start, tmp_path), {"rotor angle": y}, law.period)

    in_c = compiled(law, tmp_path)
    memory = np.zeros(len(law.memory.places))
    expected = np.zeros((SAMPLES, 1))
    in_c.begin(memory, start)
    assert law.loop is not None
    ticks = round(law.period / law.loop.timestep)
    for k in range(SAMPLES):
        in_c.step_in_loop(k * ticks, y[k : k + 1], np.ones(1), memory, expected[k])
    np.testing.assert_array_equal(u, expected[:, 0])
