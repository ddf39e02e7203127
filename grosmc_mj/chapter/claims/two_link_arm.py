"""Claims about several inputs, for which the chapter has the theory and no example."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.chapter.claims.claim import Claim, Curve, Drawing, Measured
from grosmc_mj.chapter.claims.measures import (
    BOTH,
    SAME,
    SAME_WHY,
    SENSITIVE,
    SENSITIVE_WHY,
    Measure,
    excess_cost,
    extrapolated,
    failed_premise,
    from_optimum,
    gains,
    leaving_the_surface,
    of,
    within,
)
from grosmc_mj.chapter.two_link_figures import true_tip
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.gains import Uncertainty, authority
from grosmc_mj.control.memory import SurfaceMemory
from grosmc_mj.experiments.experiment import Experiment, find_experiment
from grosmc_mj.experiments.laboratory import Laboratory, trial
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.premises.balance import balance
from grosmc_mj.report.palette import LABELS
from grosmc_mj.simulation.edits import BodyEdit

_SYSTEM = "two_link_arm"
_TRACKING, _ROBUST = ("case1", "case2"), ("case1", "case2", "regulation1")
_EVERY_CASE = ("nominal", "case1", "case2", "regulation", "regulation1")
_OTHERS = ("lqr", "pd")
# The rates that G picks out of z, each alone.
_RATES = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
# Samples of a run that are looked at: odd, so that both sides of the chatter are met.
_EVERY = 7
_PLANTS, _STATES, _POSES = 8, 20, 25


def _worst(cases: tuple[str, ...]) -> Measure:
    """Largest deviation of GROSMC from its optimum over cases, in percent of the start."""

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        results = [lab.case(_SYSTEM, name, plant, "grosmc") for name in cases]
        return _extreme(results, [from_optimum(result.comparison) for result in results], max)

    return measure


def _least(cases: tuple[str, ...]) -> Measure:
    """Smallest deviation of LQR and PD from their own optimum or plan, in percent of the start."""

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        results = [lab.case(_SYSTEM, case, plant, name) for case in cases for name in _OTHERS]
        return _extreme(results, [from_optimum(result.comparison) for result in results], min)

    return measure


def _extreme(results: list[RunResult], values: list[float], pick: Callable[..., int]) -> Measured:
    """The largest or the smallest of the values of several runs, and which; broken if one is."""
    for result, value in zip(results, values, strict=True):
        found = of(result, value)
        if found.broken:
            return found._replace(note=f"{_name(result)}: {found.note}")
    place = pick(range(len(values)), key=values.__getitem__)
    return Measured(values[place], _name(results[place]))


def _name(result: RunResult) -> str:
    """Which run."""
    return f"{result.case.name} under {LABELS.get(result.controller.name, result.controller.name)}"


def _at_samples(
    lab: Laboratory, result: RunResult, plant: PlantName
) -> Iterator[tuple[int, float, Array, Array]]:
    """Row, time, state and wrenches at some samples of a run."""
    run = result.trajectory
    nothing = np.zeros(6 * len(run.system.bodies))
    for row in range(0, len(run.time) - 1, _EVERY):
        w = nothing if run.wrench is None else run.wrench[row]
        yield row, float(run.time[row]), run.state[row], w


def _leaving(cases: tuple[str, ...]) -> Measure:
    """Largest |s_i| over what one sample of the switching term makes of it, over cases."""

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        results, values = [], []
        for name in cases:
            result = lab.case(_SYSTEM, name, plant, "grosmc")
            s = result.trajectory.sliding
            assert s is not None
            if not len(s) or np.any(s[0]):
                return of(result, None, f"{name} starts off its surface")
            found = leaving_the_surface(_SYSTEM, name)(lab, plant)
            if found.value is None:
                return found
            results.append(result)
            values.append(found.value)
        return _extreme(results, values, max)

    return measure


def _true_gain(
    law: Controller, derivative: Callable[[Array, ArrayLike, Array], Array], x: Array, w: Array
) -> Array:
    """E* of a plant's own accelerations, in the coordinates that the law believes in, (m, m)."""
    error, p = law.coordinates, law.parameters
    assert isinstance(error, ErrorCoordinates)
    m, rows = error.inputs, list(error.linearization.last_rows)
    slope = np.reshape(error.linearization.slope(x, p.plant), (error.size, len(x)))[rows]
    still = derivative(x, np.zeros(m), w)
    columns = [derivative(x, unit, w) - still for unit in np.eye(m)]
    return error.sign * slope @ np.array(columns).T


