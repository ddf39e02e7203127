"""The chapter's claims about the servo rotor, section 2.3."""

from __future__ import annotations

import numpy as np

from grosmc_mj.chapter.claims.claim import Claim, Measured
from grosmc_mj.chapter.claims.measures import (
    BOTH,
    SAME,
    SAME_WHY,
    SENSITIVE,
    SENSITIVE_WHY,
    changed_response,
    deviation,
    excess_cost,
    gains,
    leaving_the_surface,
    of,
    outputs,
    signals,
    within,
)
from grosmc_mj.control.lqr import lqr
from grosmc_mj.experiments.experiment import find_experiment
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.premises.balance import switching_rate


def _before_the_load(lab: Laboratory, plant: PlantName) -> Measured:
    """Largest difference of the two laws before the load acts, in percent of the step."""
    laws = [lab.case("servo", "case1", plant, name) for name in ("lqr", "grosmc")]
    before = within(laws[0].comparison.time, 0.0, 10.0)
    n = min(len(law.comparison.time) for law in laws)
    difference = laws[0].comparison.z[:n, 0] - laws[1].comparison.z[:n, 0]
    return of(laws[1], 100 * float(np.abs(difference[before[:n]]).max()))


def _overshoot_grows(lab: Laboratory, plant: PlantName) -> Measured:
    """LQR's overshoot under 3J less the nominal one, in percent of the step."""
    results = [lab.case("servo", case, plant, "lqr") for case in ("case2", "nominal")]
    values = [result.metrics["overshoot"].value or 0.0 for result in results]
    return of(results[0], values[0] - values[1], f"{values[0]:.2g} % against {values[1]:.2g} %")


def _damping_falls(lab: Laboratory, plant: PlantName) -> Measured:
    """By how much 3J lowers the damping ratio of the LQR loop, in percent.

    The loop's linearization is taken by differences of x' on the plant, law and all.
    """
    ratios, poles = [], []
    for name in ("nominal", "case2"):
        case = find_experiment("servo", name)
        law = lab.controller(case, plant, "lqr")
        derivative = lab.derivative(lab.plant(case, plant))
        p, memory = law.parameters, law.memory()
        rest, step = np.array([law.coordinates.reference(0.0, p.reference)[0], 0.0]), 1e-5

        def loop(x: np.ndarray) -> np.ndarray:
            u = law.law(1.0, x, memory, p)  # noqa: B023  used in this turn only
            return derivative(x, u, np.zeros(6))  # noqa: B023

        jacobian = np.column_stack(
            [(loop(rest + d) - loop(rest - d)) / (2 * step) for d in step * np.eye(2)]
        )
        stiffness = np.linalg.det(jacobian)
        poles.append(float(np.linalg.eigvals(jacobian).real.max()))
        ratios.append(-np.trace(jacobian) / (2 * np.sqrt(abs(stiffness))))
    note = (
        f"damping ratio {ratios[1]:.3g} under 3J, {ratios[0]:.3g} nominal; slowest pole "
        f"{poles[1]:.3g} and {poles[0]:.3g} 1/s"
    )
    return Measured(100 * float(1 - ratios[1] / ratios[0]), note)


def _undercut(lab: Laboratory, plant: PlantName) -> Measured:
    """How far below J* the index (13) can go, in percent.

    With u_c = -K x it is the integral of x'(Q + K'RK)x/2, to which u_d adds no cost: the least of
    it is that of an LQR whose further input costs next to nothing. A law without u_d has none.
    """
    law = lab.controller(find_experiment("servo", "nominal"), plant, "grosmc")
    design, x0 = law.lqr, np.array([1.0, 0.0])
    assert design is not None
    if switching_rate(law, x0, design.B[1:]) == 0:
        return Measured(0.0, "the law has no input that (13) leaves out")
    weight = design.Q + design.K.T @ design.R @ design.K
    hurried = lqr(design.A - design.B @ design.K, design.B, weight, 1e-4)
    ratio = hurried.optimal_cost(x0) / design.optimal_cost(x0)
    return Measured(100 * (ratio - 1), "linear feedback as u_d, priced at a ten-thousandth")


