"""The main job, from the command line, and its claims beside values by hand."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from commands import run
from conftest import Store, Stored
from rich.cells import cell_len

from grosmc_mj import cli
from grosmc_mj.arrays import Array
from grosmc_mj.chapter import expected_results as expected
from grosmc_mj.chapter.claims.ledger import CLAIMS
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.results.result import Result
from grosmc_mj.sweep import agreement

pytestmark = pytest.mark.slow

METRICS = {
    "deviation", "settling_time", "overshoot", "rms_error", "max_sliding", "rms_sliding",
    "cost_continuous", "cost_whole", "cost_optimal", "total_variation", "max_input",
}  # fmt: skip


def read(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "validation.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def everything(store: Store) -> Stored:
    """One ``validate`` of everything."""
    return store.command("validate")


def test_all_is_as_recorded_and_can_be_repeated(
    everything: Stored, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = everything.read("validation.json")
    result = Result.model_validate(document)
    assert (result.kind, result.complete, result.seed) == ("validation", True, 0)
    assert (document["differences"], document["as_recorded"]) == ([], True)
    assert (everything.code, result.answers[0].verdict) == (cli.DONE, "kept")
    assert len(document["configuration"]["cases"]) == 18
    for row in document["agreement"]:
        # The bound of the acceleration test; the printed equations are others.
        assert (row["acceleration"] < 1e-10) is (row["variant"] == "corrected")
    for one in document["runs"]:
        assert set(one["metrics"]) >= METRICS
        assert all(x["value"] is not None or x["note"] for x in one["metrics"].values())
        assert (one["status"], bool(one["gains"])) == ("completed", True)
    names = ("system", "case", "plant", "controller")
    keys = ["/".join(one[name] for name in names) for one in document["runs"]]
    assert sorted(keys) == sorted(expected.load_expected()["runs"])
    assert len(keys) == 127
    # Every law stands in every case by its requirement or by the record.
    standings = {(x.case, x.law): x for x in result.standings}
    ran = {(f"{x['system']}/{x['case']}", x["controller"]) for x in document["runs"]}
    assert standings.keys() == ran
    required, free = (standings["servo/case1", law] for law in ("grosmc", "lqr"))
    assert (required.required, free.required) == (True, False)
    assert required.words == "settles within: 4 of 5 s"
    assert free.words == "deviation: 1.42 rad, recorded 1.42"
    # On the benches LQR is required to do as well as the others, and does not.
    broken = {key for key, x in standings.items() if x.breaks_at}
    assert broken == {("arm/bench", "lqr"), ("cart_pendulum/bench", "lqr")}
    # The answer comes first; films, if there are any, come after it.
    answer, end, _ = everything.said.partition("validation.json\n")
    lines = f"{answer}{end}".rstrip("\n").split("\n")
    assert lines[0].startswith("All 127 runs are as recorded")
    assert len(lines) <= 40
    assert [line for line in lines if cell_len(line.rstrip()) > 100] == []
    figures = sorted(everything.folder.glob("fig*"))
    assert [path.name[:4] for path in figures] == [f"fig{i}" for i in range(1, 9) for _ in range(2)]
    assert all(path.stat().st_size > 20_000 for path in figures)
    assert not [*everything.folder.glob(".*"), *everything.folder.glob("*.part")]
    # Page and comparison read it.
    page = tmp_path / "report.html"
    assert run("report", everything.folder, "-o", page) == cli.DONE
    assert lines[0].partition(".")[0] in page.read_text(encoding="utf-8")
    assert run("diff", everything.folder, everything.folder, "--out", tmp_path) == cli.DONE
    assert "Nothing got worse" in capsys.readouterr().out


def test_a_result_that_is_not_as_recorded_is_named_and_exits_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded, moved = expected.load_expected(), tmp_path / "expected.json"
    recorded["runs"]["servo/nominal/physics/lqr"]["metrics"]["deviation"] *= 1.1
    recorded["runs"]["servo/nominal/physics/grosmc"]["status"] = "diverged"
    del recorded["runs"]["servo/nominal/corrected/lqr"]
    moved.write_text(json.dumps(recorded), encoding="utf-8")
    monkeypatch.setattr(expected, "EXPECTED_FILE", moved)
    arguments = ("validate", "servo/nominal", "--no-figures", "--out", tmp_path)
    assert run(*arguments) == cli.DIFFERS
    output = capsys.readouterr().out
    assert "servo/nominal/physics/lqr: deviation is" in output
    assert "servo/nominal/physics/grosmc: completed, recorded diverged" in output
    assert "servo/nominal/corrected/lqr: not recorded" in output
    broken = {x["law"]: x["breaks_at"] for x in read(tmp_path)["standings"]}
    assert broken == {"lqr": "record", "grosmc": ""}
    for record in (["--record"], []):
        assert run(*arguments, *record) == cli.DONE
    # So are equations that differ from MuJoCo.
    monkeypatch.setattr(agreement, "AGREEMENT_BOUND", 0.0)
    assert run(*arguments) == cli.DIFFERS
    output = " ".join(capsys.readouterr().out.split())
    assert "differs: servo, nominal: accelerations" in output
    content = read(tmp_path)
    assert (content["as_recorded"], bool(content["differences"])) == (False, True)


# The ledger of claims.


@pytest.fixture(scope="module")
def ledger(everything: Stored) -> dict[str, dict[str, Any]]:
    """The claims of the document by their ids."""
    return {claim["id"]: claim for claim in everything.read("validation.json")["claims"]}


@pytest.fixture(scope="module")
def value(ledger: dict[str, dict[str, Any]]) -> Callable[..., float]:
    """The value of a claim in MuJoCo."""
    return lambda claim: ledger[claim]["plants"]["physics"]["value"]


def test_the_ledger_is_as_expected(ledger: dict[str, dict[str, Any]]) -> None:
    assert list(ledger) == [claim.id for claim in CLAIMS]
    for own in CLAIMS:
        claim, plants = ledger[own.id], ledger[own.id]["plants"]
        verdicts = {plant: x["verdict"] for plant, x in plants.items()}
        assert verdicts == {plant: x.value for plant, x in own.verdicts.items()}, own.id
        assert claim["verdict"] == own.verdicts[own.plants[-1]].value
        assert bool(claim["because"]) <= (claim["verdict"] in ("premise not met", "undetermined"))
        for plant in plants.values():
            evidence = plant["evidence"]
            assert evidence["exact"] is own.exact
            if not own.exact:
                assert evidence["control_period"] == [1e-3, 5e-4]
                assert evidence["values"][0] == plant["value"]
        # Physics and the corrected equations agree on every claim that is not about equations.
        if plants.keys() >= {"corrected", "physics"} and "eq" not in own.id:
            physics, equations = (plants[x]["value"] for x in ("physics", "corrected"))
            if equations is not None:
                equations = pytest.approx(equations, rel=1e-6, abs=1e-6)
            assert physics == equations, own.id
    for name in ("arm-rejects-d", "arm-sliding", "arm-index"):
        assert "epsilon (Theorem 3" in ledger[name]["because"]


# The servo's closed loop by hand, for the printed K: J z1'' = -(B + Kt k2) z1' - Kt k1 z1 + T_d.
J, B, KT = 5.77e-2, 8.8e-3, 0.667
K1, K2 = 1.0, 1.0699444


def loop(inertia: float) -> Array:
    return np.array([[0.0, 1.0], [-KT * K1 / inertia, -(B + KT * K2) / inertia]])


def response(A: Array, z0: Any, push: Any, time: Array) -> Array:
    """z1 of z' = A z + push at the instants: exact, by the modes of A."""
    rest = np.linalg.solve(A, push)
    rates, modes = np.linalg.eig(A)
    shares = modes[0] * np.linalg.solve(modes, np.asarray(z0) + rest)
    return np.real(np.exp(np.outer(time, rates)) @ shares) - rest[0]


