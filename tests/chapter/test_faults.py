"""Faults: each changes what it says and nothing else, and claims notice them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from shipped import controller_names

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.balance import switching_rate
from grosmc_mj.chapter.claims.faults import FAULTS
from grosmc_mj.chapter.claims.judging import judge
from grosmc_mj.chapter.claims.ledger import find_claim
from grosmc_mj.chapter.claims.self_test import self_test
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.reaching import nominal
from grosmc_mj.executors import Batch
from grosmc_mj.experiments.catalogue import chapter_controller, find_experiment
from grosmc_mj.experiments.laboratory import Fault, Laboratory
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.physics.mujoco_plant import MujocoPlant

SYSTEMS = ("servo", "cart_pendulum", "arm", "two_link_arm")
FAULT = {fault.name: fault for fault in FAULTS}
# Exact ones of three systems, not in the order of their files.
QUICK = [find_claim(name) for name in ("pendulum-eq40", "arm-eq57", "servo-circular-bound")]


@cache
def sound(system: str, name: str = "grosmc") -> Controller:
    return chapter_controller(name, MujocoPlant.load(system).analytic())


def faulty(name: str, system: str, controller: str = "grosmc", case: str = "nominal") -> Controller:
    experiment = find_experiment(system, case)
    return FAULT[name].controller(sound(system, controller), experiment, "physics")


def faulty_plant(name: str) -> Any:
    experiment = find_experiment("servo", "case2")
    return FAULT[name].plant(experiment.plant("physics"), experiment, "physics")


def samples(law: Controller) -> list[tuple[float, Array]]:
    """Random instants and states in the region of every law."""
    random, n = np.random.default_rng(3), len(law.designed.error.system.states)
    return [(0.01 * k, random.uniform(-1, 1, n)) for k in range(20)]


def inputs(law: Controller) -> tuple[Array, Array]:
    """u and, for a law with a surface, s of a law along the samples, (count, m)."""
    memory, u, s = law.memory(), [], []
    for t, x in samples(law):
        u.append(np.atleast_1d(law.input_at(t, x, memory)))
        s.append(np.array(getattr(memory, "s", [0.0])))
    return np.array(u), np.array(s)


@pytest.mark.parametrize("system", SYSTEMS)
def test_faults_of_laws_change_their_own_part(system: str) -> None:
    """Consistently: with a small G, S = G (A - B K), G B = G B and its inverse still hold."""
    for name in controller_names(system):
        u, s = inputs(sound(system, name))
        wrong, s_wrong = inputs(faulty("wrong sign of u", system, name))
        assert np.array_equal(wrong, -u)
        assert np.array_equal(s_wrong, s)
        law = faulty("zero switching gain", system, name)
        continuous = "fl-lqr" if system == "cart_pendulum" else "lqr"
        alone = sound(system, continuous if name == "grosmc" else name)
        assert inputs(law)[0] == pytest.approx(inputs(alone)[0], rel=1e-13)
        x, s = samples(law)[0][1][None], np.full((1, law.coordinates.size), 0.3)
        own = nominal(law.designed, law.parameters, [0.0], x, s)
        assert switching_rate(law.parameters, own).tolist() == [0.0]
    law = faulty("integral left out", system)
    z = np.array([law.designed.error.error_state(t, x, law.parameters) for t, x in samples(law)])
    assert inputs(law)[1] == pytest.approx((z - z[0]) @ law.parameters.G.T, abs=1e-13)
    law, p = faulty("G too small", system), sound(system).parameters
    small, optimum = law.parameters, law.designed.lqr
    assert pytest.approx(0.01 * p.G, rel=1e-15) == small.G
    assert pytest.approx(small.S, rel=1e-12) == small.G @ optimum.closed_loop
    assert pytest.approx(small.G @ optimum.B, rel=1e-12) == small.GB
    assert small.GB @ small.GB_inverse == pytest.approx(np.eye(len(small.GB)), rel=1e-12)
    assert small.size_of_GB == pytest.approx(np.linalg.norm(small.GB), rel=1e-12)
    for name in ("K", "eta", "gamma0", "gamma1", "k", "epsilon"):
        assert np.all(getattr(small, name, 0) == getattr(p, name, 0))


def test_faults_of_plants_settings_and_pushes_change_their_own_part() -> None:
    before = MujocoPlant.load("servo").model.body("rotor")
    wrong = faulty_plant("mass without inertia").model.body("rotor")
    assert wrong.mass == pytest.approx(3 * before.mass)
    assert np.array_equal(wrong.inertia, before.inertia)
    assert np.array_equal(wrong.ipos, before.ipos)
    nominal_plant = MujocoPlant.load("servo").analytic().parameters
    assert faulty_plant("edit dropped").analytic().parameters == nominal_plant
    twice = faulty_plant("edit done twice").model.body("rotor")
    assert twice.mass == pytest.approx(9 * before.mass)
    lab = Laboratory(Settings(), FAULT["slow sampling"])
    assert lab.settings == replace(Settings(), control_period=10 * Settings().control_period)
    T, h = lab.settings.control_period / 2, lab.settings.timestep / 2
    assert lab.refined.settings == replace(lab.settings, control_period=T, timestep=h)
    experiment = find_experiment("arm", "case1")
    dropped = FAULT["disturbance dropped"].experiment(experiment).case
    assert dropped == replace(experiment.case, disturbances=())
    tenfold = FAULT["decimal point misplaced"].experiment(experiment).case
    for was, now in zip(experiment.case.disturbances, tenfold.disturbances, strict=True):
        assert np.array(now.wrench) == pytest.approx(10 * np.array(was.wrench))
        assert replace(now, wrench=was.wrench) == was


# Who notices.


@pytest.mark.slow
def test_every_fault_is_noticed() -> None:
    """By a few of the claims already; grosmc-mj claims self-test tries them all."""
    quick = ("servo-load-grosmc", "servo-circular-bound", "pendulum-eq40", "arm-eq57")
    caught: dict[str, set[str]] = {name: set() for name in FAULT}
    for names, faults in (
        (quick, list(caught)),
        # Runs of many seconds meet only faults that the quick ones cannot notice, or not alone.
        (("servo-load-lqr",), ["disturbance dropped"]),
        (("pendulum-naive-gain",), ["printed a in the law"]),
        (("arm-variations",), ["zero switching gain", "G too small", "slow sampling"]),
        (("two-link-projection",), ["edit done twice"]),
    ):
        tried, put_in = [find_claim(name) for name in names], [FAULT[name] for name in faults]
        for one in self_test(Settings(), tried, put_in, Batch(), thorough=True):
            caught[one.fault.name] |= set(one.claims)
    assert all(caught.values()), [name for name, claims in caught.items() if not claims]
    assert {"servo-load-grosmc", "arm-variations"} <= caught["zero switching gain"]
    assert "servo-circular-bound" in caught["mass without inertia"]
    assert {"pendulum-eq40", "arm-eq57"} <= caught["printed physics"]
    # Neither claim looks at a law.
    for name in ("wrong sign of u", "zero switching gain", "G too small", "slow sampling"):
        assert not {"pendulum-eq40", "arm-eq57"} & caught[name]


def test_a_law_that_works_nowhere_has_no_region() -> None:
    """That it fails from every start does not support that it works from small ones only."""
    claim, lab = find_claim("pendulum-region-lqr"), Laboratory(Settings(), FAULT["wrong sign of u"])
    measured = judge(lab, claim, refine=False).plants["corrected"].measured
    assert (measured.value, measured.note) == (None, "not from 5 degrees")
    assert not claim.holds(measured)


def test_a_claim_that_has_noticed_is_tried_no_more() -> None:
    """Every fault is still put in, and tried with others as long as nobody notices."""
    claims, printed = QUICK[:2], FAULT["printed physics"]
    again = replace(printed, name="again")
    caught = self_test(Settings(), claims, [printed, again, FAULT["gravity upside down"]], Batch())
    assert [(len(one.claims), one.tried) for one in caught] == [(2, 2), (1, 1), (1, 1)]
    thorough = self_test(Settings(), claims, [printed, again], Batch(), thorough=True)
    assert [one.claims for one in thorough] == [("pendulum-eq40", "arm-eq57")] * 2
    # Claims about the law with the printed C look at the faulty one, as at any other.
    seen: list[str] = []

    def spy(law: Controller, *_: Any) -> Controller:
        seen.append(law.name)
        return law

    lab = Laboratory(Settings(), Fault("spy", "looks on", controller=spy))
    find_claim("arm-printed-c").measure(lab, "corrected")
    assert seen
