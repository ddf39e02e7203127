"""What the tests of plants and physics share: the systems, and a loop without feedback."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from grosmc_mj.control.controller import Controller
from grosmc_mj.plants import SYSTEMS
from grosmc_mj.simulation.mujoco_plant import MujocoPlant


@dataclass(frozen=True)
class Input:
    """A constant input, in the unit of the plant's."""

    u: float


def constant_input(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.v = p.u
    return p.u


@pytest.fixture(params=list(SYSTEMS))
def name(request: pytest.FixtureRequest) -> str:
    """Each system in turn."""
    return request.param


@pytest.fixture
def plant(name: str) -> MujocoPlant:
    """The shipped model of each system in turn."""
    return MujocoPlant.load(name)


@pytest.fixture
def open_loop() -> Callable[[float], Controller]:
    """A controller that holds u, whatever the state."""
    return lambda u: Controller("open loop", constant_input, Input(u))
