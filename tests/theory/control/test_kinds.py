"""Kinds of laws: what they declare is what they are."""

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from shipped import REGULATION, task_of

from grosmc_mj.ground.errors import ArgumentError, GrosmcError
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


def changed(law: LawKind, key: str, factor: float) -> LawKind:
    """The law with a number that is changed."""
    values: Mapping[str, Any] = {name: getattr(law, name) for name in law.field_names()}
    return type(law)(**{**values, key: factor * values[key]})


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


@each_law
def test_a_number_beyond_its_bounds_is_refused_by_its_name(law: LawKind) -> None:
    for key in law.numbers():
        values = {name: getattr(law, name) for name in law.field_names()}
        with pytest.raises(ArgumentError, match=key):
            type(law)(**{**values, key: math.nan})


@each_law
def test_each_tunable_number_changes_the_law_and_no_other_weight_does(law: LawKind) -> None:
    """A search over a number that does nothing would find anything."""
    task = task_of("arm")
    before = designed(law, task)
    given = [key for key in law.field_names() if getattr(law, key) is not None]
    for key in law.tunable(law.way_of(given)):
        if key not in WEIGHTS:
            assert designed(changed(law, key, 0.5), task) != before

    heavier = replace(task, Q=4 * np.asarray(task.Q))
    differs = designed(law, heavier) != before
    assert differs == law.follows_weights == ("Q" in law.tunable())


def test_of_numbers_that_exclude_each_other_a_search_gets_one_way() -> None:
    assert {"kp", "ki", "kd"} < set(Pid.tunable())
    assert "frequency" not in Pid.tunable("kp")
    assert not {"kp", "ki", "kd"} & set(Pid.tunable("frequency"))
    assert "frequency" in Pid.tunable("frequency")
    assert Pid.way_of(["filter", "frequency"]) == "frequency"


def test_ways_that_exclude_each_other_are_refused_together() -> None:
    task = task_of("arm")
    given: Mapping[str, Any] = {"kp": 8.0, "frequency": 4.0}
    for names in [(), ("kp", "frequency")]:
        with pytest.raises(ArgumentError, match="pid needs kp"):
            Pid(**{name: given[name] for name in names}).design(task)


def test_a_gain_may_be_one_number_or_one_for_each_output() -> None:
    task = task_of(REGULATION)
    one = designed(Pid(kp=8.0), task)
    assert designed(Pid(kp=[8.0, 8.0]), task) == one
    with pytest.raises(GrosmcError, match="must be a number or 2 numbers"):
        Pid(kp=[8.0, 8.0, 8.0]).design(task)


@pytest.mark.parametrize(("name", "key"), [*product(SWITCHINGS, vars(SwitchingNumbers()))])
def test_a_switching_law_reads_the_numbers_that_it_declares(name: str, key: str) -> None:
    law = SWITCHINGS[name]
    answers = []
    for factor in (1.0, 0.5):
        numbers = SwitchingNumbers(**{key: factor * getattr(SwitchingNumbers(), key)})
        answers.append(phi_of(name, numbers))
    assert (answers[0] != answers[1]) == (key in law.numbers)


def phi_of(name: str, numbers: SwitchingNumbers) -> list[float]:
    """phi of a switching law at some samples, with a small and a large s."""
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
