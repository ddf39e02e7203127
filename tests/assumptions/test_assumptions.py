"""The balance that decides whether s is held, and the premises computed from it."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from faults import FAULTS, OtherLaws
from shipped import ARM_G, find_case, nominal, robust, run_case, task_of

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions import audit as audits
from grosmc_mj.assumptions.audit import Audit, Premise, audit, run_audit
from grosmc_mj.assumptions.balance import Balance, balance
from grosmc_mj.chapter.premises import audit_document, audit_table, worst_points
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import tracking_grosmc
from grosmc_mj.control.memory import SurfaceMemory
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Laboratory, trial
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.results.document import json_text

# Edits that change mass and, where the chapter does, length.
EDITS = {
    "servo": (BodyEdit("rotor", 3.0),),
    "cart_pendulum": (BodyEdit("pole", 4.0, 4.0),),
    "arm": (BodyEdit("link", 2.0, 1.25),),
}
each_system = pytest.mark.parametrize("system", EDITS)


def state(law: Controller, t: float, z: Array) -> Array:
    """The plant's state at an error state, with the cart at rest."""
    system, sign = law.coordinates.system, law.coordinates.sign
    y_r, dy_r, _ = law.coordinates.reference(t, law.parameters.reference)
    x = np.zeros(len(system.states))
    x[system.output] = y_r + sign * z[0]
    x[system.output + system.degrees_of_freedom] = dy_r + sign * z[1]
    return x


def input_beside_surface(law: Controller, t: float, z: Array, s: float) -> Array:
    """The input of a law that is off its surface by s."""
    G = law.parameters.G[0]
    memory = SurfaceMemory(z0=z - s * G / (G @ G), t=t)
    u = law.input_at(t, state(law, t, z), memory)
    assert math.copysign(1.0, memory.s.item()) == math.copysign(1.0, s)
    return u


def surface_rate(law: Controller, t: float, z: Array, dx: Array) -> float:
    """s' = G z' - G (A - B K) z of eqs. (9), (32) and (52), from the plant's x'."""
    system, p = law.coordinates.system, law.parameters
    ddy_r = law.coordinates.reference(t, p.reference)[2]
    dz2 = law.coordinates.sign * (dx[system.output + system.degrees_of_freedom] - ddy_r)
    return float((p.G @ np.array([z[1], dz2]) - p.S @ z).item())


@each_system
def test_balance_is_the_rate_of_s_on_the_true_plant(system: str) -> None:
    """By the equations of the perturbed plant, and by MuJoCo, which does not know them.

    With the required rho s falls on both sides; with any less it grows on the pushed one.
    """
    law, random = robust(system), np.random.default_rng(7)
    plant = MujocoPlant.load(system, edits=EDITS[system])
    true, bodies = plant.analytic(), len(plant.system.bodies)
    for _ in range(20):
        t, z = random.uniform(0.1, 2), random.uniform(-0.4, 0.4, 2)
        w, x = random.uniform(-0.3, 0.3, 6 * bodies), state(law, t, z)
        found = balance(law, true, t, x, w)
        # The servo's input gain is K_t/J and nothing else.
        assert system != "servo" or found.gain_ratio == pytest.approx(1 / 3, rel=1e-12)

        def rate(
            u: Array, derivative: Any, t: float = t, z: Any = z, x: Any = x, w: Any = w
        ) -> Any:
            return surface_rate(law, t, z, derivative(x, u, w))

        # A and B of the servo's law are a Jacobian by differences, good to 1e-10.
        for derivative in (true.derivative, plant.derivative):
            pushed = rate(found.u_c, derivative)
            assert abs(pushed) == pytest.approx(found.push, rel=1e-8, abs=1e-8)
            for side in (-1e-9, 1e-9):
                back = math.copysign(found.gain_ratio * found.configured, side)
                beside = rate(input_beside_surface(law, t, z, side), derivative)
                assert beside == pytest.approx(pushed - back, rel=1e-7, abs=1e-7)
        jumps = [input_beside_surface(law, t, z, s) for s in (-1e-13, 1e-13)]
        assert sum(jumps) / 2 == pytest.approx(found.u_c, rel=1e-9, abs=1e-9)
        for factor in (1 + 1e-6, 1 - 1e-6):
            gains = {"eta": factor * found.required, "gamma0": 0.0, "gamma1": 0.0}
            if law.parameters.epsilon:
                gains = {"epsilon": factor * found.required}
            sized = replace(law, parameters=replace(law.parameters, **gains))
            configured = balance(sized, true, t, x, w).configured
            assert configured == pytest.approx(factor * found.required, rel=1e-12)
            # So near that k s of eq. (55) is below the change of the factor.
            sides = [
                side * rate(input_beside_surface(sized, t, z, 1e-11 * side), true.derivative)
                for side in (-1.0, 1.0)
            ]
            assert (max(sides) < 0) is (factor > 1)


