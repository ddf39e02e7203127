"""The theorems and the index (13), where the ledger says that they hold and where not."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

from grosmc_mj.chapter.claims.claim import ClaimVerdict
from grosmc_mj.chapter.claims.judging import judge
from grosmc_mj.chapter.claims.ledger import find_claim
from grosmc_mj.chapter.claims.measurements.servo import undercut
from grosmc_mj.chapter.claims.measurements.theory import reaching_time, slowest_approach
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.mechanics.physics.edits import BodyEdit
from grosmc_mj.simulation.disturbances import Constant, Disturbance, Pulse

LAB = RunCache(Settings())
SERVO = find_experiment("servo", "nominal")


def test_input_that_the_index_does_not_weigh_undercuts_its_minimum() -> None:
    """With u_c = 0 and -K x in u_d: by quadrature on x* and, without chatter, by runs."""
    design = LAB.controller(SERVO, "physics", "lqr").designed.lqr
    x0 = np.array([1.0, 0.0])

    def rate(t: float) -> float:
        x = scipy.linalg.expm(design.closed_loop * t) @ x0
        return float(0.5 * x @ design.Q @ x)

    J = scipy.integrate.quad(rate, 0.0, 20.0)[0]
    assert pytest.approx(0.52156, abs=1e-5) == J
    assert design.optimal_cost(x0) == pytest.approx(0.54157, abs=1e-5)
    ideal = 100 * (J / design.optimal_cost(x0) - 1)

    coarse = undercut(LAB, "physics")
    fine = undercut(LAB.refined, "physics")
    assert coarse.value is not None
    assert fine.value is not None
    # Chatter adds to (13) with the square of the sampling time.
    extrapolated = (4 * fine.value - coarse.value) / 3
    assert extrapolated == pytest.approx(ideal, abs=0.05)
    assert f"{ideal:.3g} %" in coarse.note


def test_a_kick_takes_longer_than_the_law_s_own_eta_promises() -> None:
    """The time until s is zero after 20 ms of -6 N m on 3J under 1 N m."""
    kick = Disturbance("rotor", (0, 0, 0, 0, -6.0, 0), Pulse(4.0, 4.02))
    load = Disturbance("rotor", (0, 0, 0, 0, -1.0, 0), Constant())
    edits = (BodyEdit("rotor", 3.0),)
    case = SERVO.changed(duration=6.0, edits=edits, disturbances=(kick, load))
    sliding = LAB.run(case, "corrected", "grosmc").trajectory.sliding
    s = np.ravel(np.asarray(sliding))[4020:]
    eta = LAB.controller(SERVO, "corrected", "grosmc").parameters.eta

    duration = 1e-3 * int(np.flatnonzero(s * s[0] <= 0)[0])
    promised = abs(float(s[0])) / eta
    assert duration / promised == pytest.approx(1.93, abs=0.03)
    # A third of the rate remains, and is kept.
    assert duration < 3 * promised


@pytest.mark.parametrize(
    ("system", "worst"),
    [
        ("servo", "3 times the mass"),
        ("cart_pendulum", "4 times the mass, 4 times the length"),
        ("arm", "0.5 times the mass"),
    ],
)
def test_kicks_meet_the_extremes_of_the_declared_family(system: str, worst: str) -> None:
    measured = reaching_time(LAB, "corrected", system=system)
    assert measured.value is not None
    assert measured.value < 1
    assert worst in measured.note


@pytest.mark.parametrize("system", ["servo", "cart_pendulum"])
def test_a_theorem_holds_for_the_split_of_the_gain_that_meets_its_assumption(system: str) -> None:
    """With all of the law's eta as eta it would not: delta has a part of u_d in it."""
    experiment = find_experiment(system, "nominal")
    eta = LAB.controller(experiment, "corrected", "grosmc").parameters.eta
    assert experiment.uncertainty is not None
    declared = experiment.uncertainty.reaching_rate

    unsplit = slowest_approach(LAB, "corrected", system=system, rate=eta).value
    split = slowest_approach(LAB, "corrected", system=system)
    assert unsplit is not None
    assert split.value is not None
    assert unsplit == pytest.approx(split.value + eta - declared)
    assert split.value <= 1e-6 < unsplit
    assert f"η = {declared:.3g}, the other {eta - declared:.3g} of the law's" in split.note


def test_bound_of_assumption_4_leaves_out_the_part_of_delta_that_u_d_adds() -> None:
    """δ by its definition, x' = A x + B (u + δ), under 3J next to the surface."""
    experiment = find_experiment("servo", "case2")
    law = LAB.controller(experiment, "corrected", "grosmc")
    plant = LAB.plant(experiment, "physics")
    p = law.parameters
    design = law.designed.lqr
    rest = law.coordinates.place(0.0, np.zeros(2), p)

    excess = []
    errors = itertools.product((-1.2, 0, 1.2), repeat=2)
    for error, w, side in itertools.product(errors, (-1, 1), (-1, 1)):
        z = np.array(error)
        bound = p.gamma0 + p.gamma1 * float(np.linalg.norm(z))
        u = float(-(p.K @ z)[0] - (p.eta + bound) * side)
        z_rates = -plant.derivative(rest - z, u, np.array([0, 0, 0, 0, w, 0.0]))
        delta = float((z_rates - design.A @ z)[1] / design.B[1, 0]) - u
        # On the side on which it pushes s away.
        excess.append(delta * side - bound)

    # (1 - r) η of u_d, r = 1/3: so much more in γ0, with η less by as much, bounds all of δ.
    assert max(excess) == pytest.approx(2 / 3 * p.eta, rel=1e-9)


@pytest.mark.slow
def test_few_weights_bring_the_pole_to_rest_in_two_seconds() -> None:
    """7 of 81, as the claim's reason says; the declared ones are none of them."""
    claim = find_claim("pendulum-rest")
    grid = (10.0 ** np.linspace(0, 4, 9)).tolist()
    holding = 0
    for weights in itertools.product(grid, grid):
        lab = LAB.varied("task.Q", list(weights))
        holding += claim.holds(claim.measure(lab, "corrected"))
    assert f" {holding} of {len(grid) ** 2} " in claim.reason
    assert not claim.holds(claim.measure(LAB, "corrected"))


@pytest.mark.slow
def test_larger_gains_bring_the_pole_back_from_every_angle() -> None:
    verdicts: Any = {"corrected": ClaimVerdict.SUPPORTED}
    claim = replace(find_claim("pendulum-region-robust"), verdicts=verdicts)
    robust = judge(LAB, claim, refine=False)
    assert robust.verdict is ClaimVerdict.SUPPORTED
    assert robust.needs.startswith("declared |θ|, |θ'| = [1.4, 1.5]")
    assert "η = " in robust.needs
    assert "γ1 = " in robust.needs