def test_servo_under_load_inertia_and_drift_is_its_linear_loop(
    ledger: dict[str, dict[str, Any]], value: Callable[..., float]
) -> None:
    """The load turns it back as a spring and a damper do: T_d/(Kt k1) = 1.5 rad at rest."""
    time = np.linspace(0, 3, 301)
    loaded = response(loop(J), [0, 0], [0.0, 1 / J], time)
    assert abs(loaded[-1]) < 1 / (KT * K1)
    assert value("servo-load-lqr") == pytest.approx(100 * loaded.max(), rel=1e-3)
    time = np.linspace(0, 10, 1001)
    nominal, heavy = (response(loop(k * J), [1.0, 0.0], [0, 0], time) for k in (1, 3))
    changed = 100 * np.abs(heavy - nominal).max()
    assert value("servo-inertia-lqr") == pytest.approx(changed, rel=2e-3)
    # zeta = (B + Kt k2) / (2 sqrt(Kt k1 J)) goes with 1/sqrt(J), and stays above 1.
    lost = 100 * (1 - 1 / math.sqrt(3))
    assert value("servo-inertia-stability") == pytest.approx(lost, rel=1e-6)
    zeta = (B + KT * K2) / (2 * math.sqrt(KT * K1 * 3 * J))
    note = ledger["servo-inertia-stability"]["plants"]["physics"]["note"]
    assert f"{zeta:.3g} under 3J" in note
    assert zeta > 1
    assert heavy.min() > 0
    assert value("servo-inertia-overshoot") == 0
    # A drift of the angle, unmatched: z2' = -(Kt k1 z1 + (B + Kt k2) z2)/J, z1' = z2 - 0.05.
    away = response(loop(J), [0, 0], [-0.05, 0.0], np.linspace(0, 5, 501))
    # 1 ms of chatter moves it by half a percent of itself; see the value at half the period.
    values = ledger["servo-unmatched"]["plants"]["corrected"]["evidence"]["values"]
    assert 2 * values[1] - values[0] == pytest.approx(100 * np.abs(away).max(), rel=2e-3)