@cache
def laboratory() -> Laboratory:
    return Laboratory(Settings())


@cache
def chapter_audit(system: str, case: str) -> Audit:
    return audit(laboratory(), find_experiment(system, case))


def premise(found: Audit, name: str) -> Premise:
    return next(each for each in found.premises if each.name == name)


@pytest.mark.slow
def test_input_gain_of_the_pendulum_over_its_region_is_the_lagrangian_s() -> None:
    """E = a cos / (L (4/3 - a m cos^2)), a = 1/(M+m): least at the region's edge, 0.22 upright."""
    p: Any = nominal("cart_pendulum").parameters

    def E(m: float, L: float, theta: float) -> float:
        c = math.cos(theta)
        return c / (p.M + m) / (L * (4 / 3 - m / (p.M + m) * c * c))

    def ratio(theta: float) -> float:
        return E(4 * p.m, 4 * p.L, theta) / E(p.m, p.L, theta)

    found = premise(chapter_audit("cart_pendulum", "case1"), "input gain")
    assert found.holds
    assert found.region is not None
    assert found.along is not None
    # The margins are measured from 1e-9, which is what the reading calls rounding.
    assert found.region.margin == pytest.approx(ratio(math.pi / 6), rel=1e-8)
    assert abs(found.region.worst.x[1]) == pytest.approx(math.pi / 6)
    assert ratio(math.pi / 18) <= found.along.margin + 2e-9 <= ratio(0) + 2e-9
    assert ratio(0) == pytest.approx(0.22, abs=0.005)


@pytest.mark.slow
def test_printed_epsilon_fails_by_the_closed_form_and_the_named_one_restores_it() -> None:
    """|d/M(q)| with M = 0.1 + 0.06 sin q: most at the lowest q of the region, and above 6."""
    case, T = find_experiment("arm", "case1"), Settings().control_period
    found = premise(chapter_audit("arm", "case1"), "epsilon")
    assert not found.holds
    assert found.region is not None
    assert found.along is not None
    M = 0.1 + 0.06 * math.sin(-1.5)
    assert found.region.margin == pytest.approx(6 - 0.5 / M, rel=1e-9)
    assert found.region.worst.x[0] == pytest.approx(-1.5)
    assert 0 < found.along.violated < 1
    named = re.match(
        r"ε = ([\d.]+) along this run, which leaves its surface, and ([\d.]+) over the region",
        found.restores,
    )
    assert named is not None, found.restores
    along, region = map(float, named.groups())
    # On the reference itself, from which the run parts by up to 2.5 % of a radian.
    t = np.linspace(0, 2, 20001)
    needed = np.abs(0.5 * np.sin(2 * np.pi * t) / (0.1 + 0.06 * np.sin(np.sin(np.pi * t))))
    assert along == pytest.approx(needed.max(), rel=0.02)
    assert region == pytest.approx(0.5 / M, rel=5e-3)
    # With it s stays within the step of one sample, and with less it does not.
    for epsilon in (1.01 * region, along, 0.9 * along):
        law = tracking_grosmc(task_of("arm", nominal("arm")), 18.0, epsilon, ARM_G)
        lab = OtherLaws(lambda *_, law=law: law)
        other = premise(audit(lab, case), "epsilon")
        assert other.along is not None
        assert other.holds is (epsilon == 1.01 * region)
        assert (other.along.margin >= 0) is (epsilon >= along)
        assert bool(other.restores) is not other.holds
        s = lab.case("arm", "case1", "physics", "grosmc").trajectory.sliding
        assert s is not None
        # The push is at most ε, and ε pushes back; k s adds its share of one sample.
        largest = float(np.abs(s).max()) / (2 * T * epsilon * (1 + 18 * T))
        assert (largest <= 1) is (epsilon >= along)
        assert not 1 < largest <= 1.5


@pytest.mark.slow
@each_system
def test_every_premise_holds_on_the_nominal_plant_and_documents_agree(system: str) -> None:
    found = chapter_audit(system, "nominal")
    assert found.failed() == []
    assert len({own.name for own in found.premises}) == len(found.premises) == 8
    # Nothing pushes: the model is the plant, up to the Jacobian's rounding.
    assert found.signals["required"].max() < 1e-9
    found = chapter_audit(system, "case1")
    content = json.loads(json_text(audit_document(found)))
    assert (content["system"], content["case"]) == (system, "case1")
    for written, own in zip(content["premises"], found.premises, strict=True):
        margins = [r["margin"] for r in (written["region"], written["along_run"]) if r]
        assert written["holds"] == (min(margins) >= 0) == own.holds
        assert bool(written["restored_by"]) <= (not own.holds)


