"""Kinds of laws: what they declare is what they are."""

import math
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from shipped import REGULATION, task_of

from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.theory.control.kinds import KINDS
from grosmc_mj.theory.control.kinds.adaptive import Adaptive
from grosmc_mj.theory.control.kinds.adrc import Adrc
from grosmc_mj.theory.control.kinds.fl_lqr import FlLqr
from grosmc_mj.theory.control.kinds.fl_pid import FlPid
from grosmc_mj.theory.control.kinds.grosmc import Grosmc
from grosmc_mj.theory.control.kinds.kind import WEIGHTS, LawKind, Where
from grosmc_mj.theory.control.kinds.lqi import Lqi
from grosmc_mj.theory.control.kinds.pd import Pd
from grosmc_mj.theory.control.kinds.pid import Pid
from grosmc_mj.theory.control.law_number import LawNumber
from grosmc_mj.theory.control.switching import SWITCHINGS, Switching, SwitchingNumbers
from grosmc_mj.theory.control.task import Task

PERIOD = 1e-3
LAWS: tuple[LawKind, ...] = (
    FlLqr(),
    Pd(4.0),
    Grosmc(5.0, 3.0),
    Pid(kp=8.0, ki=3.0, kd=1.5, filter=0.01, tracking_time=0.2),
    Lqi(10.0),
    FlPid(4.0),
    Adrc(50.0),
    Adaptive(2.0, 1.0),
)
each_law = pytest.mark.parametrize("law", LAWS, ids=lambda law: law.key)
DECLARED = [
    *[(kind, key) for kind in KINDS for key in kind.numbers()],
    *[(SwitchingNumbers, key) for key in vars(SwitchingNumbers())],
]
each_number = pytest.mark.parametrize(
    ("kind", "key"), DECLARED, ids=lambda value: getattr(value, "__name__", value)
)


def declared(kind: Any, key: str) -> LawNumber:
    if kind is SwitchingNumbers:
        return next(law.numbers[key] for law in SWITCHINGS.values() if key in law.numbers)
    return kind.numbers()[key]


def numbers_in(value: Any) -> list[float]:
    """All numbers of a law's parameters, those of its sampled dynamics too."""
    if isinstance(value, (float, np.ndarray)):
        return np.ravel(value).tolist()
    members = getattr(value, "__dict__", None) or getattr(value, "_asdict", dict)()
    return [number for member in members.values() for number in numbers_in(member)]


def designed(law: LawKind, task: Task) -> list[float]:
    controller = law.design(task).sampled(PERIOD)
    return numbers_in(replace(controller.parameters, plant=None, reference=None))


def changed(law: LawKind, key: str, value: float) -> LawKind:
    """The law with another value of a number."""
    values: Any = {name: getattr(law, name) for name in law.field_names()}
    return type(law)(**{**values, key: value})


@pytest.mark.parametrize("where", Where)
def test_a_key_is_one_law_on_each_kind_of_plant(where: Where) -> None:
    keys = [kind.key for kind in KINDS if where in kind.where]
    assert len(keys) == len(set(keys)) > 0


@each_number
def test_a_search_stays_within_the_bounds(kind: Any, key: str) -> None:
    number = declared(kind, key)
    if number.search is None:
        assert key == "limit"
        return
    low, high = number.search
    assert low < high
    assert number.holds(low)
    assert number.holds(high)
    assert low > 0 or not number.log


@each_number
def test_a_number_without_a_value_has_one_within_its_bounds(kind: Any, key: str) -> None:
    if kind is SwitchingNumbers:
        assert declared(kind, key).holds(getattr(SwitchingNumbers(), key))
    elif key in kind.defaults():
        assert declared(kind, key).holds(kind.defaults()[key])


NUMBERS = [(law, key) for law in LAWS for key in law.numbers()]
each_number_of_a_law = pytest.mark.parametrize(
    ("law", "key"), NUMBERS, ids=lambda value: getattr(value, "key", value)
)


@each_number_of_a_law
def test_a_number_beyond_its_bounds_is_refused_by_its_name(law: LawKind, key: str) -> None:
    with pytest.raises(ArgumentError, match=key):
        changed(law, key, math.nan)


def given(law: LawKind) -> list[str]:
    return [key for key in law.field_names() if getattr(law, key) is not None]


TUNABLE = [(law, key) for law in LAWS for key in law.tunable(law.way_of(given(law)))]


@pytest.mark.parametrize(
    ("law", "key"),
    [(law, key) for law, key in TUNABLE if key not in WEIGHTS],
    ids=lambda value: getattr(value, "key", value),
)
def test_a_tunable_number_changes_the_law(law: LawKind, key: str) -> None:
    """A search over a number that does nothing would find anything."""
    task = task_of("arm")
    halved = changed(law, key, 0.5 * getattr(law, key))
    assert designed(halved, task) != designed(law, task)


@each_law
def test_a_law_is_tuned_by_weights_if_they_change_it(law: LawKind) -> None:
    task = task_of("arm")
    heavier = replace(task, Q=4 * np.asarray(task.Q))
    differs = designed(law, heavier) != designed(law, task)
    assert differs == law.follows_weights == ("Q" in law.tunable())


def test_of_numbers_that_exclude_each_other_a_search_gets_one_way() -> None:
    assert {"kp", "ki", "kd"} < set(Pid.tunable())
    assert "frequency" not in Pid.tunable("kp")
    assert not {"kp", "ki", "kd"} & set(Pid.tunable("frequency"))
    assert "frequency" in Pid.tunable("frequency")
    assert Pid.way_of(["filter", "frequency"]) == "frequency"


def test_a_gain_may_be_one_number_or_one_for_each_output() -> None:
    task = task_of(REGULATION)
    assert designed(Pid(kp=[8.0, 8.0]), task) == designed(Pid(kp=8.0), task)
    assert designed(Pid(kp=[8.0, 7.0]), task) != designed(Pid(kp=8.0), task)


@pytest.mark.parametrize(("name", "key"), [*product(SWITCHINGS, vars(SwitchingNumbers()))])
def test_a_switching_law_reads_the_numbers_that_it_declares(name: str, key: str) -> None:
    numbers = vars(SwitchingNumbers())
    halved = numbers | {key: 0.5 * numbers[key]}
    differs = phi_of(name, numbers) != phi_of(name, halved)
    assert differs == (key in SWITCHINGS[name].numbers)


def phi_of(name: str, values: Any) -> list[float]:
    """phi of a switching law at some samples, with a small and a large s."""
    numbers = SwitchingNumbers(**values)
    law = Switching(name, numbers)
    memory = law.new_memory(1, 2)()
    phi = np.zeros(1)
    noted = []
    for s in (2e-3, 1e-4, 3e-1, -1e-7, -1e-7):
        memory.elapsed = PERIOD
        law.reach(np.array([s]), 2.0, 3.0, memory, numbers, phi)
        memory.phi[:] = phi
        noted.append(phi.item())
    return noted