def test_gains_that_are_sized_without_the_switching_term(
    ledger: dict[str, dict[str, Any]], value: Callable[..., float]
) -> None:
    """Servo: |(1 - j)(K x - B/Kt x2)| at j = 3, and r = 1/3 of it without the circle.

    Pendulum: r at the start, where the most is required; E = a c / (L (4/3 - a m c^2)), a =
    1/(M+m).
    """
    assert value("servo-circular-bound") == pytest.approx(1 / 3, rel=1e-9)
    gamma1 = 2 * math.hypot(K1, K2 + B / KT)
    note = ledger["servo-circular-bound"]["plants"]["physics"]["note"]
    assert note == f"γ1 = {gamma1 / 3:.3g} sized so, {gamma1:.4g} required"
    c = math.cos(math.pi / 18)
    E = [c / (1 + k * 0.2) / (k * 0.5 * (4 / 3 - k * 0.2 / (1 + k * 0.2) * c * c)) for k in (1, 4)]
    assert value("pendulum-naive-gain") == pytest.approx(E[1] / E[0], rel=1e-6)


def test_epsilon_falls_short_by_what_the_optimal_run_asks_for(value: Callable[..., float]) -> None:
    """d/M(q) along y_r + e*, without running anything: within what s leaves its surface by."""
    time = np.linspace(0, 6, 6001)
    K = np.array([math.sqrt(10), math.sqrt(1 + 2 * math.sqrt(10))])
    A = np.array([[0.0, 1.0], -K])
    e = response(A, [0.5, 0.0], [0, 0], time)
    M = 0.1 + 0.06 * np.sin(np.sin(np.pi * time) + e)
    needed = np.abs(0.5 * np.sin(2 * np.pi * time) / M).max()
    assert value("arm-epsilon") == pytest.approx(6 / needed, rel=0.02)


def test_cart_coasts_with_the_momentum_that_the_force_gave_it(value: Callable[..., float]) -> None:
    """(M + m) p' - m L cos(theta) theta' is the force's impulse: nothing else is horizontal."""
    lab = Laboratory(Settings())
    run = lab.case("cart_pendulum", "case2", "physics", "grosmc").trajectory
    impulse = np.cumsum(run.input * np.diff(run.time))
    row = int(np.searchsorted(run.time, 7.0))
    _, theta, speed, rate = run.state[row]
    momentum = 1.2 * speed - 0.2 * 0.5 * math.cos(theta) * rate
    assert momentum == pytest.approx(impulse[row - 1], rel=1e-6)
    assert value("pendulum-cart") == pytest.approx(abs(impulse[row - 1]) / 1.2, rel=0.01)


def test_linear_design_keeps_to_its_optimum_up_to_the_angle_that_the_claim_says(
    value: Callable[..., float],
) -> None:
    """Lagrange's equations under u = -K z, integrated continuously, beside z' = (A - b K) z."""
    # theta'' = (g sin + ...)/(L (4/3 - a m)) about upright, a = 1/1.2.
    D = 0.5 * (4 / 3 - 0.2 / 1.2)
    A, b = np.array([[0.0, 1.0], [9.8 / D, 0.0]]), np.array([[0.0], [1 / 1.2 / D]])
    P = scipy.linalg.solve_continuous_are(A, b, np.diag([100.0, 1.0]), np.eye(1))
    K = (b.T @ P)[0]

    def slope(_: float, z: Array) -> list[float]:
        s, c = math.sin(z[0]), math.cos(z[0])
        mass = [[1.2, -0.1 * c], [-0.1 * c, 4 / 3 * 0.2 * 0.25]]
        force = [-float(K @ z) - 0.1 * s * z[1] ** 2, 0.2 * 9.8 * 0.5 * s]
        return [z[1], float(np.linalg.solve(mass, force)[1])]

    def keeps(angle: float) -> bool:
        start, time = np.array([-math.radians(angle), 0.0]), np.linspace(0, 6, 601)
        # Sampling at 1 ms shifts the edge by far less than the 5 degrees of the claim's grid.
        run = scipy.integrate.solve_ivp(slope, (0, 6), start, t_eval=time, rtol=1e-8, atol=1e-10)
        optimum = response(A - b @ K[None], start, [0, 0], time)
        return bool(np.abs(run.y[0] - optimum).max() <= 0.02 * math.radians(angle))

    edge = value("pendulum-region-lqr")
    assert keeps(edge)
    assert not keeps(edge + 5)
