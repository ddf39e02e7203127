"""A loop in a campaign: its numbers drawn, its chance each run's own, its runs repeated."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from campaign_cases import PLANT, campaign, kept

from grosmc_mj.errors import GrosmcError
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.map import pass_map_of
from grosmc_mj.sweep.replay import replay
from grosmc_mj.sweep.screening import Batch
from grosmc_mj.sweep.store import Folder

LOOP = """
[computing]
delay = "1 ms"
missed = 0.05
[[sensor]]
of = "rotor angle"
resolution = "0.1 mrad"
noise = "0.1 mrad"
[[estimator]]
of = "rotor speed"
law = "eso"
bandwidth = "100 rad/s"
[[actuator]]
of = "current"
limit = "4 A"
lag = "1 ms"
[[controller]]
law = "lqr"
[[controller]]
name = "told"
law = "lqr"
predict = true
"""
UNCERTAIN = """
[[uncertain]]
computing = true
delay = ["0 ms", "4 ms"]
[[uncertain]]
sensor = "rotor angle"
noise = ["0 mrad", "0.3 mrad"]
[[uncertain]]
estimator = "rotor speed"
bandwidth = ["50 rad/s", "200 rad/s"]
[[uncertain]]
actuator = "current"
lag = ["0 ms", "3 ms"]
"""


def text(loop: str = LOOP, uncertain: str = UNCERTAIN) -> str:
    plant = PLANT.format(system="servo", duration=0.05, start="{}")
    limit = '[[requirement]]\ndeviation_below = "3 mrad"\n'
    return plant + loop + limit + uncertain


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """Eight servos in two parts."""
    return kept(campaign(text()), tmp_path_factory.mktemp("loops"))


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["native", "python"])
@pytest.mark.parametrize("law", ["lqr", "told"])
def test_a_run_with_chance_in_it_is_repeated_bit_for_bit(
    folder: Folder, law: str, engine: Any
) -> None:
    for number in ("0", "5"):
        found = replay(campaign(text()), folder, number, law, engine)
        assert found.differences == []


# What is drawn at random in a run, drawn itself.
CHANCE = """
[[uncertain]]
computing = true
jitter = ["0 ms", "0.5 ms"]
[[uncertain]]
computing = true
missed = [0, 0.3]
"""


@pytest.mark.slow
def test_neighbours_and_threads_play_no_part() -> None:
    asked = campaign(text())
    values = asked.values(range(4))
    together = Batch(asked, values, range(4), threads=2).run("told")
    for i in range(4):
        alone = Batch(asked, values[i : i + 1], [i], threads=1).run("told")
        assert alone["deviation"][0] == together["deviation"][i]


def test_drawn_times_are_whole_timesteps_and_the_law_knows_the_files() -> None:
    asked: Campaign = campaign(text())
    sample = asked.plant_sample([2.4e-3, 1e-4, 80.0, 2e-3])
    loop = sample.case.loop
    assert loop is not None
    assert loop.computing.delay == pytest.approx(2e-3)
    assert loop.sensors[0].noise == 1e-4
    assert loop.estimators[0].bandwidth == 80.0
    assert loop.actuators[0].lag == 2e-3


def test_units_and_names_are_those_of_states_and_inputs() -> None:
    named = {each.name: each.unit for each in campaign(text()).family.quantities}
    assert named == {
        "computing delay": "s",
        "rotor angle noise": "rad",
        "rotor speed bandwidth": "rad/s",
        "current lag": "s",
    }


def test_times_are_shown_as_they_are_run_and_bandwidths_in_their_unit() -> None:
    """Of 2.6 ms on a grid of 1 ms, 0.2 mrad, 80 rad/s and 2.4 ms."""
    words = campaign(text()).words(np.array([2.6e-3, 2e-4, 80.0, 2.4e-3]))
    assert words == (
        "computing delay 0.003 s, rotor angle noise 0.01146 °, rotor speed bandwidth 80 rad/s, "
        "current lag 0.0024 s"
    )
    # What is run as the nominal plant is said to be it.
    delayed = np.array([1.4e-3, 1e-4, 100.0, 1e-3])
    assert campaign(text()).words(delayed) == "the nominal one"


def test_a_map_shows_times_as_they_are_run_and_bandwidths_in_their_unit() -> None:
    asked = campaign(text())
    delay, _, bandwidth, _ = asked.family.quantities
    columns = {
        delay.name: np.array([0.4e-3, 2.6e-3]),
        bandwidth.name: np.array([80.0, 90.0]),
        "relative": np.array([0.1, -0.1]),
    }
    folder: Any = SimpleNamespace(columns=lambda *_: dict.fromkeys(asked.laws, columns))
    shown = pass_map_of(asked, folder, (delay, bandwidth))
    assert shown.titles == ("computing delay [s]", "rotor speed bandwidth [rad/s]")
    np.testing.assert_array_equal(shown.runs["lqr"][0], [0.0, 3e-3])
    np.testing.assert_array_equal(shown.runs["lqr"][1], [80.0, 90.0])


# Two laws that ask for a state of one age, with sensors of both states or of one.
BOTH = """
[computing]
[[sensor]]
of = "rotor angle"
noise = "0.1 mrad"
[[sensor]]
of = "rotor speed"
noise = "1 mrad/s"
[[actuator]]
of = "current"
[[controller]]
law = "lqr"
predict = true
"""
FILTER = """
[[sensor]]
of = "rotor angle"
noise = "0.1 mrad"
[[estimator]]
of = "rotor speed"
law = "kalman"
load = "1 A"
[[controller]]
law = "lqr"
"""


def sensor(of: str, number: str, ends: str) -> str:
    return f'[[uncertain]]\nsensor = "rotor {of}"\n{number} = {ends}\n'


@pytest.mark.parametrize(
    ("loop", "uncertain", "said"),
    [
        (
            BOTH,
            sensor("angle", "delay", '["0 ms", "2 ms"]'),
            r"rotor angle delay 0.002 s can occur, .*predict: .* different ages",
        ),
        (
            BOTH,
            sensor("angle", "delay", '["0 ms", "2 ms"]')
            + sensor("speed", "delay", '["0 ms", "2 ms"]'),
            "rotor angle delay 0.002 s and rotor speed delay 0 s can occur",
        ),
        (
            BOTH,
            '[[uncertain]]\ncomputing = true\ndelay = { distribution = "normal", mean = "1 ms", '
            'deviation = "20 s", least = "0 s" }\n',
            "no such machine or loop: computing: delay = .* timesteps of 0.001 s: at most 100000",
        ),
        (
            FILTER,
            sensor("angle", "noise", '["0 mrad", "1 mrad"]'),
            "rotor angle has neither",
        ),
    ],
)
def test_loops_that_cannot_be_are_refused_before_anything_is_run(
    loop: str, uncertain: str, said: str
) -> None:
    with pytest.raises(GrosmcError, match=said) as told:
        campaign(text(loop, uncertain))
    assert "let that of computing = true vary instead" in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("loop", "uncertain", "said"),
    [
        (
            LOOP,
            '[[uncertain]]\nsensor = "rotor speed"\nnoise = ["0 rad/s", "1 rad/s"]\n',
            "unknown sensor 'rotor speed'",
        ),
        (
            LOOP,
            '[[uncertain]]\nactuator = "current"\nrate_limit = ["1 A/s", "9 A/s"]\n',
            "rate_limit is not limited: write nominal into this",
        ),
        (
            LOOP,
            "[[uncertain]]\ncomputing = true\nmissed = [0.5, 1.0]\n",
            "missed = 1 can occur",
        ),
        (
            LOOP,
            '[[uncertain]]\nestimator = "rotor speed"\nlag = ["0 ms", "1 ms"]\n',
            "an estimator has no lag",
        ),
        (
            '[[controller]]\nlaw = "lqr"\n',
            '[[uncertain]]\nactuator = "current"\nlag = ["0 ms", "1 ms"]\n',
            "the case file has no actuator, of which this is a number: write one",
        ),
        (
            '[[controller]]\nlaw = "lqr"\n',
            '[[uncertain]]\ncomputing = true\ndelay = ["0 ms", "1 ms"]\n',
            "the case file has no computing, of which this is a number: write one",
        ),
        (
            '[computing]\n[[controller]]\nlaw = "lqr"\n',
            '[[uncertain]]\nsensor = "rotor angle"\nnoise = ["0 mrad", "1 mrad"]\n',
            r"there is no \[\[sensor\]\]",
        ),
    ],
)
def test_what_a_loop_has_not_cannot_be_uncertain(loop: str, uncertain: str, said: str) -> None:
    with pytest.raises(GrosmcError, match=said) as told:
        campaign(text(loop, uncertain))
    assert "\n" not in str(told.value)
