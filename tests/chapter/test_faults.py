"""Faults put into laws, plants and settings: each changes one thing, and a claim notices it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from faults import FAULTS
from shipped import controller_names

from grosmc_mj.chapter.claims.judging import judge
from grosmc_mj.chapter.claims.ledger import find_claim
from grosmc_mj.experiments.assumptions.balance import switching_rate
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.reaching import nominal_law

SYSTEMS = ("servo", "cart_pendulum", "arm", "two_link_arm")
SOUND = RunCache(Settings())


@cache
def sound(system: str, name: str = "grosmc") -> Controller:
    return SOUND.controller(find_experiment(system, "nominal"), "physics", name)


def faulty(fault: str, system: str, name: str = "grosmc") -> Controller:
    return FAULTS[fault]().controller(find_experiment(system, "nominal"), "physics", name)


def faulty_plant(fault: str) -> Any:
    return FAULTS[fault]().plant(find_experiment("servo", "case2"), "physics")


def samples(law: Controller) -> list[tuple[float, Array]]:
    """Random instants and states in the region of every law."""
    random = np.random.default_rng(3)
    n = len(law.designed.error.system.states)
    return [(0.01 * k, random.uniform(-1, 1, n)) for k in range(20)]


def inputs(law: Controller) -> tuple[Array, Array]:
    """u and, for a law with a surface, s of a law along the samples, (count, m)."""
    memory = law.memory()
    u = []
    s = []
    for t, x in samples(law):
        u.append(np.atleast_1d(law.input_at(t, x, memory)))
        s.append(np.array(getattr(memory, "s", [0.0])))
    return np.array(u), np.array(s)


# Each fault changes its own part


LAWS = [(system, name) for system in SYSTEMS for name in controller_names(system)]
of_each_law = pytest.mark.parametrize(("system", "name"), LAWS)


@of_each_law
def test_a_wrong_sign_reverses_u_and_leaves_s(system: str, name: str) -> None:
    u, s = inputs(sound(system, name))
    wrong_u, wrong_s = inputs(faulty("wrong sign of u", system, name))
    assert np.array_equal(wrong_u, -u)
    assert np.array_equal(wrong_s, s)


@of_each_law
def test_without_gain_grosmc_is_its_continuous_part(system: str, name: str) -> None:
    continuous = "fl-lqr" if system == "cart_pendulum" else "lqr"
    law = faulty("zero switching gain", system, name)
    alone = sound(system, continuous if name == "grosmc" else name)
    assert inputs(law)[0] == pytest.approx(inputs(alone)[0], rel=1e-13)

    x = samples(law)[0][1][None]
    s = np.full((1, law.coordinates.size), 0.3)
    reaching = nominal_law(law, [0.0], x, s)
    assert switching_rate(law.parameters, reaching).tolist() == [0.0]


@pytest.mark.parametrize("system", SYSTEMS)
def test_without_its_integral_s_is_G_times_the_change_of_z(system: str) -> None:
    law = faulty("integral left out", system)
    z = np.array([law.designed.error.error_state(t, x, law.parameters) for t, x in samples(law)])
    assert inputs(law)[1] == pytest.approx((z - z[0]) @ law.parameters.G.T, abs=1e-13)


@cache
def law_of_small_G(system: str) -> Controller:
    return faulty("G too small", system)


@pytest.mark.parametrize("system", SYSTEMS)
def test_a_small_G_is_small_everywhere(system: str) -> None:
    """S = G (A - B K), G B and its inverse still hold."""
    p = sound(system).parameters
    law = law_of_small_G(system)
    small = law.parameters
    optimum = law.designed.lqr
    assert pytest.approx(0.01 * p.G, rel=1e-15) == small.G
    assert pytest.approx(small.S, rel=1e-12) == small.G @ optimum.closed_loop
    assert pytest.approx(small.G @ optimum.B, rel=1e-12) == small.GB
    assert small.GB @ small.GB_inverse == pytest.approx(np.eye(len(small.GB)), rel=1e-12)
    assert small.size_of_GB == pytest.approx(np.linalg.norm(small.GB), rel=1e-12)


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("name", ["K", "eta", "gamma0", "gamma1", "k", "epsilon"])
def test_a_small_G_leaves_the_gains(name: str, system: str) -> None:
    p = sound(system).parameters
    small = law_of_small_G(system).parameters
    assert np.all(getattr(small, name, 0) == getattr(p, name, 0))


def test_faults_of_edits_change_mass_or_inertia() -> None:
    before = MujocoPlant.load("servo").model.body("rotor")
    wrong = faulty_plant("mass without inertia").model.body("rotor")
    assert wrong.mass == pytest.approx(3 * before.mass)
    assert np.array_equal(wrong.inertia, before.inertia)
    assert np.array_equal(wrong.ipos, before.ipos)

    nominal_plant = MujocoPlant.load("servo").analytic().parameters
    assert faulty_plant("edit dropped").analytic().parameters == nominal_plant
    twice = faulty_plant("edit done twice").model.body("rotor")
    assert twice.mass == pytest.approx(9 * before.mass)


def test_slow_sampling_is_slow_when_refined_too() -> None:
    lab = FAULTS["slow sampling"]()
    assert lab.settings == replace(Settings(), control_period=10 * Settings().control_period)
    T = lab.settings.control_period / 2
    h = lab.settings.timestep / 2
    assert lab.refined.settings == replace(lab.settings, control_period=T, timestep=h)


def test_faults_of_disturbances_change_their_wrench_alone() -> None:
    experiment = find_experiment("arm", "case1")
    dropped = FAULTS["disturbance dropped"]().as_set(experiment)
    assert dropped.key == experiment.changed(disturbances=()).key

    tenfold = FAULTS["decimal point misplaced"]().as_set(experiment)
    for was, now in zip(experiment.disturbances, tenfold.disturbances, strict=True):
        assert now.amplitudes == pytest.approx(10 * np.array(was.amplitudes))
        assert (now.of, now.profile, now.label) == (was.of, was.profile, was.label)


# Claims notice them


def verdicts(lab: RunCache, claim_id: str) -> object:
    """Verdict of a claim on every plant, without refinement: a fault shows at the first look."""
    try:
        finding = judge(lab, find_claim(claim_id), refine=False)
    except (ValueError, RuntimeError) as error:
        # A run cache so wrong that it cannot measure has been noticed as well.
        return type(error)
    return {name: on_plant.verdict for name, on_plant in finding.plants.items()}


@cache
def sound_verdicts(claim_id: str) -> object:
    return verdicts(SOUND, claim_id)


NOTICED = [
    ("wrong sign of u", "servo-load-grosmc"),
    ("zero switching gain", "servo-load-grosmc"),
    ("zero switching gain", "arm-variations"),
    ("integral left out", "servo-load-grosmc"),
    ("G too small", "arm-variations"),
    ("printed a in the law", "pendulum-naive-gain"),
    ("laws know the plant", "servo-circular-bound"),
    ("mass without inertia", "servo-circular-bound"),
    ("edit dropped", "servo-circular-bound"),
    ("edit done twice", "two-link-projection"),
    ("gravity upside down", "pendulum-eq40"),
    ("printed physics", "pendulum-eq40"),
    ("printed physics", "arm-eq57"),
    ("disturbance dropped", "servo-load-lqr"),
    ("decimal point misplaced", "servo-load-grosmc"),
    ("slow sampling", "arm-variations"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "claim_id"), NOTICED)
def test_a_claim_notices_the_fault(fault: str, claim_id: str) -> None:
    assert verdicts(FAULTS[fault](), claim_id) != sound_verdicts(claim_id)


def test_each_of_the_fourteen_faults_is_noticed() -> None:
    assert len(FAULTS) == 14
    assert {fault for fault, _ in NOTICED} == set(FAULTS)


@pytest.mark.parametrize("claim_id", ["pendulum-eq40", "arm-eq57"])
@pytest.mark.parametrize(
    "fault", ["wrong sign of u", "zero switching gain", "G too small", "slow sampling"]
)
def test_claims_about_equations_do_not_look_at_laws(fault: str, claim_id: str) -> None:
    assert verdicts(FAULTS[fault](), claim_id) == sound_verdicts(claim_id)


def test_a_law_that_works_nowhere_has_no_region() -> None:
    """A failure from every start does not support that it works from small ones only."""
    claim = find_claim("pendulum-region-lqr")
    finding = judge(FAULTS["wrong sign of u"](), claim, refine=False)
    measured = finding.plants["corrected"].measured
    assert (measured.value, measured.note) == (None, "not from 5 degrees")
    assert not claim.holds(measured)
