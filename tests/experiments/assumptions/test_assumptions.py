"""The balance that decides whether s is held, and the premises computed from it."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from faults import FAULTS, OtherLaws
from shipped import find_case, nominal, robust, run_case, surface_of, task_of

from grosmc_mj.chapter.premises import audit_document, audit_table, failures_table, worst_points
from grosmc_mj.experiments.assumptions import audit as audits
from grosmc_mj.experiments.assumptions.audit import Audit, Premise, Reading, audit, run_audit
from grosmc_mj.experiments.assumptions.balance import (
    Balance,
    Loads,
    balance,
    switching_rate,
)
from grosmc_mj.experiments.catalogue import chapter_controller, find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.run_cache import RunCache, trial
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.mechanics.physics.edits import BodyEdit
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.output.results.document import json_text
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.design import tracking_grosmc
from grosmc_mj.theory.control.memory import SurfaceMemory

# Edits that change mass and, where the chapter does, length.
EDITS = {
    "servo": (BodyEdit("rotor", 3.0),),
    "cart_pendulum": (BodyEdit("pole", 4.0, 4.0),),
    "arm": (BodyEdit("link", 2.0, 1.25),),
}
each_system = pytest.mark.parametrize("system", EDITS)


class OffSurface(NamedTuple):
    """A random instant of a perturbed plant: time [s], errors, wrenches, state and balance."""

    t: float
    z: Array
    w: Array
    x: Array
    balance: Balance


@cache
def perturbed(system: str) -> MujocoPlant:
    return MujocoPlant.load(system, edits=EDITS[system])


@cache
def instants(system: str) -> list[OffSurface]:
    """Twenty random instants of the perturbed plant."""
    law = robust(system)
    plant = perturbed(system)
    random = np.random.default_rng(7)
    rows = []
    for _ in range(20):
        t = random.uniform(0.1, 2)
        z = random.uniform(-0.4, 0.4, 2)
        w = random.uniform(-0.3, 0.3, 6 * len(plant.system.bodies))
        x = state(law, t, z)
        loads = Loads.of_wrench(w, plant.system)
        rows.append(OffSurface(t, z, w, x, balance(law, plant.analytic(), t, x, loads)))
    return rows


def state(law: Controller, t: float, z: Array) -> Array:
    """The plant's state at an error state, with the cart at rest."""
    system = law.coordinates.system
    sign = law.coordinates.sign
    y_r, dy_r, _ = law.coordinates.reference(t, law.parameters.reference)
    x = np.zeros(len(system.states))
    x[system.output] = y_r + sign * z[0]
    x[system.output + system.degrees_of_freedom] = dy_r + sign * z[1]
    return x


def input_beside_surface(law: Controller, t: float, z: Array, s: float) -> Array:
    """The input of a law that is off its surface by s."""
    G = law.parameters.G[0]
    memory = SurfaceMemory(z0=z - s * G / (G @ G), t=t, begun=1.0)
    u = law.input_at(t, state(law, t, z), memory)
    assert math.copysign(1.0, memory.s.item()) == math.copysign(1.0, s)
    return u


def surface_rate(law: Controller, t: float, z: Array, dx: Array) -> float:
    """s' = G z' - G (A - B K) z of eqs. (9), (32) and (52), from the plant's x'."""
    system = law.coordinates.system
    p = law.parameters
    ddy_r = law.coordinates.reference(t, p.reference)[2]
    dz2 = law.coordinates.sign * (dx[system.output + system.degrees_of_freedom] - ddy_r)
    return float((p.G @ np.array([z[1], dz2]) - p.S @ z).item())


def derivative_of(plant: MujocoPlant, equations: bool) -> Callable[..., Array]:
    """x' of the perturbed plant by its equations, or by MuJoCo, which does not know them."""
    if equations:
        return plant.analytic().derivative
    return plant.derivative


each_engine = pytest.mark.parametrize("equations", [True, False], ids=["equations", "mujoco"])


