"""Meters against what is measured on the recorded rows of the same run."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaign_cases import INERTIA, LAWS, LQR, campaign, case, servo

from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.reading import resolved_text
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.experiments.metrics import (
    METRICS,
    NO_WINDOWS,
    Comparison,
    Recording,
    Windows,
    compare_with_optimum,
    cost_ratios,
    folded,
    measure,
    meters_of,
    noted,
)
from grosmc_mj.experiments.requirements import judge_all
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import Disturbance, Pulse
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.screening import evaluate

POLE = '[[uncertain]]\nbody = "pole"\nmass_scale = [1, 2]\n'
H, PERIOD, AFTER = 0.001, 0.002, [0.0, 0.05, 0.12]
PUSH = (0.06, 0.09)


@dataclass(frozen=True)
class Metered:
    """A run with its meters, and its samples as if nothing else were recorded."""

    meters: Any
    samples: Trajectory
    comparison: Comparison
    measured: Any


def system(name: str) -> Campaign:
    """The laws of a system."""
    body, start = {
        "servo": ("rotor", "{}"),
        "cart_pendulum": ("pole", '{ "pole angle" = "-10 deg", "cart speed" = "0.3 m/s" }'),
        "arm": ("link", '{ "joint rate" = "180 deg/s" }'),
        "two_link_arm": ("lower", '{ "shoulder angle" = "0.6 rad", "elbow angle" = "-1.2 rad" }'),
    }[name]
    tables = f'[[uncertain]]\nbody = "{body}"\nmass_scale = [1, 2]\n'
    return campaign(case(name, tables, start=start, laws=LAWS))


def run(
    asked: Campaign, law: str, engine: Any = "python", duration: float = 0.2, onset: float = 0.06
) -> Metered:
    """A recorded run under a pulse, its law sampled every other timestep."""
    controller = asked.laws[law]
    bodies = asked.plant.system.bodies
    push = Disturbance(bodies[-1], (0.3, 0, 0.2, 0, 0.1, 0), Pulse(onset, onset + 0.03))
    found = simulate(
        asked.plant,
        controller,
        asked.experiment.case.x0,
        duration=duration,
        control_period=PERIOD,
        timestep=0.001,
        disturbances=[push],
        meters=meters_of(controller, H, Windows(tuple(AFTER)), onset, costs=True),
        engine=engine,
    )
    samples = replace(
        found,
        time=found.time[:-1],
        state=found.state[:-1],
        command=found.command[:-1],
        input=found.command[:-1],
        weighed=found.weighed[:-1],
    )
    comparison = compare_with_optimum(samples, controller)
    measured = measure(samples, controller, comparison, onset)
    return Metered(np.atleast_1d(found.meters), samples, comparison, (measured, found))


def check(found: Metered, asked: Campaign, law: str) -> None:
    """Meters are what the samples say."""
    meters, samples, comparison = found.meters, found.samples, found.comparison
    measured, whole = found.measured
    controller = asked.laws[law]
    assert meters["input"][0] == np.abs(whole.command).max()
    if samples.sliding is not None:
        assert controller.designed.sliding_unit
        assert meters["sliding"][0] == np.abs(samples.sliding).max()
        assert meters["sliding_start"][0] == np.abs(samples.sliding[0]).max()
    else:
        assert not controller.designed.sliding_unit
        assert meters["sliding"][0] == meters["sliding_start"][0] == 0.0
    if asked.plant.system.name == "cart_pendulum":
        assert meters["travel"][0] == measured["cart_travel"].value > 0
    else:
        assert meters["travel"][0] == 0.0
    # The meter steps the optimum on by one matrix; the recorded one is exp(A t) of each instant,
    # and a norm's sum is rounded in another order.
    assert meters["deviation"][0] == pytest.approx(measured["deviation"].value, rel=1e-9, abs=1e-15)
    for after, error in zip(AFTER, meters["error"][0], strict=True):
        later = np.abs(comparison.error[comparison.time >= after * (1 - 1e-12)])
        assert error == pytest.approx(later.max(), rel=1e-12)
    assert meters["start"][0] == pytest.approx(comparison.error[0], rel=1e-15)
    # Up to the last sample: the rest is added at the end of the run.
    of_state, of_input = meters["costs"]["of_state"][0], meters["costs"]["of_input"][0]
    assert (of_state + of_input) / 2 == pytest.approx(measured["cost_whole"].value, rel=1e-12)
    transient = comparison.time <= PUSH[0]
    outside = np.abs(comparison.error) > 0.02 * abs(meters["start"][0])
    last = comparison.time[transient & outside]
    assert meters["outside"][0] == (last[-1] if len(last) else -1.0)


SYSTEMS = ["servo", "cart_pendulum", "arm", "two_link_arm"]


@pytest.mark.parametrize("law", ["lqr", "grosmc"])
@pytest.mark.parametrize("name", ["servo", "two_link_arm"])
def test_meters_are_what_the_samples_say(name: str, law: str) -> None:
    asked = system(name)
    check(run(asked, law), asked, law)


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("servo", "lqr"),
        ("servo", "grosmc"),
        *(
            pytest.param(name, law, marks=pytest.mark.slow)
            for name in SYSTEMS[1:]
            for law in ("lqr", "grosmc")
        ),
    ],
)
def test_both_engines_have_the_same_meters_bit_for_bit(name: str, law: str) -> None:
    asked = system(name)
    native, python = run(asked, law, "native"), run(asked, law)
    check(native, asked, law)
    assert native.meters.tobytes() == python.meters.tobytes()


CASES = [f"{name}/{case}" for name in SYSTEMS for case in ("nominal", "case1", "case2")]


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_recorded_rows_of_every_case_say_what_its_running_laws_have_noted(name: str) -> None:
    body = MujocoPlant.load(name.split("/")[0]).system.uncertain_body
    text = resolved_text(shipped_files()[name]).split("[[uncertain]]")[0]
    asked = campaign(f'{text}\n[[uncertain]]\nbody = "{body}"\nmass_scale = [1, 2]\n')
    case = asked.experiment.case
    for law in asked.laws.values():
        found = simulate(
            asked.plant,
            law,
            case.x0,
            duration=asked.duration,
            control_period=asked.experiment.settings.control_period,
            timestep=asked.experiment.settings.control_period,
            disturbances=case.disturbances,
            meters=meters_of(
                law,
                asked.experiment.settings.control_period,
                Windows((0.5,)),
                case.onset,
                costs=True,
            ),
        )
        running = np.atleast_1d(found.meters)
        samples = replace(found, time=found.time[:-1], state=found.state[:-1])
        comparison = compare_with_optimum(samples, law)
        rows, _ = noted(samples, comparison, case.onset, Windows((0.5,)))
        # Of the index and the optimum a recorded run has none.
        for field in set(rows.dtype.names) - {"optimal", "z", "after", "still", "costs"}:
            if field == "deviation" or len(comparison.outputs) > 1:
                # One step of the optimum after another, and a norm in another order.
                assert running[field] == pytest.approx(rows[field], rel=1e-9, abs=1e-15)
            else:
                assert running[field].tobytes() == rows[field].tobytes(), field
        ends = found.state[[0]], found.state[[-1]], asked.duration
        cost = measure(found, law, compare_with_optimum(found, law), case.onset)
        whole, least = cost["cost_whole"].value, cost["cost_optimal"].value
        assert whole is not None
        assert least is not None
        assert cost_ratios(law, running["costs"], *ends) == pytest.approx(whole / least, rel=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["lqi", "pid", "adrc", "adaptive"])
def test_laws_with_dynamics_are_metered_in_both_engines(law: str) -> None:
    """At another period than the file's, which their matrices depend on."""
    asked = campaign(case("servo", INERTIA, laws=f'[[controller]]\nlaw = "{law}"\n'))
    native, python = run(asked, law, "native"), run(asked, law)
    check(native, asked, law)
    assert native.meters.tobytes() == python.meters.tobytes()


