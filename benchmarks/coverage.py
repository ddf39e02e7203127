"""How often the intervals of ``identify`` contain the true values, of machines of one's own making.

    python -m benchmarks.coverage FILE.jsonl [--machines 200] [--counts 256]

Servos with another inertia, viscous friction and delay are simulated by an integrator of this file,
which shares nothing with the package; a line for each is added to the file, so that an interrupted
measurement goes on where it was. With counts the angle is an encoder's, without noise.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.reading import parse_case_file
from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.ground.arrays import Array
from grosmc_mj.identify.fit import Fit, fit
from grosmc_mj.identify.parameters import parameters_of
from grosmc_mj.identify.replay import Predictor

# The shipped servo: inertia [kg m^2], torque constant [N m/A].
INERTIA = 0.0577
TORQUE = 0.667
# Standard deviation of a measured angle [rad].
NOISE = 1e-3
# Time between two measurements, and timestep of the simulation [s].
SAMPLING = 2e-3
FINE = 5e-5
# Length of a log [s], and measurements for which an input is held.
SECONDS = 10.0
HELD = 60
CASE = """
title = "A servo to identify"
plant = { system = "servo" }
run = { duration = "5 s" }
controller = [{ law = "lqr" }, { law = "grosmc" }]
computing = { delay = "1 ms" }
requirement = [{ settles_within = "6 s", of = ["grosmc"] }]
uncertain = [
  { number = "edit.rotor.mass_scale", values = [0.3, 4] },
  { number = "edit.shaft.damping", values = [0.0005, 0.1] },
  { number = "computing.delay", values = ["0 ms", "20 ms"] },
]
"""
NAMES = ("rotor mass scale", "shaft damping", "computing delay")


def case(folder: Path) -> Experiment:
    """Case that the machines are fitted to."""
    path = folder / "servo_to_identify.toml"
    path.write_text(CASE, encoding="utf-8")
    return Experiment.of_file(parse_case_file(CASE, path), path).checked()


def machine(number: int, counts: int = 0) -> tuple[Array, Log]:
    """A servo by its number: the true values of ``NAMES``, and a log of it, exact to 50 us.

    Args:
        number: Number of the servo.
        counts: Steps of its encoder in a turn; 0 for noise in their place.
    """
    random = np.random.default_rng([7, number])
    scale = random.uniform(0.6, 2.5)
    damping = random.uniform(0.004, 0.03)
    delay = random.uniform(1e-3, 8e-3)
    samples = round(SECONDS / FINE) // round(SAMPLING / FINE)
    levels = random.uniform(-0.8, 0.8, samples // HELD + 1)
    u = np.repeat(levels, HELD)[:samples]
    late = round(delay / FINE)

    angles = simulated_angles(u, scale * INERTIA, damping, late)
    if counts:
        step = 2 * np.pi / counts
        measured = step * np.round(angles / step)
    else:
        measured = angles + NOISE * random.standard_normal(samples)
    log = Log(
        f"servo {number}",
        np.arange(samples) * SAMPLING,
        u[:, None],
        {"rotor angle": measured},
        [slice(0, samples)],
    )
    return np.array([scale, damping, late * FINE]), log


def simulated_angles(
    u: Array, inertia: float, damping: float, late: int, coulomb: float = 0.0
) -> Array:
    """Angle of a servo at each measurement, from rest, exact while the input is held.

    Args:
        u: Input at each measurement, (N,).
        inertia: [kg m^2].
        damping: Viscous friction [N m s/rad].
        late: Delay of the input in timesteps.
        coulomb: Dry friction [N m]: it holds the servo at rest, where each reversal ends first.
    """
    every = round(SAMPLING / FINE)
    fades = np.exp(-damping * FINE / inertia)
    angle = 0.0
    rate = 0.0
    angles = np.zeros(len(u))
    for k in range(len(u) * every):
        if k % every == 0:
            angles[k // every] = angle
        torque = TORQUE * u[max(k - late, 0) // every]
        if rate == 0 and abs(torque) <= coulomb:
            continue
        direction = np.sign(rate) or np.sign(torque)
        # The rate at which friction balances the input.
        end = (torque - direction * coulomb) / damping
        angle += end * FINE + (rate - end) * (1 - fades) * inertia / damping
        rate = end + (rate - end) * fades
        if coulomb and rate * direction < 0:
            rate = 0.0
    return angles


def fitted(experiment: Experiment, log: Log) -> Fit:
    """Fit of a machine."""
    parameters = parameters_of(experiment, NAMES)
    plant = experiment.plant("physics")
    return fit(parameters, Predictor.of(log, horizon=1.0, timestep=1e-3), plant)


def estimates(true: Array, found: Fit) -> dict[str, Any]:
    """True value, fitted value and half the width of the interval of each parameter."""
    half = np.full(len(true), np.nan)
    half[found.fitted] = found.half
    columns = zip(NAMES, true, found.values, half, strict=True)
    return {
        name: {"true": true_value, "value": value, "half": half_width}
        for name, true_value, value, half_width in columns
    }


def contains_truth(estimate: dict[str, float]) -> bool:
    """True if the interval of a parameter contains the true value."""
    return abs(estimate["value"] - estimate["true"]) <= estimate["half"]


def print_coverage(lines: list[str]) -> None:
    """Print for each parameter how many intervals contain the true value."""
    machines = [json.loads(line) for line in lines]
    for name in NAMES:
        inside = sum(contains_truth(machine[name]) for machine in machines)
        low, high = stats.binomtest(inside, len(machines)).proportion_ci(0.95)
        ends = f"{100 * low:.1f} to {100 * high:.1f} %"
        print(f"{name}: {inside} of {len(machines)}, {ends}")  # noqa: T201


def main() -> None:
    """Measure, a machine a line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--machines", type=int, default=200)
    parser.add_argument("--counts", type=int, default=0)
    options = parser.parse_args()

    lines = []
    if options.file.is_file():
        lines = options.file.read_text().splitlines()

    experiment = case(options.file.parent)
    with options.file.open("a", encoding="utf-8") as file:
        for number in range(len(lines), options.machines):
            true, log = machine(number, options.counts)
            line = json.dumps(estimates(true, fitted(experiment, log)))
            print(line, file=file, flush=True)
            lines.append(line)
    print_coverage(lines)


if __name__ == "__main__":
    main()