def _naive_gain(lab: Laboratory, plant: PlantName) -> Measured:
    """The bound sized without the switching term's own share, over what 3J requires.

    Assumption 4 bounds the lumped uncertainty, which under J = 3 J_hat contains (r - 1) u with
    the switching input in it. Left out of the bound, |u_d| = |(r - 1)/r u_c + ...| is required
    while |(r - 1) u_c + ...| is configured.
    """
    case = find_experiment("servo", "case2")
    law = lab.controller(case, plant, "grosmc")
    assert law.error is not None
    assert law.lqr is not None
    derivative = lab.derivative(lab.plant(case, plant))
    naive, required = 0.0, 0.0
    B = float(law.lqr.B[1, 0])
    target = law.coordinates.reference(0.0, law.parameters.reference)[0]
    rest = np.array([target, 0.0])
    E_true = -(derivative(rest, 1.0, np.zeros(6)) - derivative(rest, 0.0, np.zeros(6)))[1]
    for angle in np.linspace(0, np.pi, 181):
        z = np.array([np.cos(angle), np.sin(angle)])
        x = np.array([target - z[0], -z[1]])
        u_c = -float(law.lqr.K[0] @ z)
        push = -derivative(x, u_c, np.zeros(6))[1] - (float(law.lqr.A[1] @ z) + B * u_c)
        naive, required = max(naive, abs(push / B)), max(required, abs(push / E_true))
    if required < 1e-9:
        return Measured(None, "nothing pushes s away here", broken=True)
    return Measured(float(naive / required), f"γ1 = {naive:.3g} sized so, {required:.4g} required")


