"""What a task requires, whichever law does it: bands, overshoot, RMS, final error."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from grosmc_mj.arrays import Array
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.metrics import Recording, meters_of, said_by
from grosmc_mj.experiments.requirements import Limit, judge, windows
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.simulation.simulate import simulate

CASE = """
[plant]
system = "{system}"
[run]
start = {start}
duration = "{duration} s"
control_period = "1 ms"
timestep = "1 ms"
{more}
[task]
{task}
[[controller]]
law = "pd"
frequency = 3
damping = 0.5
[[requirement]]
{required}
"""


def experiment(folder: Path, required: str, **changes: str) -> Experiment:
    """A servo's step of 1 rad in 6 s under two poles with a damping of 0.5."""
    values = {
        "system": "servo", "start": "{}", "duration": "6", "more": "",
        "task": 'reference = ["1"]\nsign = -1\nQ = [1, 1]\nR = 1', "required": required, **changes,
    }  # fmt: skip
    file = folder / "mine.toml"
    file.write_text(CASE.format(**values), encoding="utf-8")
    return Experiment.load(file)


ALL = """
settles_within = "4 s"
band = "{band} rad"
overshoot_below = 0.5
rms_below = "1 rad"
stays_within = "1 rad"
after = "1 s"
final_error_below = "1 mrad"
"""


def judged(result: RunResult) -> dict[str, tuple[Limit, float]]:
    """What is measured for each kind of limit."""
    found = {}
    for limit in result.experiment.limits:
        measured = judge(limit, result).measured
        assert measured is not None
        found[limit.kind] = (limit, measured)
    return found


def error(time: Array) -> Array:
    """e'' + 3 e' + 9 e = 0 from 1 rad at rest, which the nominal error obeys."""
    w, zeta = 3.0, 0.5
    wd = w * math.sqrt(1 - zeta**2)
    return np.exp(-zeta * w * time) * (np.cos(wd * time) + zeta * w / wd * np.sin(wd * time))


@pytest.mark.parametrize("band", [0.2, 0.05, 0.004])
def test_a_second_order_step_has_its_textbook_figures(tmp_path: Path, band: float) -> None:
    """To what sampling at 1 kHz leaves of a continuous law."""
    found = judged(experiment(tmp_path, ALL.format(band=band)).run("physics", "pd"))
    time = np.arange(6001) * 1e-3
    e = error(time)
    # M_p = exp(-pi zeta / sqrt(1 - zeta^2)) = 16.3 %.
    assert found["overshoot_below"][1] == pytest.approx(math.exp(-math.pi / math.sqrt(3)), rel=0.01)
    settled = time[np.flatnonzero(np.abs(e) > band)[-1] + 1]
    assert found["settles_within"][1] == pytest.approx(settled, abs=0.005)
    late, last = np.abs(e[time >= 1]), np.abs(e[time >= 5.4])
    assert found["rms_below"][1] == pytest.approx(np.sqrt(np.mean(late**2)), rel=0.01)
    assert found["stays_within"][1] == pytest.approx(late.max(), rel=0.01)
    assert found["final_error_below"][1] == pytest.approx(last.max(), rel=0.02)


def test_a_law_that_runs_measures_what_is_measured_on_its_record(tmp_path: Path) -> None:
    """The meters of batches and campaigns against the recorded run, at the same instants."""
    case = experiment(tmp_path, ALL.format(band=0.05))
    recorded = judged(case.run("corrected", "pd"))
    law, asked = case.law("corrected", "pd"), windows(case.limits)
    meters = meters_of(law, 1e-3, asked, math.inf)
    plant = case.plant("corrected")
    x0 = np.array([case.case.x0])
    ended = simulate(
        [plant], [law], x0, duration=6, control_period=1e-3, timestep=1e-3, meters=meters,
        record=False,
    )  # fmt: skip
    found = said_by(
        law,
        ended.meters,
        Recording.sampled(1e-3, 6.0, np.array([math.inf]), asked),
        x0,
        ended.state[:, -1],
        np.array([True]),
        costs=False,
    )
    for kind, (limit, measured) in recorded.items():
        # The record has one instant more, the run's end.
        assert found[limit.metric][0] == pytest.approx(measured, rel=1e-3), kind


def test_a_band_of_its_own_is_not_the_usual_one(tmp_path: Path) -> None:
    wide = judged(experiment(tmp_path, ALL.format(band=0.2)).run("corrected", "pd"))
    usual = experiment(tmp_path, 'settles_within = "4 s"')
    limit, settled = judged(usual.run("corrected", "pd"))["settles_within"]
    assert limit.words == "settles within 4 s"
    assert wide["settles_within"][0].words == "settles within 4 s to 0.2 rad"
    assert wide["settles_within"][1] < settled