def stepped(asked: Campaign, onset: float, *states: list[float]) -> Any:
    """The meters after timesteps at these states."""
    law = asked.laws["lqr"]
    meters = meters_of(law, PERIOD, Windows(tuple(AFTER)), onset)
    kept, memory, p = meters.start, law.memory(), law.parameters
    for k, state in enumerate(states):
        meters.note(k * PERIOD, np.array(state), np.zeros(1), memory, p, kept, meters.numbers)
    return kept


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_travel_counts_from_the_start_either_way(way: float) -> None:
    asked = campaign(case("cart_pendulum", POLE, laws=LQR))
    places = [way * x for x in (0.5, 0.75, 2.0, 1.25)]
    meters = stepped(asked, math.inf, *([x, 0.0, 0.0, 0.0] for x in places))
    assert meters.travel == 1.5


@pytest.mark.parametrize(("onset", "outside"), [(0.0, 2), (PERIOD, 1), (math.inf, 2)])
def test_a_disturbance_from_the_start_is_part_of_the_transient(onset: float, outside: int) -> None:
    asked = campaign(servo(laws=LQR, limits=""))
    # The reference is 1 rad: three samples outside the band, and one in it.
    meters = stepped(asked, onset, *([angle, 0.0] for angle in (0.0, 0.5, 0.9, 1.0)))
    assert meters.outside == outside * PERIOD
    assert recording(onset, 0.2).transient == [onset if onset == PERIOD else 0.2]


def recording(onset: float, duration: float) -> Recording:
    return Recording.sampled(H, duration, np.array([onset]))