CLAIMS = (
    Claim(
        id="servo-before-load",
        system="servo",
        statement="Without disturbance both laws have almost the same performance",
        source="section 2.3, Fig. 1 (t < 10 s)",
        criterion="max |x1 of GROSMC - x1 of LQR| for t < 10 s, at most 2 % of the step",
        why=SAME_WHY,
        measure=_before_the_load,
        sense="at most",
        threshold=SAME,
        unit="%",
        plants=BOTH,
        untested="other steps than 1 rad",
        drawing=outputs("servo", "case1"),
    ),
    Claim(
        id="servo-load-grosmc",
        system="servo",
        statement="A load torque of 1 N m hardly affects the position under the robust law",
        source="section 2.3, Fig. 1, eqs. (8)+(12)",
        criterion="max |x1 - x1*| in case 1, at most 2 % of the step",
        why=SAME_WHY,
        measure=deviation("servo", "case1", "grosmc"),
        sense="at most",
        threshold=SAME,
        unit="%",
        plants=BOTH,
        untested="loads above the declared 1 N m; limits of the current",
        drawing=outputs("servo", "case1"),
    ),
    Claim(
        id="servo-load-lqr",
        system="servo",
        statement="The same load makes the LQR's position deviate",
        source="section 2.3, Fig. 1, eq. (5)",
        criterion="max |x1 - x1*| in case 1, at least 10 % of the step",
        why=SENSITIVE_WHY,
        measure=deviation("servo", "case1", "lqr"),
        sense="at least",
        threshold=SENSITIVE,
        unit="%",
        plants=BOTH,
        untested="an LQR with integral action, which would reject a constant load",
        drawing=outputs("servo", "case1"),
    ),
    Claim(
        id="servo-inertia-grosmc",
        system="servo",
        statement="Under three times the inertia the robust law responds as nominally",
        source="section 2.3, Fig. 2, eqs. (8)+(12)",
        criterion="max |x1 of case 2 - x1 nominal|, at most 2 % of the step",
        why=SAME_WHY,
        measure=changed_response("servo", "case2", "grosmc"),
        sense="at most",
        threshold=SAME,
        unit="%",
        plants=BOTH,
        untested="inertias outside 1 to 3 times the nominal one",
        drawing=outputs("servo", "case2"),
    ),
    Claim(
        id="servo-inertia-lqr",
        system="servo",
        statement="Under three times the inertia the LQR's position is different",
        source="section 2.3, Fig. 2",
        criterion="max |x1 of case 2 - x1 nominal|, at least 2 % of the step",
        why="the chapter says different, not by how much: more than what counts as the same",
        measure=changed_response("servo", "case2", "lqr"),
        sense="at least",
        threshold=SAME,
        unit="%",
        plants=BOTH,
        untested="other weights than Q = I, R = 1",
        drawing=outputs("servo", "case2"),
    ),
    Claim(
        id="servo-inertia-overshoot",
        system="servo",
        statement="Under three times the inertia the LQR has a bigger overshoot",
        source="section 2.3, Fig. 2",
        criterion="overshoot in case 2 less the nominal one, at least 1 % of the step",
        why="less cannot be read off a plot",
        measure=_overshoot_grows,
        sense="at least",
        threshold=1.0,
        unit="%",
        plants=BOTH,
        untested="other weights than the printed Q = I, R = 1, with which it may well overshoot",
        defect=True,
        equation=r"Q = I,\; R = 1 \;\Rightarrow\; K = [-1,\,-1.07],\quad "
        r"\zeta = \tfrac{\hat B - \hat K_t k_2}{2\sqrt{-\hat K_t k_1 J}} > 1 "
        r"\text{ for } J = \hat J \text{ and for } 3\hat J",
        drawing=outputs("servo", "case2"),
    ),
    Claim(
        id="servo-inertia-stability",
        system="servo",
        statement="Under three times the inertia the LQR's relative stability degrades",
        source="section 2.3, Fig. 2",
        criterion="loss of the closed loop's damping ratio, at least 10 %",
        why="the chapter names no measure of relative stability; a tenth of it is a plain loss",
        measure=_damping_falls,
        sense="at least",
        threshold=10.0,
        unit="%",
        plants=BOTH,
        untested="other measures: the slowest pole moves away from the axis, so by the degree of "
        "stability the loop gets better; the phase margin falls by less than a tenth",
        exact=True,
    ),
    Claim(
        id="servo-sliding",
        system="servo",
        statement="The motion is on the surface from the start and stays on it",
        source="section 2.4, Theorem 1, eq. (8)",
        criterion="sampled: max |s| in case 1 over one sample's worth of switching, at most 1",
        why="a sampled law cannot do better than one sample; more means that s was pushed away",
        measure=leaving_the_surface("servo", "case1"),
        sense="at most",
        threshold=1.0,
        unit="1",
        plants=BOTH,
        untested="measurement noise and delay",
        drawing=signals("servo", "case1", "s"),
    ),
    Claim(
        id="servo-index",
        system="servo",
        statement="With the law the index (13), of the continuous part of the input, is J*",
        source="Conclusion 1, eq. (13)",
        criterion="J with u_c over J*, less 1, in case 2, at most 1 %",
        why="sampling at 1 kHz costs a few tenths of a percent",
        measure=excess_cost("servo", "case2", "cost_continuous"),
        sense="at most",
        threshold=1.0,
        unit="%",
        plants=BOTH,
        untested="whether J* is the least of (13), see servo-index-minimal",
    ),
    Claim(
        id="servo-index-minimal",
        system="servo",
        statement="The performance index (13) is minimized",
        source="Conclusion 1, eq. (13)",
        criterion="least J of (13), with input that it leaves out, over J*, less 1, at least -1 %",
        why="a minimum cannot be undercut; 1 % as for the index itself",
        measure=_undercut,
        sense="at least",
        threshold=-1.0,
        unit="%",
        plants=("corrected",),
        untested="inputs other than linear feedback; the switching term itself aims elsewhere",
        defect=True,
        exact=True,
        equation=r"J = \tfrac12\int x^{\mathrm T}(Q + K^{\mathrm T}RK)\,x\,dt"
        r"\quad\text{falls with any } u_d \text{ that hurries } x",
    ),
    Claim(
        id="servo-whole-cost",
        system="servo",
        statement="The system designed is optimal, read as (4) with the whole input",
        source="Conclusion 1, section 2.4, eq. (4)",
        criterion="J with the whole u over J*, less 1, nominal, over 10 s, at most 5 %",
        why="5 % is what an engineer would still call optimal; (13) leaves u_d out of the bill",
        measure=excess_cost("servo", "nominal", "cost_whole"),
        sense="at most",
        threshold=5.0,
        unit="%",
        plants=BOTH,
        untested="switching laws other than sgn; longer runs, which cost more and more",
        defect=True,
        equation=r"J = \tfrac12\int_0^\infty x^{\mathrm T}Qx + u_c^{\mathrm T}Ru_c\,dt"
        r"\quad\text{leaves out}\quad u_d^{\mathrm T}Ru_d",
        drawing=signals("servo", "nominal", "u"),
    ),
    Claim(
        id="servo-circular-bound",
        system="servo",
        statement="Under three times the inertia Assumption 4 bounds the uncertainty by the state",
        source="Assumption 4, eq. (12), case 2",
        criterion="gain sized without the switching term, over the required one, at least 1",
        why="below 1 the surface is not guaranteed, though η and γ0 may have it to spare",
        measure=_naive_gain,
        sense="at least",
        threshold=1.0,
        unit="1",
        plants=BOTH,
        untested="gains found on line",
        defect=True,
        exact=True,
        equation=r"\tilde\delta = \Delta\tilde A\,x + \Delta\tilde B\,(u_c + u_d),\quad "
        r"1 + \Delta\tilde B = r = \tfrac13 \;\Rightarrow\; "
        r"|u_d| \ge \tfrac1r\,|\Delta\tilde A\,x + (r-1)u_c|",
        drawing=gains("servo", "case2"),
    ),
)
