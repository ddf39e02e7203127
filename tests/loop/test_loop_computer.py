"""The computer: samples that are late, outputs that come too late."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from looped import H, played, seen

from grosmc_mj.loop import Computing, Loop
from grosmc_mj.simulation.trajectory import Trajectory

SIGMAS = 5.0
EXAMPLES = settings(max_examples=25)


def computed(
    samples: int, stride: int, seed: int = 0, run: int = 0, **numbers: float
) -> Trajectory:
    """A script that asks for 1, 2, 3 ...: a number tells its sample."""
    loop = Loop(Computing(**numbers), seed=seed)
    return played(np.arange(1.0, samples + 1), loop, stride=stride, x0=(0.0, 1.0), run=run)


def instants(run: Trajectory) -> Any:
    """The timesteps in which samples were taken."""
    return np.flatnonzero(np.diff(run.memory["samples"], prepend=0.0))


@EXAMPLES
@given(missed=st.floats(0, 0.95), seed=st.integers(0, 2**53 - 1), stride=st.sampled_from([1, 3]))
def test_a_missed_sample_holds_the_output_before(missed: float, seed: int, stride: int) -> None:
    run = computed(40, stride, seed, missed=missed)
    np.testing.assert_array_equal(run.command, np.repeat(np.arange(1.0, 41), stride))
    given_out = run.input.reshape(40, stride)
    assert np.all(given_out == given_out[:, :1])
    before = 0.0
    for asked, out in enumerate(given_out[:, 0].tolist(), start=1):
        assert out in (asked, before)
        before = out


def test_the_share_that_is_missed_is_the_one_given() -> None:
    """Of N samples sqrt(N p (1 - p)) more or less."""
    N, p = 10_000, 0.3
    run = computed(N, 1, missed=p)
    missed = np.sum(run.input != run.command)
    assert abs(missed - N * p) < SIGMAS * math.sqrt(N * p * (1 - p))


@EXAMPLES
@given(late=st.integers(0, 6), seed=st.integers(0, 2**53 - 1), delay=st.integers(0, 9))
def test_a_sample_is_late_by_timesteps_within_the_bound(late: int, seed: int, delay: int) -> None:
    stride = 7
    run = computed(40, stride, seed, jitter=late * H, delay=delay * H)
    at = instants(run)
    lateness = at - stride * np.arange(len(at))
    assert lateness[0] == 0
    assert np.all((lateness >= 0) & (lateness <= late))
    # Sensors are read when it is late, and the law believes that it is not.
    last = np.repeat(at, np.diff(at, append=len(run.command)))
    np.testing.assert_array_equal(seen(run), run.state[last])
    asked = 1.0 + np.searchsorted(at, np.arange(len(run.command)), side="right") - 1
    np.testing.assert_array_equal(run.command, asked)
    np.testing.assert_array_equal(run.input, np.concatenate([np.zeros(delay), asked])[: len(asked)])


def test_each_lateness_is_as_frequent_as_the_others() -> None:
    N, late, stride = 1500, 3, 4
    at = instants(computed(N, stride, jitter=late * H))
    counts = np.bincount(at - stride * np.arange(len(at)))
    p = 1 / (late + 1)
    assert len(counts) == late + 1
    assert np.all(np.abs(counts - N * p) < SIGMAS * math.sqrt(N * p * (1 - p)))


@pytest.mark.parametrize("what", ["jitter", "missed"])
def test_another_run_or_seed_is_late_at_other_samples(what: str) -> None:
    """Fifty samples with two outcomes are the same twice once in 2^50."""
    numbers = {"jitter": H} if what == "jitter" else {"missed": 0.5}
    runs = [computed(50, 2, seed, run, **numbers) for seed, run in ((0, 0), (1, 0), (0, 1), (0, 0))]
    inputs = [run.input.tobytes() for run in runs]
    assert len(set(inputs)) == 3
    assert inputs[0] == inputs[3]
