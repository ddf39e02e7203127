"""The benchmark measures what it says; how fast it is, no test asserts."""

import os
from collections.abc import Iterable
from itertools import repeat
from pathlib import Path

import mujoco
import numpy as np
import pytest
from commands import Patch

import grosmc_mj as gm
from benchmarks import switching, timing
from benchmarks.batches import batch_at
from benchmarks.growth import benchmark_growth
from benchmarks.loops import benchmark
from benchmarks.machines import benchmark_machines
from benchmarks.tables import tables_text, throughput_table
from benchmarks.timing import Ratio, Throughput, TimedLoop
from grosmc_mj.plants import SYSTEMS


@pytest.mark.slow
def test_every_loop_is_compared_with_both_open_loops_of_its_round(monkeypatch: Patch) -> None:
    monkeypatch.setattr("benchmarks.loops._MANY", 4)
    monkeypatch.setattr("benchmarks.loops._STEPS", {1: 500, 4: 2})
    rows = benchmark("implicitfast", rounds=1)
    assert {row.simulations for row in rows} == {1, 4}
    open_loops = {row.loop: row for row in rows if "open loop" in row.loop}
    for row in rows:
        name = "mj_step(nstep)" if row.simulations == 1 else "Batch.step(nstep)"
        shipped = open_loops[f"{name}, open loop"]
        untimed = open_loops[f"{name}, open loop, no clock"]
        # With one round the median ratio is the ratio of the rates.
        assert row.shipped.median == pytest.approx(row.rate / shipped.rate)
        assert row.untimed.median == pytest.approx(row.rate / untimed.rate)


class FakeClock:
    """A clock that only the timed functions advance."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def loop(self, name: str, seconds: Iterable[float]) -> TimedLoop:
        """A loop of 100 steps whose runs take these times [s]."""
        times = iter(seconds)

        def run() -> None:
            self.now += next(times)

        return TimedLoop(name, 1, 100, lambda: run)


def test_the_middle_half_of_the_ratios_holds_half_of_the_rounds(monkeypatch: Patch) -> None:
    """The law takes 2, 3, 4, 5 and 40 s where MuJoCo takes 2 s, and 1 s without its clock."""
    clock = FakeClock()
    monkeypatch.setattr(timing.time, "perf_counter", clock)
    shipped = clock.loop("shipped", repeat(2.0))
    untimed = clock.loop("untimed", repeat(1.0))
    law = clock.loop("law", [2.0, 3.0, 4.0, 5.0, 40.0])
    rows = timing.measured(shipped, untimed, [law], rounds=5)
    assert [row.loop for row in rows] == ["shipped", "untimed", "law"]
    assert rows[0].rate == 50
    assert rows[0].shipped == (1, 1, 1)
    assert rows[0].untimed == (0.5, 0.5, 0.5)
    assert rows[2].shipped == pytest.approx((1 / 2, 2 / 5, 2 / 3))
    assert rows[2].untimed == pytest.approx((1 / 4, 1 / 5, 1 / 3))


def test_a_page_has_every_table_and_what_it_was_measured_on() -> None:
    rows = [
        Throughput("law", 1024, 2.5e5, Ratio(1.543, 1.5, 1.56), Ratio(0.943, 0.91, 0.96)),
    ]
    text = tables_text([throughput_table(rows, "arm")] * 2)
    assert text.count("| law | 1024 | 2.5e+05 | 1.54 | 1.50-1.56 | 0.94 | 0.91-0.96 |") == 2
    assert f"{os.cpu_count()} cores" in text
    assert f"mujoco {mujoco.__version__}" in text


@pytest.mark.slow
def test_every_machine_is_measured_beside_its_open_loop(monkeypatch: Patch) -> None:
    monkeypatch.setattr("benchmarks.machines._SIMULATIONS", 3)
    monkeypatch.setattr("benchmarks.machines._STEPS", 4)
    measured = benchmark_machines(rounds=1)
    assert list(measured) == [f"{system}/machine" for system in SYSTEMS]
    for shipped, untimed, closed in measured.values():
        assert shipped.shipped.median == 1
        assert untimed.untimed.median == 1
        assert closed.shipped.median == pytest.approx(closed.rate / shipped.rate)
        assert closed.simulations == 3


@pytest.mark.slow
def test_costs_grow_with_states_and_inputs(monkeypatch: Patch) -> None:
    monkeypatch.setattr("benchmarks.growth._RUNS", 3)
    monkeypatch.setattr("benchmarks.growth._STEPS", 5)
    monkeypatch.setattr("benchmarks.growth._CASES", ("servo/nominal", "two_link_arm/nominal"))
    servo, arm = benchmark_growth(rounds=1)
    assert (servo.states, servo.inputs) == (2, 1)
    assert (arm.states, arm.inputs) == (4, 2)
    assert servo.shipped_step > 0


@pytest.mark.slow
def test_the_open_loop_of_a_machine_begins_as_its_closed_one() -> None:
    """With motors at their joints and what swings straight below its hinge."""
    plant = gm.MujocoPlant.load("cart_pendulum").edited(
        gm.machine.Transmission("slider", 0.1, stiffness=1e4),
        gm.machine.SwingingLoad("cart", 0.1, 0.2),
    )
    x0 = np.array([[0.1, -0.2, 0.3, 0.0]] * 2)
    law = gm.Experiment.load("cart_pendulum/nominal").law("physics", "lqr")
    run = gm.simulate(plant, law, x0, duration=0.001)
    assert run.physics is not None
    begun = batch_at([plant] * 2, x0)
    np.testing.assert_array_equal(begun.bind("qpos"), run.physics[:, 0, 1:5])
    np.testing.assert_array_equal(begun.bind("qvel"), run.physics[:, 0, 5:9])


def test_switching_laws_are_tabled_and_drawn(
    monkeypatch: Patch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(switching, "LAWS", ("implicit", "implicit-estimate"))
    monkeypatch.setattr(switching, "SAMPLE_TIMES", (2e-3, 1e-3))
    monkeypatch.setattr(switching, "GAIN_RATIOS", (1.0, 1.9, 2.1))
    monkeypatch.setattr(switching, "CONTROL_PERIODS", (1e-3,))
    monkeypatch.setattr(switching, "DRAWN", ("servo/nominal",))
    monkeypatch.setattr(switching, "CASES", ("servo/nominal",))
    figure = tmp_path / "switching.png"
    switching.main([str(figure)])

    assert list(tmp_path.iterdir()) == [figure]
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["implicit", "1.00"] in [row[:2] for row in rows]
    # The estimate is of second order, and diverges from r = 2 on.
    assert ["implicit-estimate", "2.00", "2.10"] in [[*row[:2], *row[-1:]] for row in rows]
    # Nominally the implicit law costs the optimum.
    assert ["servo/nominal", "implicit", "1"] in [[*row[:2], *row[-1:]] for row in rows]
