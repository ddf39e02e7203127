"""A whole number is told from what merely looks like one, the same way wherever it is asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from looped import H, nominal, servo

from grosmc_mj.arguments import whole
from grosmc_mj.campaign.specification import Specification
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.references import setpoints
from grosmc_mj.errors import ArgumentError
from grosmc_mj.executors import make_executor
from grosmc_mj.loop import Loop, in_loop
from grosmc_mj.plants import SERVO
from grosmc_mj.plants.operating_point import equilibrium
from grosmc_mj.simulation.simulate import simulate


def looped(run: Any) -> object:
    return in_loop(nominal().law("corrected", "lqr"), Loop(), SERVO, run=run)


def threaded(threads: Any) -> object:
    law = nominal().law("corrected", "lqr")
    return simulate(servo(), law, (0.0, 0.0), duration=H, threads=threads)


def asked(**numbers: Any) -> Specification:
    return Specification(name="small", text="", folder=".", **numbers)


PLACES: dict[str, Callable[[Any], object]] = {
    "seed of a loop": lambda value: Loop(seed=value),
    "number of a run": looped,
    "threads": threaded,
    "runs of a campaign": lambda value: asked(runs=value),
    "plants of a part": lambda value: asked(shard=value),
    "seed of a campaign": lambda value: asked(seed=value),
    "workers of a campaign": lambda value: make_executor("processes", workers=value),
    "sign of an error": lambda value: ErrorCoordinates(SERVO, setpoints(2), value),
    "a state that is held": lambda value: equilibrium(servo(), {value: 0.0}),
}


@pytest.mark.parametrize("value", [True, 1.0, 1.5, "1", None, np.array([1])], ids=repr)
def test_what_is_no_whole_number_is_none(value: Any) -> None:
    assert whole(value) is None


@pytest.mark.parametrize("value", [1, np.int32(1), np.uint8(1), np.array(1)], ids=repr)
def test_numpy_s_whole_numbers_are_whole_numbers(value: Any) -> None:
    assert (whole(value), type(whole(value))) == (1, int)


@pytest.mark.parametrize("value", [True, 1.5, "1"])
@pytest.mark.parametrize("place", PLACES)
def test_every_place_refuses_what_is_none(place: str, value: Any) -> None:
    with pytest.raises(ArgumentError) as told:
        PLACES[place](value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("place", PLACES)
def test_every_place_takes_one(place: str) -> None:
    PLACES[place](1)
    assert Loop(seed=np.int64(1)) == Loop(seed=1)  # pyright: ignore[reportArgumentType]