@pytest.mark.parametrize(("duration", "onset"), [(6.0, 5.0), (6.0, 7.0), (6.0, 4.2), (3.0, 2.9)])
def test_settling_is_that_of_the_recorded_run(duration: float, onset: float) -> None:
    asked = campaign(servo(laws=LQR, limits=""))
    found = run(asked, "lqr", "native", duration=duration, onset=onset)
    recorded = found.measured[0]["settling_time"].value
    # The servo settles at 4.02 s: too late to be sure of before 4.2 s, and not at all in 3 s.
    assert (recorded is None) == (onset < 5)
    (metered_one,) = folded(found.meters, recording(onset, duration))["settling_time"]
    # k T by adding T to (k - 1) T.
    assert metered_one == pytest.approx(math.inf if recorded is None else recorded, rel=1e-12)


def test_a_run_that_starts_at_its_reference_has_settled() -> None:
    at_goal = case("servo", servo().split("[[uncertain]]")[1].join(["[[uncertain]]", ""]), laws=LQR)
    asked = campaign(at_goal.replace("start = {}", 'start = { "rotor angle" = "1 rad" }'))
    found = run(asked, "lqr")
    assert found.meters["start"] == 0.0
    assert folded(found.meters, recording(0.06, 0.2))["settling_time"] == [0.0]


def test_one_law_measures_many_batches_without_compiling_again() -> None:
    law = campaign(servo()).laws["grosmc"]
    one, other = (
        meters_of(law, H, NO_WINDOWS, 0.02),
        meters_of(law, H, Windows((0.5,)), math.inf),
    )
    assert one.note is other.note
    assert {"deviation", "settling_time", "max_input"} <= METRICS.keys()


def test_a_law_without_an_optimum_cannot_be_metered() -> None:
    law = replace(campaign(servo()).laws["lqr"], design=None)
    with pytest.raises(ArgumentError, match="lqr has no error coordinates and no optimum"):
        meters_of(law, H, NO_WINDOWS, 0.0)


LEVER = """
<mujoco model="lever">
  <option timestep="0.001" integrator="RK4"/>
  <worldbody>
    <body name="bar" pos="0 0 1">
      <joint name="hinge" axis="0 -1 0" damping="0.2"/>
      <geom type="capsule" fromto="0 0 0  0.4 0 0" size="0.03" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor name="hinge" joint="hinge" ctrllimited="true" ctrlrange="-1.5 1.5"/></actuator>
</mujoco>
"""
ASKS_FOR_MORE = """
[plant]
model = "lever.xml"
[run]
start = { hinge = "-60 deg" }
duration = "0.5 s"
[task]
Q = [400, 10]
R = 1
[[controller]]
law = "lqr"
[[requirement]]
input_below = "1.6 N m"
[[uncertain]]
body = "bar"
mass_scale = [1, 1.5]
"""


def test_a_campaign_judges_what_an_actuator_of_a_loop_gives(tmp_path: Path) -> None:
    limits = '[[requirement]]\ninput_below = "4.5 A"\n'
    actuator = '[[actuator]]\nof = "current"\nlimit = "4 A"\n'
    (tmp_path / "case.toml").write_text(servo(INERTIA, limits=limits) + actuator)
    experiment = Experiment.load(tmp_path / "case.toml")
    recorded = experiment.run("physics", "grosmc")
    asked = Campaign.load(str(tmp_path / "case.toml"), runs=2)
    nominal = evaluate(asked, "grosmc", asked.family.nominal[None])
    assert np.abs(recorded.trajectory.command).max() > 4.5, "the actuator must cut something"
    (judgement,) = judge_all(experiment.limits, [recorded])
    assert judgement.margin == nominal["margin input_below"][0] == 0.5
    assert judgement.kept
    assert nominal["relative"][0] >= 0


@pytest.mark.parametrize("engine", ["native", "python"])
def test_a_campaign_judges_the_input_that_the_plant_is_given(engine: Any, tmp_path: Path) -> None:
    (tmp_path / "lever.xml").write_text(LEVER)
    (tmp_path / "case.toml").write_text(
        ASKS_FOR_MORE.replace("[run]", f'[run]\nengine = "{engine}"')
    )
    experiment = Experiment.load(tmp_path / "case.toml")
    recorded = experiment.run("physics", "lqr")
    assert np.abs(recorded.trajectory.command).max() > 1.6, "the actuator must cut something"
    assert recorded.metrics["max_input"].value == 1.5
    asked = Campaign.load(str(tmp_path / "case.toml"), runs=2)
    nominal = evaluate(asked, "lqr", asked.family.nominal[None])
    assert nominal["max_input"][0] == 1.5
    assert nominal["margin input_below"][0] == pytest.approx(0.1)
    assert (nominal["relative"][0] >= 0) == judge_all(experiment.limits, [recorded])[0].kept
