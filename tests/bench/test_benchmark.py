"""Benchmarks: their ratios and tables; no test asserts how fast anything is."""

from __future__ import annotations

import os
from collections.abc import Iterable
from itertools import repeat
from pathlib import Path

import mujoco
import numpy as np
import pytest
from commands import Patch, Screen

import grosmc_mj as gm
from benchmarks import switching, timing
from benchmarks.batches import batch_at
from benchmarks.growth import benchmark_growth
from benchmarks.loops import benchmark
from benchmarks.machines import benchmark_machines
from benchmarks.tables import tables_text, throughput_table
from benchmarks.timing import Ratio, Throughput, TimedLoop
from benchmarks.tuning import benchmark_tuning
from grosmc_mj.theory.plants import SYSTEMS


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


@pytest.mark.slow
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


def page_of_two_tables() -> str:
    row = Throughput(
        "law",
        1024,
        2.5e5,
        shipped=Ratio(1.543, 1.5, 1.56),
        untimed=Ratio(0.943, 0.91, 0.96),
    )
    table = throughput_table([row], "arm")
    return tables_text([table, table])


def test_a_page_has_every_table() -> None:
    row = "| law | 1024 | 2.5e+05 | 1.54 | 1.50-1.56 | 0.94 | 0.91-0.96 |"
    assert page_of_two_tables().count(row) == 2


def test_a_page_says_the_machine_that_was_measured() -> None:
    text = page_of_two_tables()
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
def test_growth_has_the_states_the_inputs_and_the_time_of_a_step_of_each_case(
    monkeypatch: Patch,
) -> None:
    monkeypatch.setattr("benchmarks.growth._RUNS", 3)
    monkeypatch.setattr("benchmarks.growth._STEPS", 5)
    monkeypatch.setattr("benchmarks.growth._CASES", ("servo/nominal", "two_link_arm/nominal"))
    rows = benchmark_growth(rounds=1)
    assert [(row.states, row.inputs) for row in rows] == [(2, 1), (4, 2)]
    assert all(row.shipped_step > 0 for row in rows)


@pytest.mark.slow
def test_the_open_loop_of_a_machine_begins_as_its_closed_one() -> None:
    """With motors at their joints."""
    plant = gm.MujocoPlant.load("cart_pendulum").changed(
        gm.machine.Transmission("slider", 0.1, stiffness=1e4),
    )
    x0 = np.array([[0.1, -0.2, 0.3, 0.0]] * 2)
    law = gm.Experiment.load("cart_pendulum/nominal").law("physics", "lqr")
    run = gm.simulate(plant, law, x0, duration=0.001)
    assert run.physics is not None
    batch = batch_at([plant] * 2, x0)
    start = run.physics[:, 0]
    np.testing.assert_array_equal(batch.bind("qpos"), start[:, 1:4])
    np.testing.assert_array_equal(batch.bind("qvel"), start[:, 4:7])


@pytest.mark.slow
def test_the_benchmark_of_switching_laws_tells_their_order_and_cost(
    tmp_path: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    """The implicit law is of first order, the estimate of second; it diverges from r = 2 on."""
    monkeypatch.setattr(switching, "LAWS", ("implicit", "implicit-estimate"))
    monkeypatch.setattr(switching, "SAMPLE_TIMES", (2e-3, 1e-3))
    monkeypatch.setattr(switching, "GAIN_RATIOS", (1.0, 1.9, 2.1))
    monkeypatch.setattr(switching, "CONTROL_PERIODS", (1e-3,))
    monkeypatch.setattr(switching, "DRAWN", ("servo/nominal",))
    monkeypatch.setattr(switching, "CASES", ("servo/nominal",))
    switching.main([str(tmp_path / "switching.png")])

    assert [path.name for path in tmp_path.iterdir()] == ["switching.png"]
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["implicit", "1.00"] in [row[:2] for row in rows]
    ends = [[*row[:2], *row[-1:]] for row in rows]
    assert ["implicit-estimate", "2.00", "2.10"] in ends
    # Nominally the implicit law costs the optimum.
    assert ["servo/nominal", "implicit", "1"] in ends


@pytest.mark.slow
def test_a_search_that_races_makes_fewer_runs_than_its_designs_have(monkeypatch: Patch) -> None:
    monkeypatch.setattr("benchmarks.tuning._TARGET", "servo/bench")
    monkeypatch.setattr("benchmarks.tuning._RUNS", 96)
    found = benchmark_tuning(rounds=1)
    assert 0 < found.raced < 1
    assert found.beside_batch > 0