def test_law_that_starts_off_its_surface_fails_that_premise_only() -> None:
    """With s shifted by a tenth: a reaching phase, as without -G x(0) in eq. (8)."""

    def shifted(law: Controller, *_: Any) -> Controller:
        def off(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
            law.law(t, x, memory, p, u)
            memory.s += 0.1

        return replace(law, law=off)

    lab = OtherLaws(shifted, Settings(engine="python"))
    found = audit(lab, trial("servo", "short", find_case("servo", "nominal").x0, 0.1))
    assert not premise(found, "s(0) = 0").holds
    # G B = 0, which a design refuses, of a law of one's own: a surface that no input steers.
    settings = Settings(engine="python")
    result = run_case(trial("servo", "short", (0.0, 0.0), 0.05).case, "physics", "grosmc", settings)
    for size in (1.0, 0.0):
        parameters = replace(result.controller.parameters, GB=size * np.eye(1))
        law = replace(result.controller, parameters=parameters)
        steered = premise(run_audit(replace(result, controller=law)), "G B nonsingular")
        assert (steered.holds, steered.note) == (bool(size), f"G B = {size:g}")


def test_pushes_on_two_bodies_need_not_point_the_same_way() -> None:
    """The least margin is that of the worst signs, whatever the signs of what is declared."""
    law, plant = robust("cart_pendulum"), nominal("cart_pendulum")
    together = np.zeros(12)
    together[[0, 6]] = 0.2, 0.3
    apart = together * np.repeat([1.0, -1.0], 6)
    # A force on the cart turns the upright pole the other way than one on the pole.
    upright = [balance(law, plant, 0.0, np.zeros(4), w) for w in (together, apart)]
    assert upright[1].required > upright[0].required
    margins = [audits.least_margin(law, plant, (0.1, 0.1), w) for w in (together, apart)]
    assert margins[0] == pytest.approx(margins[1], rel=1e-12)
    # A region of next to nothing is the pole upright.
    here = audits.least_margin(law, plant, (1e-9, 1e-9), together)
    assert here == pytest.approx(upright[1].configured - upright[1].required, rel=1e-6)


def test_premises_that_cannot_be_told_are_refused(tmp_path: Path) -> None:
    """About 2 rad the arm's cable has no direction: its laws end at 1.5 rad."""
    text = (
        '[plant]\nsystem = "arm"\n[task]\nreference = ["2"]\nQ = [[10, 2], [2, 1]]\nR = 1\n'
        'region = [0.1, 0.1]\n[run]\nduration = "0.01 s"\n'
        '[[controller]]\nlaw = "grosmc"\nk = 18\nepsilon = 6\nG = [[0, 1]]\n'
    )
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    run = Experiment.load(tmp_path / "mine.toml").with_settings(engine="python").run("physics")
    with pytest.raises(ArgumentError, match=r"nowhere in the .* \|z1\| <= 0\.1, \|z2\| <= 0\.1"):
        run_audit(run)
    beyond = find_experiment("arm", "nominal").varied(x0=(1.6, 0.0)).run("physics", "grosmc")
    with pytest.raises(ArgumentError, match=r"it ended at its start: .* cable has length zero"):
        run_audit(beyond)


@pytest.mark.slow
def test_a_law_without_gain_fails_with_advice_that_can_be_followed() -> None:
    found = audit(FAULTS["zero switching gain"](), find_experiment("arm", "case1"))
    failed = premise(found, "epsilon")
    assert failed.along is not None
    # Without a gain the margin is minus the requirement, and no multiple of it restores anything.
    assert failed.along.margin == pytest.approx(-found.signals["required"].max(), rel=0.05)
    assert audit_table(found).rows
    assert list(worst_points(found))
    assert failed.restores
    assert "inf" not in failed.restores
    # A law that does not switch has no such premises, and its requirement makes it fragile.
    found = audit(laboratory(), find_experiment("cart_pendulum", "case1"), "fl-lqr")
    names = {own.name for own in found.premises}
    assert not {"switching gain", "epsilon", "s(0) = 0", "G B nonsingular"} & names
    assert found.signals["configured"].max() == 0
    assert found.signals["required"].max() > 1


def test_worst_point_is_the_first_of_those_that_share_the_least_margin() -> None:
    points: Any = SimpleNamespace(t=np.arange(4.0), x=np.arange(4.0)[:, None])
    least = -6.45 * (1 + 4e-16)
    reading = audits.reading_of(points, np.array([2.0, -6.45, least, -6.4]))
    assert (reading.worst.t, reading.worst.x, reading.margin) == (1.0, (1.0,), least)
    assert reading.violated == 0.75
    # No multiple of no gain is enough.
    one = np.eye(1)
    for required, configured, times in ((3.0, 2.0, 1.5), (3.0, 0.0, math.inf), (0.0, 0.0, 0.0)):
        own = Balance(0.0, one[0], one, 1.0, one[0], 1.0, required, configured, 1.0, 0.0, one[0])
        assert own.times == times