def _limit(cases: tuple[str, ...]) -> Measure:
    """Largest deviation over cases, extrapolated to a sampling time of zero, in percent."""

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        found = {name: extrapolated(_SYSTEM, name)(lab, plant) for name in cases}
        for judged in found.values():
            if judged.broken or judged.value is None:
                return judged
        worst = max(found.values(), key=lambda each: each.value or 0.0)
        return worst._replace(note="; ".join(f"{name} {each.note}" for name, each in found.items()))

    return measure


def _all_at_once() -> Experiment:
    """1 kg at the tip, links 5 % longer and every disturbance of case 1."""
    pushed, heavier = (find_experiment(_SYSTEM, name) for name in _TRACKING)
    start, edits = heavier.case.x0, heavier.case.edits
    return trial(_SYSTEM, "both", start, 6.0, edits, pushed.case.disturbances)


def _margin(make: Callable[[], tuple[Experiment, ...]]) -> Measure:
    """Least rho of the law over what is required of it along runs, by the true equations."""

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        results, values, notes = [], [], []
        for case in make():
            result = lab.run(case, plant, "grosmc")
            true, law = lab.equations(case, plant), result.controller
            worst, least = np.inf, np.inf
            for _, t, x, w in _at_samples(lab, result, plant):
                found = balance(law, true, t, x, w)
                least = min(least, found.gain_ratio)
                if found.required > 0:
                    worst = min(worst, found.configured / found.required)
            results.append(result)
            values.append(float(worst))
            notes.append(f"{case.case.name}: {worst:.3g}, least r {least:.3g}")
        return _extreme(results, values, min)._replace(note="; ".join(notes))

    return measure


def _declared() -> Uncertainty:
    """What the gain of the regulation is declared for."""
    declared = find_experiment(_SYSTEM, "regulation").uncertainty
    assert declared is not None
    return declared


def _projection(G: Array, payload: float | None = None) -> Measure:
    """Least authority over the declared poses and payloads up to ``payload`` times the nominal.

    Without a ``payload`` it is the largest that is declared.
    """

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        case = find_experiment(_SYSTEM, "regulation")
        law = lab.controller(case, plant, "grosmc")
        error, p = law.coordinates, law.parameters
        rows = list(error.linearization.last_rows)
        found = {"it": (np.inf, ""), "the law's own G": (np.inf, "")}
        projections = {"it": G[:, rows], "the law's own G": p.G[:, rows]}
        bound, nothing = _declared().region[2], np.zeros(18)
        most = payload or _declared().scales["mp"][1]
        for mass in np.linspace(1.0, most, 5).tolist():
            heavier = trial(_SYSTEM, "payload", case.case.x0, 1.0, (BodyEdit("payload", mass),))
            derivative = lab.derivative(lab.plant(heavier, plant))
            for turn in np.linspace(-bound, bound, _POSES).tolist():
                x = error.place(0.0, [0.0, 0.0, turn, 0.0], p)
                _, E = error.dynamics(0.0, x, p)
                E_true = _true_gain(law, derivative, x, nothing)
                for name, G_r in projections.items():
                    r = authority(G_r @ E_true @ np.linalg.inv(G_r @ E))
                    if r < found[name][0]:
                        found[name] = (r, f"{0.2 * mass:.2g} kg, q2 = {x[1]:.3g} rad")
        least, where = found["it"]
        own = found["the law's own G"][0]
        return Measured(float(least), f"at {where}; the law's own G keeps {own:.3g}")

    return measure