def test_a_band_that_is_never_reached_says_so(tmp_path: Path) -> None:
    """Poles at 3 rad/s leave 1 % of the step after 1.5 s, not a millionth."""
    case = experiment(tmp_path, 'settles_within = "1 s"\nband = "1e-6 rad"', duration="1.5")
    (limit,) = case.limits
    judgement = judge(limit, case.run("physics", "pd"))
    assert not judgement.kept
    said = "not reached; its nominal optimum itself: not reached"
    assert (judgement.measured, judgement.note) == (None, said)


def test_a_run_that_settles_late_says_when_its_nominal_optimum_does(tmp_path: Path) -> None:
    """The law's own error dynamics, without the lag of twice the inertia."""
    edit = '[[edit]]\nbody = "rotor"\nmass_scale = 2'
    case = experiment(tmp_path, 'settles_within = "1 s"', more=edit)
    run, time = case.run("corrected", "pd"), np.arange(6001) * 1e-3
    settled = time[np.flatnonzero(np.abs(error(time)) > 0.02)[-1] + 1]
    (judgement,) = (judge(limit, run) for limit in case.limits)
    assert not judgement.kept
    assert (judgement.measured or 0) > settled + 0.5
    assert judgement.note == f"its nominal optimum itself: takes {settled:.3g} s"


def test_a_number_that_is_marked_as_assumed_is_the_same_number(tmp_path: Path) -> None:
    loops = [
        experiment(tmp_path, 'input_below = "1 A"', more=f'[computing]\ndelay = "1 ms"\n{mark}')
        for mark in ("", 'assumed = ["delay"]')
    ]
    assert loops[0].case.loop == loops[1].case.loop


# --- the shipped benches and machines ---

SYSTEMS = ("servo", "cart_pendulum", "arm", "two_link_arm", "jaco")


@pytest.mark.parametrize("name", ["bench", "machine"])
@pytest.mark.parametrize("system", SYSTEMS)
def test_a_machine_asks_the_same_task_of_every_law(system: str, name: str) -> None:
    """Numbers by one rule, from the start's error, the sensor's step and the actuator's range."""
    case = Experiment.load(f"{system}/{name}")
    assert all(table.of is None for table in case.file.requirement)
    found = {limit.kind: limit for limit in reversed(case.limits)}
    assert {law for limit in found.values() for law in limit.of} == set(case.controllers)
    loop, law = case.case.loop, case.law("physics", "lqr")
    assert loop is not None
    z = np.array(law.designed.error.error_state(0.0, np.array(case.case.x0), law.parameters))
    start = float(np.linalg.norm(z[list(law.designed.error.output_rows)]))
    limits = [actuator.limit for actuator in loop.actuators]
    assert found["input_below"].value == max(limits)
    regulated = "final_error_below" in found
    if regulated:
        outputs = law.coordinates.system.controlled
        names = {law.coordinates.system.states[row].name for row in outputs}
        (step,) = (each.resolution for each in loop.sensors if each.of in names)
        assert found["final_error_below"].value == pytest.approx(2 * step, rel=0.01)
        band = max(0.02 * start, 3 * step)
        assert (found["settles_within"].band or 0.02 * start) == pytest.approx(band, rel=0.01)
        assert found["stays_within"].value == pytest.approx(band, rel=0.01)
        assert found["stays_within"].after == found["settles_within"].value
    else:
        assert found["settles_within"].band == found["stays_within"].value
        assert found["rms_below"].value == pytest.approx(found["stays_within"].value / 2, rel=0.01)
        assert found["rms_below"].after == found["settles_within"].value
    if len(law.designed.error.output_rows) == 1:
        assert found["overshoot_below"].value == 0.05


def test_a_state_is_an_output_of_relative_degree_one(tmp_path: Path) -> None:
    """y' = v = -3 (y - 2): the speed is 2 (1 - exp(-3 t)), but for the hold at 1 kHz."""
    task = 'outputs = { formulas = ["rotor speed"] }\nreference = ["2"]\nsign = 1\nQ = 9\nR = 1\n'
    text = CASE.format(
        system="servo", start="{}", duration="4", more="", task=task,
        required='stays_within = "10 mrad/s"\nafter = "3 s"',
    )  # fmt: skip
    first = text.replace('law = "pd"\nfrequency = 3\ndamping = 0.5', 'law = "first"')
    file = tmp_path / "mine.toml"
    file.write_text(f'{first}[laws.first]\nlaw = "fl-lqr"\n', encoding="utf-8")
    run = Experiment.load(file).run("physics", "first")
    expected = 2 * (1 - np.exp(-3 * run.trajectory.time))
    assert np.abs(run.trajectory.state[:, 1] - expected).max() < 2e-3
    assert run.requirements[0].kept
