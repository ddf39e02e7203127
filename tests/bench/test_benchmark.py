"""The benchmark measures what it says; how fast it is, no test asserts."""

from __future__ import annotations

import importlib.util

import pytest

from grosmc_mj.bench.loops import benchmark


@pytest.mark.slow
def test_every_loop_is_measured_against_its_baseline_in_the_same_round(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("grosmc_mj.bench.loops._STEPS", {1: 500, 1024: 2})
    rows = {row.loop: row for row in benchmark("implicitfast", rounds=1)}
    assert {row.simulations for row in rows.values()} == {1, 1024}
    for row in rows.values():
        assert row.rate > 0
        # With one round the median ratio is the ratio of the rates.
        assert row.ratio == pytest.approx(row.rate / rows[row.baseline].rate)
    assert rows["mj_step(nstep), open loop"].ratio == 1
    assert rows["Batch.step(nstep), open loop"].ratio == 1
    there = importlib.util.find_spec("dm_control") is not None
    assert ("dm_control suite cartpole" in rows) == there