def _reaching(lab: Laboratory, plant: PlantName) -> Measured:
    """The largest s_i' sgn(s_i) + eta over the declared family, by the plant's own accelerations.

    The continuous reading: at each state the law is asked on all four sides of its two surfaces,
    and s' follows from x' there and then, without a time step.
    """
    random, worst = np.random.default_rng(1), -np.inf
    declared = _declared()
    low, high = declared.scales["mp"]
    start = find_experiment(_SYSTEM, "nominal").case.x0
    wrench = np.array(declared.wrench)
    law = lab.controller(find_experiment(_SYSTEM, "regulation"), plant, "grosmc")
    masses = [low, high, *random.uniform(low, high, _PLANTS - 2).tolist()]
    for mass in masses:
        heavier = trial(_SYSTEM, "reaching", start, 1.0, (BodyEdit("payload", mass),))
        derivative = lab.derivative(lab.plant(heavier, plant))
        for _ in range(_STATES):
            z = random.uniform(-1, 1, 4) * declared.region
            for *sides, push in itertools.product((-1.0, 1.0), repeat=3):
                rates = _approach(law, derivative, z, np.array(sides), push * wrench)
                worst = max(worst, float(rates.max()))
    own = float(getattr(law.parameters, "eta", 0.0))
    said = f"{len(masses)} payloads x {_STATES} states; the law's own η is {own:.3g}"
    return Measured(worst + declared.reaching_rate, said)


def _approach(
    law: Controller,
    derivative: Callable[[Array, ArrayLike, Array], Array],
    z: Array,
    sides: Array,
    w: Array,
) -> Array:
    """s_i' sgn(s_i) next to the surfaces on the named sides, (m,)."""
    error, p = law.coordinates, law.parameters
    x, memory = error.place(0.0, z, p), law.memory()
    assert isinstance(error, ErrorCoordinates)
    assert isinstance(memory, SurfaceMemory)
    # Any time but the start, at which the law takes z for its own z(0).
    memory.z0[:], memory.t = z - np.linalg.pinv(p.G) @ (1e-6 * sides), 1.0
    u = law.law(1.0, x, memory, p)
    slope = np.reshape(error.linearization.slope(x, p.plant), (error.size, len(x)))
    dz = error.sign * slope @ derivative(x, u, w)
    return sides * (p.G @ dz - p.S @ z)


def _off_the_circle(case: str) -> Measure:
    """Largest distance of the true tip from its reference in the last turn, in mm."""

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        result = lab.case(_SYSTEM, case, plant, "grosmc")
        last = within(result.comparison.time, 4.0)
        if not last.any():
            return Measured(None, result.ended, broken=True)
        there = true_tip(result)[last]
        off = np.linalg.norm(there - result.comparison.reference[last], axis=1)
        believed = 1e3 * float(result.comparison.error[last].max())
        return of(result, 1e3 * float(off.max()), f"by its own kinematics it is {believed:.2g} mm")

    return measure


def _bend(cases: tuple[str, ...], controllers: tuple[str, ...]) -> Measure:
    """Least |sin q2| along runs."""

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        results = [lab.case(_SYSTEM, case, plant, name) for case in cases for name in controllers]
        values = [float(np.abs(np.sin(result.trajectory.state[:, 1])).min()) for result in results]
        return _extreme(results, values, min)

    return measure


def _tip_path(case: str, controllers: tuple[str, ...]) -> Callable[[Laboratory], Drawing]:
    """The true tip in the plane on physics, and the circle."""

    def draw(lab: Laboratory) -> Drawing:
        curves = []
        for name in controllers:
            path = true_tip(lab.case(_SYSTEM, case, "physics", name))
            curves.append(Curve(LABELS.get(name, name), path[:, 0], path[:, 1], name))
        reference = lab.case(_SYSTEM, case, "physics", "grosmc").comparison.reference
        curves.append(Curve("reference", reference[:, 0], reference[:, 1]))
        return Drawing("tip x [m]", "tip z [m]", curves)

    return draw


def _from_optimum(case: str, scale: float, unit: str) -> Callable[[Laboratory], Drawing]:
    """The distance of each law from its own nominal trajectory, on physics."""

    def draw(lab: Laboratory) -> Drawing:
        curves = []
        for name in (*_OTHERS, "grosmc"):
            found = lab.case(_SYSTEM, case, "physics", name).comparison
            label = LABELS.get(name, name)
            curves.append(Curve(label, found.time, scale * found.deviation, name))
        return Drawing("time t [s]", f"distance from the optimum [{unit}]", curves)

    return draw


