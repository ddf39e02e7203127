"""The benchmark measures what it says; how fast it is, no test asserts."""

import os
from collections.abc import Callable, Iterator
from itertools import repeat
from pathlib import Path

import mujoco
import numpy as np
import pytest
from commands import Patch

import grosmc_mj as gm
from benchmarks import switching, timing
from benchmarks.batches import batch_at
from benchmarks.loops import benchmark
from benchmarks.machines import benchmark_machines
from benchmarks.tables import tables_text, throughput_table
from benchmarks.timing import Throughput
from grosmc_mj.plants import SYSTEMS


@pytest.mark.slow
def test_every_loop_is_measured_against_its_baseline_in_the_same_round(monkeypatch: Patch) -> None:
    monkeypatch.setattr("benchmarks.loops._MANY", 4)
    monkeypatch.setattr("benchmarks.loops._STEPS", {1: 500, 4: 2})
    rows = {row.loop: row for row in benchmark("implicitfast", rounds=1)}
    assert {row.simulations for row in rows.values()} == {1, 4}
    for row in rows.values():
        assert row.rate > 0
        # With one round the median ratio is the ratio of the rates.
        assert row.ratio == pytest.approx(row.rate / rows[row.baseline].rate)
    assert rows["mj_step(nstep), open loop"].ratio == 1
    assert rows["Batch.step(nstep), open loop"].ratio == 1


def test_the_middle_half_of_the_ratios_holds_half_of_the_rounds(monkeypatch: Patch) -> None:
    """By a clock of our own: the law takes 2, 3, 4, 5 and 40 s where its baseline takes 1 s."""
    clock, taken = [0.0], iter([2.0, 3.0, 4.0, 5.0, 40.0])
    monkeypatch.setattr(timing.time, "perf_counter", lambda: clock[0])

    def takes(seconds: Iterator[float]) -> Callable[[], object]:
        return lambda: clock.__setitem__(0, clock[0] + next(seconds))

    base = timing.TimedLoop("base", 1, 100, lambda: takes(repeat(1.0)), "base")
    law = timing.TimedLoop("law", 1, 100, lambda: takes(taken), "base")
    open_loop, closed = timing.measured([base, law], rounds=5)
    assert (open_loop.rate, open_loop.low, open_loop.ratio, open_loop.high) == (100, 1, 1, 1)
    assert (closed.low, closed.ratio, closed.high) == pytest.approx((1 / 5, 1 / 4, 1 / 3))


def test_a_page_has_every_table_and_what_it_was_measured_on() -> None:
    rows = [Throughput("law", 1024, 2.5e5, 0.943, 0.91, 0.96, "open loop")]
    text = tables_text([throughput_table(rows, "arm")] * 2)
    assert text.count("| law | 1024 | 2.5e+05 | 0.94 | 0.91-0.96 | open loop |") == 2
    assert f"{os.cpu_count()} cores" in text
    assert f"mujoco {mujoco.__version__}" in text


@pytest.mark.slow
def test_every_machine_is_measured_beside_its_open_loop(monkeypatch: Patch) -> None:
    monkeypatch.setattr("benchmarks.machines._SIMULATIONS", 3)
    monkeypatch.setattr("benchmarks.machines._STEPS", 4)
    measured = benchmark_machines(rounds=1)
    assert list(measured) == [f"{system}/machine" for system in SYSTEMS]
    for open_loop, closed in measured.values():
        assert open_loop.ratio == 1
        assert closed.ratio == pytest.approx(closed.rate / open_loop.rate)
        assert (closed.baseline, closed.simulations) == (open_loop.loop, 3)


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
