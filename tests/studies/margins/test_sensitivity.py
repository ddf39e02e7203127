"""Margins by injection against exact transfer functions, and against the theory of relays."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from typing import Any

import control
import numpy as np
import pytest
import scipy.linalg
import sympy as sp

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.simulation.loop import Computing, Loop
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.studies.margins.frequency_response import (
    Margins,
    disk_together,
    interpolation_errors,
    margins_of,
    scaled_norm,
)
from grosmc_mj.studies.margins.multisine import multisine
from grosmc_mj.studies.margins.sensitivity import (
    LoopPlace,
    LoopSensitivity,
    RunningLoop,
    measure,
    measure_with_tests,
)
from grosmc_mj.studies.target import chosen_laws
from grosmc_mj.theory.control.controller import Controller, Sampled
from grosmc_mj.theory.control.memory import Memory, memory_of
from grosmc_mj.theory.plants.affine import affine_plant

T = 1e-3
PERCENT = 0.01
# 25/(s^3 + 10 s^2 + 10 s + 10), and the spinning satellite of the textbooks, a = 10.
THIRD_ORDER = control.tf([25], [1, 10, 10, 10])
SPIN = 10.0
# Limit cycle [Hz] and gain for slow signals of a relay with that plant: the locus of a perturbed
# relay system (Boiko).
RELAY_FREQUENCY = 0.4881
RELAY_GAIN = 1.969


def unity(t: float, x: Any, memory: Any, p: Any) -> float:
    """Unity feedback of the first state."""
    return -x[0]


def saturated(t: float, x: Any, memory: Any, p: Any) -> float:
    """Unity feedback of the first state within 0.5."""
    return min(0.5, max(-0.5, -x[0]))


def relay(t: float, x: Any, memory: Any, p: Any) -> float:
    """Switch with the sign of the first state."""
    return -1.0 if x[0] > 0 else 1.0


def satellite_law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    """Unity feedback of both outputs of the satellite."""
    u[0] = -(x[0] + SPIN * x[1])
    u[1] = -(-SPIN * x[0] + x[1])


def third_order(law: Any) -> RunningLoop:
    """Return a loop about 25/(s^3 + 10 s^2 + 10 s + 10)."""
    x1, x2, x3 = sp.symbols("x1 x2 x3")
    plant = affine_plant(
        "third_order",
        states={"x1": "rad", "x2": "rad/s", "x3": "rad/s^2"},
        inputs={"u": "1"},
        f=(x2, x3, -10 * x1 - 10 * x2 - 10 * x3),
        g=(0, 0, 25),
        h=(x1,),
        parameters={},
    )
    return RunningLoop(plant, Controller("law", law, Sampled()), np.zeros(3), T, T, threads=1)


def third_order_sensitivity(frequency: Array, gain: float) -> Any:
    """Return S with L = 25 gain/(s^3 + 10 s^2 + 10 s + 10)."""
    return 1 / (1 + 25 * gain / np.polyval([1, 10, 10, 10], 2j * np.pi * frequency))


@cache
def dense_margins(gain: float) -> Margins:
    """Return the margins of L = 25 gain/(s^3 + 10 s^2 + 10 s + 10) by 30,000 frequencies."""
    dense = np.geomspace(1e-3, 400, 30_000)
    return margins_of(dense, third_order_sensitivity(dense, gain))


def satellite() -> RunningLoop:
    """Return the spinning satellite with unity feedback."""
    x1, x2 = sp.symbols("x1 x2")
    plant = affine_plant(
        "satellite",
        states={"x1": "rad/s", "x2": "rad/s"},
        inputs={"u1": "N m", "u2": "N m"},
        f=(SPIN * x2, -SPIN * x1),
        g=((1, 0), (0, 1)),
        h=(x1 + SPIN * x2, -SPIN * x1 + x2),
        parameters={},
    )
    memory = memory_of(Memory, m=2)
    law = Controller("unity", satellite_law, Sampled(), memory=memory)
    return RunningLoop(plant, law, np.zeros(2), T, T, threads=1)


def bench(system: str, name: str, delay: float = 0.0) -> RunningLoop:
    """Return a law of a bench on its equations, with all states known and a delay [s]."""
    experiment = Experiment.load(f"{system}/bench").changed(loop=None)
    (law,) = chosen_laws(experiment, [name])
    controller = law.controller
    loop = experiment.loop_around(controller, Loop(Computing(delay=delay)))
    rest = controller.designed.error.rest(controller.parameters)
    settings = experiment.settings
    plant = experiment.plant("corrected")
    timestep = settings.timestep
    return RunningLoop(plant, controller, rest, T, timestep, loops=(loop,), threads=1)


def exact(running: RunningLoop, delay: float) -> tuple[Margins, float]:
    """Return the margins and the disk margin of a linear law on the linearization.

    Its gain is taken from the law by differences.
    """
    law = running.controller
    A, B = running.plant.linearization(running.x0, 0.0)
    rows = []
    for direction in 1e-6 * np.eye(len(A)):
        above = law.input_at(0.0, running.x0 + direction, law.memory())
        below = law.input_at(0.0, running.x0 - direction, law.memory())
        rows.append(-(above - below) / 2e-6)
    K = np.array(rows).T

    sampled = control.c2d(control.ss(A, B, K, 0), T)
    samples = round(delay / T)
    late = control.tf([1], [1, *[0] * samples], T)
    frequency = np.geomspace(0.02, 499, 20_000)
    L = control.series(sampled, late)(np.exp(2j * np.pi * frequency * T))
    return margins_of(frequency, 1 / (1 + L)), 1 / np.max(np.abs(1 / (1 + L) - 0.5))


def close(measured: float, expected: float, relative: float = PERCENT) -> bool:
    """Return whether two numbers agree."""
    return measured == pytest.approx(expected, rel=relative)


@pytest.mark.parametrize(
    "place", [LoopPlace("u"), LoopPlace("x1", output=True)], ids=["input", "output"]
)
def test_the_margins_of_a_third_order_loop_are_those_of_its_transfer_function(
    place: LoopPlace,
) -> None:
    margins = measure(third_order(unity), place, multisine(40, T), 1.0, realizations=2).margins
    assert close(margins.gain_up, 3.582)
    assert close(margins.phase, 29.06)
    assert close(margins.delay, 0.2842)
    assert close(margins.disk, 0.4572)


def test_the_sensitivity_at_the_lines_is_that_of_the_sampled_plant() -> None:
    """Held over the control period, an injection leaves no error of sampling."""
    loop = third_order(unity)
    measured = measure(loop, LoopPlace("u"), multisine(80, T), 1.0, realizations=1)
    frequency = measured.multisine.frequencies
    sampled = control.c2d(control.ss(THIRD_ORDER), T)
    expected = 1 / (1 + sampled(np.exp(2j * np.pi * frequency * T)))
    assert np.abs(measured.at_place[0] / expected - 1).max() < 1e-5


def test_the_margins_of_the_servo_with_lqr_and_20_ms() -> None:
    loop = bench("servo", "lqr", 0.02)
    margins = measure(loop, LoopPlace("current"), multisine(10, T), 1e-3, realizations=2).margins
    theory, disk = exact(loop, 0.02)
    assert close(margins.gain_up, 6.153)
    assert close(margins.phase, 71.83)
    assert close(margins.delay, 0.1011)
    assert close(margins.disk, 1.272)
    assert close(margins.gain_up, theory.gain_up)
    assert close(margins.delay, theory.delay)
    assert close(margins.disk, disk)


@pytest.mark.slow
def test_the_margins_of_the_pendulum_with_lqr_and_2_ms() -> None:
    loop = bench("cart_pendulum", "lqr", 0.002)
    margins = measure(loop, LoopPlace("force"), multisine(10, T), 1e-3, realizations=2).margins
    theory, disk = exact(loop, 0.002)
    assert close(margins.gain_up, 68.92)
    assert close(margins.phase, 60.50)
    assert close(margins.delay, 0.1309)
    assert close(margins.disk, 0.7925)
    assert close(margins.gain_down, theory.gain_down, 0.05)
    assert close(margins.disk, disk)


def test_a_pole_beyond_the_axis_bounds_the_gain_from_below() -> None:
    """An unstable plant falls if its gain does."""
    frequency = np.geomspace(0.01, 100, 60)
    L = 4 / (2j * np.pi * frequency - 1)
    margins = margins_of(frequency, 1 / (1 + L))
    assert margins.gain_down == pytest.approx(0.25, rel=0.01)
    assert margins.gain_up == np.inf


def margins_of_loop(numerator: Any, denominator: Any) -> Margins:
    """Return the margins of a loop L(s), given by its polynomials, from 4,000 frequencies."""
    w = np.geomspace(0.02, 400, 4_000)
    L = np.polyval(numerator, 1j * w) / np.polyval(denominator, 1j * w)
    return margins_of(w / (2 * np.pi), 1 / (1 + L))


def crossovers(numerator: Any, denominator: Any) -> tuple[Array, Array]:
    """Return where |L| = 1 [rad/s], ascending, and the lag after which L is -1 there [rad]."""

    def squared(polynomial: Any) -> np.poly1d:
        p = np.poly1d(polynomial)
        return p * np.poly1d(p.coeffs * (-1.0) ** np.arange(p.order, -1, -1))

    roots: Any = (squared(numerator) - squared(denominator)).roots
    w = np.sort(roots[(np.abs(roots.real) < 1e-6 * np.abs(roots)) & (roots.imag > 0)].imag)
    L = np.polyval(numerator, 1j * w) / np.polyval(denominator, 1j * w)
    return w, np.mod(np.angle(-L), 2 * np.pi)


def test_the_bandwidth_is_where_the_sensitivity_is_3_db_down() -> None:
    """L = 4/(s (s + 1)): 2 w^2 (w^2 + 1) = (4 - w^2)^2 + w^2, so w^4 + 9 w^2 = 16."""
    w = np.sqrt((np.sqrt(9**2 + 4 * 16) - 9) / 2)
    bandwidth = margins_of_loop([4], [1, 1, 0]).bandwidth
    assert bandwidth == pytest.approx(w / (2 * np.pi), rel=1e-4)


def test_gain_down_is_the_largest_factor_below_one_and_gain_up_the_least_above() -> None:
    """With L = 10 exp(-s)/s a factor of (pi/2 + 2 pi k)/10 brings L to -1."""
    w = np.geomspace(0.02, 400, 4_000)
    margins = margins_of(w / (2 * np.pi), 1 / (1 + 10 * np.exp(-1j * w) / (1j * w)))
    assert margins.gain_down == pytest.approx(5 * np.pi / 20, rel=1e-4)
    assert margins.gain_up == pytest.approx(9 * np.pi / 20, rel=1e-4)


# An integrator with a mode at 10 rad/s and a lag: |L| = 1 at 2.1, 9.1 and 10.6 rad/s.
MODE = ([200], np.polymul([1, 1, 100, 0], [0.05, 1]))
# A double integrator with lead and a mode at 30 rad/s: |L| = 1 at 1.03, 29.8 and 30.2 rad/s.
LEAD = ([300, 900], np.polymul([1, 0, 0], [1, 0.12, 900]))


@pytest.mark.parametrize(("loop", "least"), [(MODE, 1), (LEAD, 0)])
def test_the_crossover_is_the_one_with_the_least_phase(loop: Any, least: int) -> None:
    w, lag = crossovers(*loop)
    phase = np.minimum(lag, 2 * np.pi - lag)
    assert len(w) == 3
    assert np.argmin(phase) == least
    margins = margins_of_loop(*loop)
    assert margins.crossover == pytest.approx(w[least] / (2 * np.pi), rel=1e-3)
    assert margins.phase == pytest.approx(np.degrees(phase[least]), rel=1e-3)


def test_the_delay_margin_may_be_that_of_a_crossover_with_more_phase() -> None:
    """A lag of 19 deg at 1 rad/s takes 0.32 s, one of 64 deg at 30 rad/s takes 37 ms."""
    w, lag = crossovers(*LEAD)
    assert np.argmin(lag) == 0
    assert margins_of_loop(*LEAD).delay == pytest.approx(lag[1] / w[1], rel=5e-3)


def test_a_loop_whose_phase_is_ahead_of_the_line_gets_there_by_almost_a_turn_of_delay() -> None:
    """|L| = 1 at 3 Hz with a phase of 100 deg: 80 deg from the line, which is 280 deg later."""
    frequency = np.geomspace(0.1, 100, 2_000)
    L = 3 / frequency * np.exp(1j * np.radians(100))
    margins = margins_of(frequency, 1 / (1 + L))
    assert margins.phase == pytest.approx(80, rel=1e-3)
    assert margins.delay == pytest.approx(280 / 360 / 3, rel=1e-3)


def first_order(t: float, x: Any, memory: Any, p: Any) -> float:
    """Proportional feedback; the loop with 1/(s - 1) is at |S| = 1/0.4324 for slow signals."""
    return -1.4324 * x[0]


def unstable() -> RunningLoop:
    """Return a loop about 1/(s - 1), whose S is the largest at f = 0."""
    x = sp.symbols("x")
    plant = affine_plant(
        "unstable", states={"x": "1"}, inputs={"u": "1"}, f=(x,), g=(1,), h=(x,), parameters={}
    )
    law = Controller("law", first_order, Sampled())
    return RunningLoop(plant, law, np.zeros(1), T, T, threads=1)


@pytest.mark.parametrize("period", [10.0, 20.0])
def test_the_margins_of_a_loop_that_is_worst_for_slow_signals_are_those_at_zero(
    period: float,
) -> None:
    """1/|S(0)| = 0.4324: at the lowest line of 10 s it is still 0.65."""
    measured, doubt = measure_with_tests(unstable(), LoopPlace("u"), period, 0.1)
    margins = measured.margins
    assert not doubt
    assert margins.modulus == pytest.approx(0.4324, rel=2e-3)
    assert margins.disk == pytest.approx(0.3555, rel=2e-3)
    assert margins.gain_down == pytest.approx(1 / 1.4324, rel=2e-3)


@pytest.mark.parametrize("gain", [0.6, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("per_decade", [8, 10, 14])
def test_the_errors_contain_the_margins_whose_frequency_lies_between_the_lines(
    gain: float, per_decade: int
) -> None:
    """25 gain/(s^3 + 10 s^2 + 10 s + 10) against 30,000 frequencies."""
    exact = dense_margins(gain)
    lines = multisine(40, T, per_decade).frequencies
    S = third_order_sensitivity(lines, gain)
    found = margins_of(lines, S)
    errors = interpolation_errors(lines, S)
    value, true, error = [
        np.array([m.gain_up, m.phase, m.delay, m.modulus, m.disk, m.crossover])
        for m in (found, exact, errors)
    ]
    assert np.all(np.abs(value - true) <= error + 1e-4 * value)
    assert np.all(error < 0.05 * value)


def test_one_loop_of_the_satellite_has_a_disk_margin_of_2_and_both_have_a_tenth() -> None:
    loop = satellite()
    signal = multisine(80, T)
    single = [measure(loop, LoopPlace(name), signal, 0.1, realizations=1) for name in ("u1", "u2")]
    assert close(single[0].margins.disk, 2.0)
    assert close(single[1].margins.disk, 2.0)
    matrix = np.stack([sensitivity.column for sensitivity in single], axis=2)
    assert close(disk_together(signal.frequencies, matrix), 0.0997)


@pytest.mark.parametrize("per_decade", [10, 14])
def test_inputs_that_do_not_meet_have_together_the_disk_of_one_between_the_lines(
    per_decade: int,
) -> None:
    exact = dense_margins(1.5).disk
    lines = multisine(40, T, per_decade).frequencies
    S = third_order_sensitivity(lines, 1.5)
    both = S[:, None, None] * np.eye(2)
    assert disk_together(lines, both) == pytest.approx(exact, rel=0.01)
    at_lines = 1 / np.max(np.abs(S - 0.5))
    assert at_lines > 1.01 * exact


@pytest.mark.parametrize("size", [1, 2, 3])
def test_the_scaled_norm_of_a_diagonal_matrix_in_other_units_is_its_largest_entry(
    size: int,
) -> None:
    """Units of the inputs do not count: D M D^-1 has the norm of M."""
    random = np.random.default_rng(size)
    units = np.diag(10.0 ** np.arange(size))
    unitary = scipy.linalg.qr(random.normal(size=(size, size)))[0]
    matrix = (units @ unitary @ np.linalg.inv(units)).astype(complex)
    assert scaled_norm(matrix) == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize(
    ("system", "place", "nominal"),
    [("servo", "current", "lqr"), ("cart_pendulum", "force", "fl-lqr")],
)
def test_the_implicit_law_takes_off_the_last_disturbance_in_the_loop_of_its_nominal_law(
    system: str, place: str, nominal: str
) -> None:
    """u[k] = u0[k] - w[k-1], so w - w[k-1] is left in the nominal loop: S = (1 - 1/z) S0."""
    signal = multisine(10, T)
    with_it = measure(bench(system, "implicit"), LoopPlace(place), signal, 1e-3, realizations=1)
    without = measure(bench(system, nominal), LoopPlace(place), signal, 1e-3, realizations=1)
    z = np.exp(2j * np.pi * signal.frequencies * T)
    expected = (1 - 1 / z) * without.at_place[0]
    assert np.abs(with_it.at_place[0] / expected - 1).max() < PERCENT


def test_the_implicit_law_answers_with_the_last_disturbance() -> None:
    """S is about 1 - 1/z: gain margin 2, phase margin 60 deg, one sample of delay, disk 2/3."""
    loop = bench("cart_pendulum", "implicit")
    margins = measure(loop, LoopPlace("force"), multisine(4, T), 0.02, realizations=2).margins
    assert close(margins.gain_up, 2.0)
    assert close(margins.phase, 60.0)
    assert close(margins.delay, T)
    assert close(margins.disk, 2 / 3)


def test_a_relay_answers_slow_signals_with_the_gain_of_its_locus() -> None:
    signal = multisine(80, T)
    loop = replace(third_order(relay), x0=np.array([0.1, 0.0, 0.0]))
    measured = measure(loop, LoopPlace("u"), signal, 0.05, realizations=8)
    slow = signal.frequencies < 0.1
    L = 1 / measured.at_place.mean(axis=0) - 1
    plant = 25 / np.polyval([1, 10, 10, 10], 2j * np.pi * signal.frequencies)
    assert close(float(np.abs(L / plant)[slow].mean()), RELAY_GAIN)


def test_a_relay_swings_with_the_frequency_of_its_locus() -> None:
    loop = third_order(relay)
    run = simulate(
        loop.plant, loop.controller, [0.1, 0, 0], duration=60, control_period=T, timestep=T
    )
    x = run.state[20_000:, 0]
    rising = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    instants = rising + x[rising] / (x[rising] - x[rising + 1])
    assert close(float(1 / (np.diff(instants).mean() * T)), RELAY_FREQUENCY)


def test_a_run_without_injection_is_subtracted_where_the_reference_moves() -> None:
    """Of a linear loop nothing is left of what moves it otherwise."""
    still = measure(third_order(unity), LoopPlace("u"), multisine(10, T), 1.0, realizations=1)
    moved = replace(third_order(unity), x0=np.array([5.0, 1.0, -2.0]), moving=True)
    measured = measure(moved, LoopPlace("u"), multisine(10, T), 1.0, realizations=1)
    assert measured.at_place[0] == pytest.approx(still.at_place[0], rel=1e-3)


def test_a_slow_loop_gets_a_longer_period() -> None:
    """Its crossover is at 0.284 Hz: six periods of it are 21 s."""
    measured, doubt = measure_with_tests(third_order(unity), LoopPlace("u"), 8.0, 1.0)
    assert measured.multisine.period == pytest.approx(32.0)
    assert not doubt


@pytest.mark.parametrize(("rms", "agrees"), [(0.05, True), (0.6, False)])
def test_an_amplitude_whose_half_gives_another_margin_is_not_trusted(
    rms: float, agrees: bool
) -> None:
    """A saturated loop is slower the larger its signals are."""
    place = LoopPlace("x1", output=True)
    _, doubt = measure_with_tests(third_order(saturated), place, 40.0, rms)
    assert bool(doubt) != agrees
    if agrees:
        return
    (ratio,) = re.findall(r"half the amplitude gives (.*) times the margin", doubt)
    assert 0.3 < float(ratio) < 0.9


def test_realizations_of_a_linear_loop_do_not_differ() -> None:
    measured = measure(third_order(unity), LoopPlace("u"), multisine(40, T), 1.0, realizations=3)
    assert measured.deviation.max() < 1e-6
    assert not measured.doubt
    assert measured.standard_errors.disk < 1e-6


def scattered(*parts: float, ended: int = 0) -> LoopSensitivity:
    """Return S of an integrator with crossover at 3 Hz, times 1 + part in each realization."""
    signal = multisine(10, T)
    S = 1 / (1 + 3 / (1j * signal.frequencies))
    realizations: Any = (1 + np.array(parts))[:, None, None] * S[:, None]
    return LoopSensitivity(signal, 1.0, realizations, 0, ended)


def test_the_standard_error_of_a_margin_is_that_of_the_mean_of_its_runs() -> None:
    """The modulus, 1/max|S|, moves by as much as S: by s/sqrt(n) of n runs with spread s."""
    parts = 1e-4 * np.array([1.0, -2.0, 4.0, 0.5, -1.5])
    measured = scattered(*parts)
    expected = measured.margins.modulus * np.std(parts, ddof=1) / np.sqrt(5)
    assert measured.standard_errors.modulus == pytest.approx(expected, rel=1e-3)
    of_lines = measured.interpolation_errors.modulus
    assert measured.errors.modulus == pytest.approx(expected + of_lines, rel=1e-3)


@pytest.mark.parametrize(("spread", "trusted"), [(0.249, True), (0.251, False)])
def test_runs_that_differ_by_a_quarter_near_the_crossover_are_not_trustworthy(
    spread: float, trusted: bool
) -> None:
    """Of two runs at 1 + a and 1 - a the deviation is a sqrt(2)."""
    measured = scattered(spread / np.sqrt(2), -spread / np.sqrt(2))
    assert measured.deviation == pytest.approx(np.full(len(measured.deviation), spread))
    assert measured.doubt == ("" if trusted else "runs differ by 25% near the crossover frequency")


@pytest.mark.parametrize(("spread", "counts"), [(0.49, True), (0.51, False)])
def test_a_line_whose_runs_differ_by_more_than_a_half_does_not_count(
    spread: float, counts: bool
) -> None:
    assert scattered(spread / np.sqrt(2), -spread / np.sqrt(2)).counting.all() == counts


def test_runs_that_ended_are_counted_among_all_runs() -> None:
    assert scattered(0.0, 0.0, 0.0, ended=2).doubt == "2 of 5 runs leave the region of the loop"


def test_a_relay_under_a_small_injection_is_not_trustworthy() -> None:
    loop = replace(third_order(relay), x0=np.array([0.1, 0.0, 0.0]))
    measured = measure(loop, LoopPlace("u"), multisine(10, T), 1e-4, realizations=3)
    assert measured.doubt


def test_a_period_that_is_shorter_than_six_of_the_crossover_is_not_trustworthy() -> None:
    measured = measure(third_order(unity), LoopPlace("u"), multisine(5, T), 1.0, realizations=2)
    assert measured.too_short
    assert "periods of the crossover" in measured.doubt


def test_a_state_that_the_law_does_not_use_is_not_trustworthy() -> None:
    place = LoopPlace("x2", output=True)
    measured = measure(third_order(unity), place, multisine(10, T), 1.0, realizations=2)
    assert measured.doubt == "the law does not use it"


def test_a_multisine_has_its_rms_and_only_its_lines() -> None:
    signal = multisine(10, T)
    values: Array = signal.values(0.3, np.random.default_rng(0))
    spectrum = np.abs(np.fft.rfft(values))
    assert np.sqrt(np.mean(values**2)) == pytest.approx(0.3)
    assert np.flatnonzero(spectrum > 1e-9 * spectrum.max()).tolist() == signal.lines.tolist()
    assert signal.lines[:6].tolist() == [1, 2, 3, 4, 5, 6]


def test_a_period_without_room_for_lines_is_refused() -> None:
    with pytest.raises(ArgumentError, match="at least 16 control periods"):
        multisine(0.01, T)