def _surfaces(case: str) -> Callable[[Laboratory], Drawing]:
    """Both sliding variables of GROSMC on physics."""

    def draw(lab: Laboratory) -> Drawing:
        result = lab.case(_SYSTEM, case, "physics", "grosmc")
        s, time = result.trajectory.sliding, result.trajectory.time[:-1]
        assert s is not None
        curves = [Curve("s₁", time, s[:, 0], "grosmc"), Curve("s₂", time, s[:, 1])]
        return Drawing("time t [s]", f"s [{result.controller.sliding_unit}]", curves)

    return draw


def _kinematics(_: Laboratory) -> str:
    """Which premise the length errors break."""
    return (
        "the output map y = h(x) is known (section 4.1: only the dynamics have an uncertain part); "
        "here h has the links' lengths in it, and the law regulates what it believes y to be"
    )


_NOT_IN_THE_CHAPTER = "the chapter has no example of several inputs"

CLAIMS = (
    Claim(
        id="two-link-rejects-d",
        system=_SYSTEM,
        statement="With two inputs the tracking law rejects disturbances of tip and link",
        source="section 4.2, eqs. (51)+(55) with m = 2; case 1 is this project's",
        criterion="max |y - y*| on the circle in case 1, at most 2 % of the start",
        why=SAME_WHY,
        measure=_worst(("case1",)),
        sense="at most",
        threshold=SAME,
        unit="%",
        plants=BOTH,
        untested="other frequencies and directions",
        premise=failed_premise(_SYSTEM, "case1"),
        drawing=_tip_path("case1", (*_OTHERS, "grosmc")),
    ),
    Claim(
        id="two-link-variations",
        system=_SYSTEM,
        statement="With two inputs the tracking law is robust to payload and link lengths",
        source="section 4.2, eqs. (51)+(55) with m = 2; case 2 is this project's",
        criterion="max |y - y*| on the circle in case 2, at most 2 % of the start, y = h(x) as "
        "the law believes it",
        why=SAME_WHY,
        measure=_worst(("case2",)),
        sense="at most",
        threshold=SAME,
        unit="%",
        plants=BOTH,
        untested="where the true tip is, see two-link-true-tip",
        premise=failed_premise(_SYSTEM, "case2"),
        drawing=_from_optimum("case2", 1e3, "mm"),
    ),
    Claim(
        id="two-link-linear-laws",
        system=_SYSTEM,
        statement="The optimal law alone and computed-torque PD are sensitive to both",
        source=f"section 4.2.1, eq. (49); {_NOT_IN_THE_CHAPTER}",
        criterion="least max |y - y*| of LQR and PD in cases 1 and 2, at least 10 % of the start",
        why=SENSITIVE_WHY,
        measure=_least(_TRACKING),
        sense="at least",
        threshold=SENSITIVE,
        unit="%",
        plants=BOTH,
        untested="stiffer weights and poles, which need more torque",
        drawing=_from_optimum("case1", 1e3, "mm"),
    ),
    Claim(
        id="two-link-regulation",
        system=_SYSTEM,
        statement="With two inputs the regulator withstands its declared payload and push",
        source="section 3.3, eqs. (31)+(37) with m = 2; the case is this project's",
        criterion="max |q - q*| under 0.6 kg and 5 N at the tip, at most 2 % of the start",
        why=SAME_WHY,
        measure=_worst(("regulation1",)),
        sense="at most",
        threshold=SAME,
        unit="%",
        plants=BOTH,
        untested="links of other lengths",
        premise=failed_premise(_SYSTEM, "regulation1"),
        drawing=_from_optimum("regulation1", 1.0, "rad"),
    ),
    Claim(
        id="two-link-regulation-linear-laws",
        system=_SYSTEM,
        statement="There too the optimal law alone and computed-torque PD are sensitive",
        source=f"section 3.3.1, eq. (28); {_NOT_IN_THE_CHAPTER}",
        criterion="least max |q - q*| of LQR and PD there, at least 10 % of the start",
        why=SENSITIVE_WHY,
        measure=_least(("regulation1",)),
        sense="at least",
        threshold=SENSITIVE,
        unit="%",
        plants=BOTH,
        untested="stiffer weights and poles, which need more torque",
    ),
    Claim(
        id="two-link-sliding",
        system=_SYSTEM,
        statement="Both sliding variables are zero from the start and stay so",
        source="Theorems 2 and 3, eqs. (31) and (51) with m = 2",
        criterion="sampled: max |s_i| in cases 1, 2 and regulation1 over one sample's worth of "
        "switching, 2 h ρ R_ii, at most 1",
        why="a sampled law cannot do better than one sample; more means that s was pushed away",
        measure=_leaving(_ROBUST),
        sense="at most",
        threshold=1.0,
        unit="1",
        plants=BOTH,
        untested="measurement noise and delay",
        premise=failed_premise(_SYSTEM, "case2"),
        drawing=_surfaces("case1"),
    ),
    Claim(
        id="two-link-sliding-dynamics",
        system=_SYSTEM,
        statement="On both surfaces the uncertain arm moves as its nominal optimum",
        source="eqs. (34) and (54) with m = 2",
        criterion="max |y - y*| in cases 1, 2 and regulation1, extrapolated to zero sampling "
        "time, at most 0.1 %",
        why="the equality is of the continuous law: the rest must vanish with the sampling time",
        measure=_limit(_ROBUST),
        sense="at most",
        threshold=0.1,
        unit="%",
        plants=BOTH,
        untested="sampling times below a quarter of a millisecond",
        premise=failed_premise(_SYSTEM, "case1"),
    ),
    Claim(
        id="two-link-reaching",
        system=_SYSTEM,
        statement="Theorem 2 with m = 2: each |s_i| falls at the declared rate at least",
        source="Theorem 2, eq. (39)",
        criterion="continuous: largest s_i' sgn(s_i) + η over the declared family, at most 1e-6",
        why="rounding; the gain makes up for R's loss of dominance, so η is not the law's own",
        measure=_reaching,
        sense="at most",
        threshold=1e-6,
        unit="rad/s²",
        plants=BOTH,
        untested="states and payloads that were not drawn; no sample proves a theorem",
        exact=True,
    ),
    Claim(
        id="two-link-gain",
        system=_SYSTEM,
        statement="The switching gains cover the declared disturbances and payloads",
        source="Theorem 3: ε >= (a_m + d_m) ‖GB‖, Assumption 6; with R's dominance counted",
        criterion="ρ over the required push / r along cases 1, 2 and regulation1, at least 1",
        why="below 1 the theorems do not apply",
        measure=_margin(lambda: tuple(find_experiment(_SYSTEM, name) for name in _ROBUST)),
        sense="at least",
        threshold=1.0,
        unit="1",
        plants=BOTH,
        untested="other starts; the operating region is in the audit of the premises",
        drawing=gains(_SYSTEM, "case2"),
    ),
    Claim(
        id="two-link-gain-together",
        system=_SYSTEM,
        statement="ε covers case 1 and case 2 together",
        source="Theorem 3: ε >= (a_m + d_m) ‖GB‖, with R's dominance counted",
        criterion="ε over the required push / r under 1 kg, 5 % longer links and all pushes, "
        "at least 1",
        why="below 1 the theorem does not apply",
        measure=_margin(lambda: (_all_at_once(),)),
        sense="at least",
        threshold=1.0,
        unit="1",
        plants=BOTH,
        untested="other starts and phases of the pushes",
    ),
    Claim(
        id="two-link-projection",
        system=_SYSTEM,
        statement="G = B+ serves the regulator's declared family, up to 0.6 kg",
        source="eq. (31): any G with G B nonsingular",
        criterion="least r over the declared poses and payloads with G = B+, at least 0",
        why="where r <= 0 no common switching gain drives back both s_i, whatever its size",
        measure=_projection(_RATES),
        sense="at least",
        threshold=0.0,
        unit="1",
        plants=BOTH,
        untested="gains that differ between the inputs, which are another way to weigh s",
        exact=True,
    ),
    Claim(
        id="two-link-projection-heavier",
        system=_SYSTEM,
        statement="So it does up to 1 kg",
        source="eq. (31): any G with G B nonsingular",
        criterion="least r over the declared poses and up to 1 kg with G = B+, at least 0",
        why="where r <= 0 no common switching gain drives back both s_i, whatever its size",
        measure=_projection(_RATES, 5.0),
        sense="at least",
        threshold=0.0,
        unit="1",
        plants=BOTH,
        untested="gains that differ between the inputs, which are another way to weigh s",
        defect=True,
        exact=True,
        equation=r"\dot s = \text{push} - \rho R\,\mathrm{sgn}(s),\quad "
        r"R = (GB\,E_*)(GB\,E)^{-1},\quad r = \min_i \big(R_{ii} - \sum_{j\ne i}|R_{ij}|\big)",
    ),
    Claim(
        id="two-link-true-tip",
        system=_SYSTEM,
        statement="The tip itself stays on the circle under links that are 5 % longer",
        source="section 4.2: robust tracking of y_r; case 2 is this project's",
        criterion="largest distance of the true tip from y_r in the last turn, at most 3 mm",
        why="2 % of the radius: what counts as the same elsewhere",
        measure=_off_the_circle("case2"),
        sense="at most",
        threshold=3.0,
        unit="mm",
        plants=BOTH,
        untested="a law that measures the tip instead of the joints",
        premise=_kinematics,
        drawing=_tip_path("case2", ("grosmc",)),
    ),
    Claim(
        id="two-link-true-tip-payload",
        system=_SYSTEM,
        statement="With the lengths known it does, whatever pushes",
        source="section 4.2: robust tracking of y_r; case 1 is this project's",
        criterion="largest distance of the true tip from y_r in the last turn, at most 3 mm",
        why="2 % of the radius: what counts as the same elsewhere",
        measure=_off_the_circle("case1"),
        sense="at most",
        threshold=3.0,
        unit="mm",
        plants=BOTH,
        untested="larger disturbances",
    ),
    Claim(
        id="two-link-relative-degree",
        system=_SYSTEM,
        statement="The runs stay where the decoupling matrix of the tip, J M^-1, is regular",
        source="eq. (21), Assumption 7: |det J| = l1 l2 |sin q2|",
        criterion="least |sin q2| along all five cases under GROSMC, at least 0.5",
        why="the circle bends the elbow to |sin q2| >= 0.64: a half leaves it 10 degrees more",
        measure=_bend(_EVERY_CASE, ("grosmc",)),
        sense="at least",
        threshold=0.5,
        unit="1",
        plants=BOTH,
        untested="other starts; the linear laws' runs come nearer",
    ),
    Claim(
        id="two-link-index",
        system=_SYSTEM,
        statement="With two inputs the regulator minimizes the index in spite of uncertainty",
        source="section 3.3, eq. (27) with m = 2",
        criterion="J with v_0 over J*, less 1, in regulation1, at most 1 %",
        why="as for the other systems: sampling at 1 kHz costs a few tenths of a percent",
        measure=excess_cost(_SYSTEM, "regulation1", "cost_continuous"),
        sense="at most",
        threshold=1.0,
        unit="%",
        plants=BOTH,
        untested="the same index with the whole v, see servo-whole-cost",
        premise=failed_premise(_SYSTEM, "regulation1"),
    ),
    Claim(
        id="two-link-index-tracking",
        system=_SYSTEM,
        statement="So does the tracking law, on the nominal arm at least",
        source="section 4.4, eq. (48) with m = 2",
        criterion="J with v_0 over J*, less 1, without disturbance, at most 1 %",
        why="as for the other systems: sampling at 1 kHz costs a few tenths of a percent",
        measure=excess_cost(_SYSTEM, "nominal", "cost_continuous"),
        sense="at most",
        threshold=1.0,
        unit="%",
        plants=BOTH,
        untested="sampling above 2 kHz and switching laws that do not chatter",
    ),
)