@each_engine
@each_system
def test_balance_is_the_rate_of_s_on_the_true_plant(system: str, equations: bool) -> None:
    law = robust(system)
    derivative = derivative_of(perturbed(system), equations)
    for t, z, w, x, at in instants(system):
        # A and B of the servo's law are a Jacobian by differences, good to 1e-10.
        pushed = surface_rate(law, t, z, derivative(x, at.u_c, w))
        assert abs(pushed) == pytest.approx(at.push, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("side", [-1e-9, 1e-9])
@each_engine
@each_system
def test_switching_drives_s_back_by_the_gain_ratio_times_its_gain(
    system: str, equations: bool, side: float
) -> None:
    law = robust(system)
    derivative = derivative_of(perturbed(system), equations)
    for t, z, w, x, at in instants(system):
        pushed = surface_rate(law, t, z, derivative(x, at.u_c, w))
        u = input_beside_surface(law, t, z, side)
        beside = surface_rate(law, t, z, derivative(x, u, w))
        back = math.copysign(at.gain_ratio * at.configured, side)
        assert beside == pytest.approx(pushed - back, rel=1e-7, abs=1e-7)


@each_system
def test_continuous_input_is_in_the_middle_of_the_switch(system: str) -> None:
    law = robust(system)
    for t, z, _, _, at in instants(system):
        below = input_beside_surface(law, t, z, -1e-13)
        above = input_beside_surface(law, t, z, 1e-13)
        assert (below + above) / 2 == pytest.approx(at.u_c, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("factor", [1 + 1e-6, 1 - 1e-6])
@each_system
def test_s_falls_on_both_sides_with_the_required_rate_only(system: str, factor: float) -> None:
    """With any less it grows on the pushed side."""
    law = robust(system)
    true = perturbed(system).analytic()
    for t, z, w, x, at in instants(system):
        rate = factor * at.required
        gains = {"eta": rate, "gamma0": 0.0, "gamma1": 0.0}
        if law.parameters.epsilon:
            gains = {"epsilon": rate}
        sized = replace(law, parameters=replace(law.parameters, **gains))
        configured = balance(sized, true, t, x, Loads.of_wrench(w, true.system)).configured
        assert configured == pytest.approx(rate, rel=1e-12)

        growth = []
        for side in (-1.0, 1.0):
            # So near that k s of eq. (55) is below the change of the factor.
            u = input_beside_surface(sized, t, z, 1e-11 * side)
            growth.append(side * surface_rate(law, t, z, true.derivative(x, u, w)))
        assert (max(growth) < 0) is (factor > 1)


def test_gain_ratio_of_the_servo_is_that_of_its_inertias() -> None:
    """The servo's input gain is K_t/J and nothing else."""
    for instant in instants("servo"):
        assert instant.balance.gain_ratio == pytest.approx(1 / 3, rel=1e-12)


@cache
def run_cache() -> RunCache:
    return RunCache(Settings())


@cache
def chapter_audit(system: str, case: str) -> Audit:
    return audit(run_cache(), find_experiment(system, case))


def premise(audited: Audit, name: str) -> Premise:
    return next(premise for premise in audited.premises if premise.name == name)


def readings(audited: Audit, name: str) -> tuple[Reading, Reading]:
    """A premise over the region and along the run."""
    both = premise(audited, name)
    assert both.region is not None
    assert both.along is not None
    return both.region, both.along


def pendulum_gain_ratio(theta: float) -> float:
    """E of case 1's pole over that of the nominal one.

    E = a cos / (L (4/3 - a m cos^2)), a = 1/(M+m).
    """
    p: Any = nominal("cart_pendulum").parameters
    c = math.cos(theta)

    def E(m: float, L: float) -> float:
        return c / (p.M + m) / (L * (4 / 3 - m / (p.M + m) * c * c))

    return E(4 * p.m, 4 * p.L) / E(p.m, p.L)


@pytest.mark.slow
def test_input_gain_of_the_pendulum_over_its_region_is_the_lagrangian_s() -> None:
    """It is least at the region's edge, and 0.22 upright."""
    audited = chapter_audit("cart_pendulum", "case1")
    region, along = readings(audited, "input gain")
    assert premise(audited, "input gain").holds
    # The margins are measured from 1e-9, which is what the reading calls rounding.
    assert region.margin == pytest.approx(pendulum_gain_ratio(math.pi / 6), rel=1e-8)
    assert abs(region.x[1]) == pytest.approx(math.pi / 6)
    upright = pendulum_gain_ratio(0)
    assert pendulum_gain_ratio(math.pi / 18) <= along.margin + 2e-9 <= upright + 2e-9
    assert upright == pytest.approx(0.22, abs=0.005)


@pytest.mark.slow
def test_printed_epsilon_fails_by_the_closed_form() -> None:
    """|d/M(q)| with M = 0.1 + 0.06 sin q: most at the lowest q of the region, and above 6."""
    audited = chapter_audit("arm", "case1")
    region, along = readings(audited, "epsilon")
    assert not premise(audited, "epsilon").holds
    M = 0.1 + 0.06 * math.sin(-1.5)
    assert region.margin == pytest.approx(6 - 0.5 / M, rel=1e-9)
    assert region.x[0] == pytest.approx(-1.5)
    assert 0 < along.violated < 1


def named_epsilons() -> tuple[float, float]:
    """Gains that restore the premise along the run of the arm's case 1, and over the region."""
    restores = premise(chapter_audit("arm", "case1"), "epsilon").restores
    named = re.match(
        r"ε = ([\d.]+) along this run, which leaves its surface, and ([\d.]+) over the region",
        restores,
    )
    assert named is not None, restores
    return float(named[1]), float(named[2])


@pytest.mark.slow
def test_named_epsilons_are_the_closed_form_s() -> None:
    along, region = named_epsilons()
    # On the reference itself, from which the run parts by up to 2.5 % of a radian.
    t = np.linspace(0, 2, 20001)
    needed = np.abs(0.5 * np.sin(2 * np.pi * t) / (0.1 + 0.06 * np.sin(np.sin(np.pi * t))))
    assert along == pytest.approx(needed.max(), rel=0.02)
    M = 0.1 + 0.06 * math.sin(-1.5)
    assert region == pytest.approx(0.5 / M, rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gain", "in_region", "along_run"),
    [("1.01 region", True, True), ("along", False, True), ("0.9 along", False, False)],
)
def test_named_epsilons_restore_the_premise(gain: str, in_region: bool, along_run: bool) -> None:
    """With them s stays within the step of one sample, and with less it does not."""
    along, region = named_epsilons()
    epsilon = {"1.01 region": 1.01 * region, "along": along, "0.9 along": 0.9 * along}[gain]
    law = tracking_grosmc(task_of("arm", nominal("arm")), 18.0, epsilon, surface_of("arm"))
    lab = OtherLaws(lambda *_: law)

    audited = audit(lab, find_experiment("arm", "case1"))
    sized = premise(audited, "epsilon")
    assert sized.holds is in_region
    assert bool(sized.restores) is not sized.holds
    _, reading = readings(audited, "epsilon")
    assert (reading.margin >= 0) is along_run

    s = lab.case("arm", "case1", "physics", "grosmc").trajectory.sliding
    assert s is not None
    # The push is at most ε, and ε pushes back; k s adds its share of one sample.
    T = Settings().control_period
    largest = float(np.abs(s).max()) / (2 * T * epsilon * (1 + 18 * T))
    assert (largest <= 1) is along_run
    assert not 1 < largest <= 1.5


def test_the_switching_rate_is_the_gain_times_both_gains_and_the_bound_over_the_input() -> None:
    """2.5 (epsilon + eta + (gamma0 + gamma1 |z|) |G E|) with |z| = 5 and |G E| = 2."""
    p = robust("servo").parameters
    numbers = replace(
        p,
        epsilon=0.3,
        eta=0.2,
        gamma0=0.7,
        gamma1=0.1,
        switching=replace(p.switching, gain=2.5),
    )
    law: Any = SimpleNamespace(z=np.array([[3.0, 4.0]]), GE=np.array([[[1.2, 0.0], [0.0, 1.6]]]))
    assert switching_rate(numbers, law) == pytest.approx([2.5 * (0.5 + 1.2 * 2)])


@pytest.mark.slow
@each_system
def test_every_premise_holds_on_the_nominal_plant(system: str) -> None:
    audited = chapter_audit(system, "nominal")
    assert audited.failed() == []
    names = {premise.name for premise in audited.premises}
    assert len(names) == len(audited.premises) == 8
    # Nothing pushes: the model is the plant, up to the Jacobian's rounding.
    assert audited.signals["required"].max() < 1e-9


@pytest.mark.slow
@each_system
def test_documents_agree_with_their_audits(system: str) -> None:
    audited = chapter_audit(system, "case1")
    content = json.loads(json_text(audit_document(audited)))
    assert (content["system"], content["case"]) == (system, "case1")
    for written, premise in zip(content["premises"], audited.premises, strict=True):
        readings = [written["region"], written["along_run"]]
        least = min(reading["margin"] for reading in readings if reading)
        assert written["holds"] == (least >= 0) == premise.holds
        assert bool(written["restored_by"]) <= (not premise.holds)


def test_law_that_starts_off_its_surface_fails_that_premise_only() -> None:
    """With s shifted by a tenth: a reaching phase, as without -G x(0) in eq. (8)."""

    def shifted(law: Controller, *_: Any) -> Controller:
        def off(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
            law.law(t, x, memory, p, u)
            memory.s += 0.1

        return replace(law, law=off)

    lab = OtherLaws(shifted, Settings(engine="python"))
    audited = audit(lab, trial("servo", "short", find_case("servo", "nominal").x0, 0.1))
    assert not premise(audited, "s(0) = 0").holds


@pytest.mark.parametrize("GB", [1.0, 0.0])
def test_a_surface_that_no_input_steers_fails(GB: float) -> None:
    """G B = 0, which a design refuses, of a law of one's own."""
    settings = Settings(engine="python")
    result = run_case(trial("servo", "short", (0.0, 0.0), 0.05), "physics", "grosmc", settings)
    parameters = replace(result.controller.parameters, GB=GB * np.eye(1))
    law = replace(result.controller, parameters=parameters)
    steered = premise(run_audit(replace(result, controller=law)), "G B nonsingular")
    assert steered.holds is (GB != 0)
    assert steered.note == f"G B = {GB:g}"


# A force on each of the pendulum's two bodies [N].
TOGETHER = np.zeros(12)
TOGETHER[[0, 6]] = 0.2, 0.3
APART = TOGETHER * np.repeat([1.0, -1.0], 6)


def on_cart_and_pole(wrench: Array) -> Loads:
    return Loads.of_wrench(wrench, nominal("cart_pendulum").system)


def test_a_force_on_the_cart_turns_the_upright_pole_against_one_on_the_pole() -> None:
    law = robust("cart_pendulum")
    plant = nominal("cart_pendulum")
    together = balance(law, plant, 0.0, np.zeros(4), on_cart_and_pole(TOGETHER))
    apart = balance(law, plant, 0.0, np.zeros(4), on_cart_and_pole(APART))
    assert apart.required > together.required


def least_margin_in(law: Any, plant: Any, bound: tuple[float, ...], largest: Any) -> float:
    """Configured less required switching rate, the least of an operating region."""
    points = audits._region_balance(law, plant, bound, largest, audits._GRID, 1)
    return float(points.margin.min())


def test_a_current_pushes_as_its_torque_does() -> None:
    """J w' = Kt (i + d) + load: d of the input is the load Kt d. The rotor turns about -y."""
    plant = MujocoPlant.load("servo").analytic()
    law = chapter_controller("grosmc", plant)
    x = np.array([0.3, -0.2])
    d = 0.25
    torque = np.array([0, 0, 0, 0, -plant.parameters.Kt * d, 0])
    load = Loads.of_wrench(torque, plant.system)
    current = Loads.none(plant.system, 1)._replace(input=np.array([[d]]))
    loaded = balance(law, plant, 0.0, x, load)
    disturbed = balance(law, plant, 0.0, x, current)
    assert disturbed.pushes == pytest.approx(loaded.pushes, rel=1e-12)

    least_loaded = least_margin_in(law, plant, (0.1, 0.1), load)
    least = least_margin_in(law, plant, (0.1, 0.1), current)
    assert least == pytest.approx(least_loaded, rel=1e-12)


def test_the_least_margin_is_that_of_the_worst_signs() -> None:
    """Whatever the signs of the declared forces: two need not point the same way."""
    law = robust("cart_pendulum")
    plant = nominal("cart_pendulum")
    together = least_margin_in(law, plant, (0.1, 0.1), on_cart_and_pole(TOGETHER))
    apart = least_margin_in(law, plant, (0.1, 0.1), on_cart_and_pole(APART))
    assert together == pytest.approx(apart, rel=1e-12)
    # A region of next to nothing is the pole upright.
    upright = balance(law, plant, 0.0, np.zeros(4), on_cart_and_pole(APART))
    smallest = least_margin_in(law, plant, (1e-9, 1e-9), on_cart_and_pole(TOGETHER))
    assert smallest == pytest.approx(upright.configured - upright.required, rel=1e-6)


BEYOND_CABLE = """
[plant]
system = "arm"
[task]
reference = ["2"]
Q = [[10, 2], [2, 1]]
R = 1
region = [0.1, 0.1]
[run]
duration = "0.01 s"
[[controller]]
law = "grosmc"
k = 18
epsilon = 6
G = [[0, 1]]
"""


def test_premises_of_a_region_where_laws_are_undefined_are_refused(tmp_path: Path) -> None:
    """About 2 rad the arm's cable has no direction: its laws end at 1.5 rad."""
    (tmp_path / "mine.toml").write_text(BEYOND_CABLE, encoding="utf-8")
    run = Experiment.load(tmp_path / "mine.toml").changed(engine="python").run("physics")
    with pytest.raises(ArgumentError, match=r"nowhere in the .* \|z1\| <= 0\.1, \|z2\| <= 0\.1"):
        run_audit(run)


def test_premises_of_a_run_that_ended_at_its_start_are_refused() -> None:
    run = find_experiment("arm", "nominal").changed(x0=(1.6, 0.0)).run("physics", "grosmc")
    with pytest.raises(ArgumentError, match=r"it ended at its start: .* cable has length zero"):
        run_audit(run)


def test_premises_of_a_law_with_dynamics_of_its_own_are_refused() -> None:
    run = find_experiment("servo", "nominal").changed(duration=0.01).run("physics", "fl-pid")
    with pytest.raises(ArgumentError, match=r"fl-pid: premises are told of laws v = -K z"):
        run_audit(run)


@pytest.mark.slow
def test_a_law_without_gain_fails_with_advice_that_can_be_followed() -> None:
    audited = audit(FAULTS["zero switching gain"](), find_experiment("arm", "case1"))
    failed = premise(audited, "epsilon")
    assert failed.along is not None
    # Without a gain the margin is minus the requirement, and no multiple of it restores anything.
    assert failed.along.margin == pytest.approx(-audited.signals["required"].max(), rel=0.05)
    assert audit_table(audited).rows
    assert list(worst_points(audited))
    assert failed.restores
    assert "inf" not in failed.restores


@pytest.mark.slow
def test_a_law_that_does_not_switch_has_no_premises_of_switching() -> None:
    """Its requirement makes it fragile."""
    audited = audit(run_cache(), find_experiment("cart_pendulum", "case1"), "fl-lqr")
    names = {premise.name for premise in audited.premises}
    assert not {"switching gain", "epsilon", "s(0) = 0", "G B nonsingular"} & names
    assert audited.signals["configured"].max() == 0
    assert audited.signals["required"].max() > 1


def test_worst_point_is_the_first_of_those_that_share_the_least_margin() -> None:
    points: Any = SimpleNamespace(t=np.arange(4.0), x=np.arange(4.0)[:, None])
    least = -6.45 * (1 + 4e-16)
    reading = audits.reading_of(points, np.array([2.0, -6.45, least, -6.4]))
    assert (reading.t, reading.x, reading.margin) == (1.0, (1.0,), least)
    assert reading.violated == 0.75


@pytest.mark.parametrize(("region", "along"), [(-3.0, -1.0), (-1.0, -3.0), (2.0, -3.0)])
def test_a_premise_is_as_bad_as_at_the_worse_of_its_region_and_its_run(
    region: float, along: float
) -> None:
    failing = premise_of("worse", region, along)
    (row,) = failures_table([audit_of_premises(failing)]).rows
    assert row[2] == "-3 A/s (100 %)"


def test_the_premise_with_the_largest_shortfall_comes_first() -> None:
    small = premise_of("small", -2.0, 5.0)
    large = premise_of("large", 5.0, -4.0)
    rows = failures_table([audit_of_premises(small, large)]).rows
    assert [row[1] for row in rows] == ["large", "small"]


def premise_of(name: str, region: float, along: float) -> Premise:
    """A premise with these margins [A/s] in its region and along its run."""
    return Premise(
        name,
        "Assumption 4",
        "as required",
        "A/s",
        region=audits.single_reading(region),
        along=audits.single_reading(along),
    )


def audit_of_premises(*premises: Premise) -> Audit:
    return Audit(find_experiment("servo", "nominal"), "grosmc", premises)


LIMIT = 0.2


def test_a_limit_of_the_nominal_input_is_one_of_the_reaching_condition() -> None:
    """s' = G (z' - A z - B u_c), u_c = -K z within its limit: what the limit cuts is no push."""
    law = robust("servo")
    limited = replace(law, parameters=replace(law.parameters, limit=LIMIT))
    p = limited.parameters
    A = law.designed.lqr.A
    B = law.designed.lqr.B
    derivative = perturbed("servo").derivative

    cut = 0
    for t, z, w, x, _ in instants("servo"):
        true = perturbed("servo").analytic()
        at = balance(limited, true, t, x, Loads.of_wrench(w, true.system))
        nominal = float(-(p.K @ z)[0])
        cut += abs(nominal) > LIMIT
        assert at.u_c == pytest.approx(np.clip(nominal, -LIMIT, LIMIT))

        dz = limited.coordinates.sign * derivative(x, at.u_c, w)
        pushed = p.G @ (dz - A @ z - B @ at.u_c)
        assert at.pushes == pytest.approx(pushed, rel=1e-8, abs=1e-8)
    assert 5 < cut < 20


@pytest.mark.parametrize(
    ("required", "configured", "times"),
    [(3.0, 2.0, 1.5), (3.0, 0.0, math.inf), (0.0, 0.0, 0.0)],
)
def test_no_multiple_of_no_gain_is_enough(required: float, configured: float, times: float) -> None:
    at = instants("servo")[0].balance
    assert at._replace(required=required, configured=configured).times == times
