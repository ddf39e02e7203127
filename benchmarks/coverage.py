"""How often the intervals of ``identify`` contain the true values, of machines of one's own making.

    python -m benchmarks.coverage FILE.jsonl [--machines 200]

Servos with another inertia, viscous friction and delay are simulated by an integrator of this file,
which shares nothing with the package; a line for each is added to the file, so that an interrupted
measurement goes on where it was. Dry friction is not among them: MuJoCo's is softened where the
motion reverses, so that the inertia of a machine with Coulomb's is off by half a per cent.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.experiments.experiment import Experiment, experiment_of
from grosmc_mj.experiments.file.reading import parse_case_file
from grosmc_mj.identify.fit import Fit, fit
from grosmc_mj.identify.log import Log
from grosmc_mj.identify.parameters import parameters_of

# The shipped servo: inertia [kg m^2], damping [N m s/rad], torque constant [N m/A].
INERTIA, DAMPING, TORQUE = 0.0577, 0.0088, 0.667
NOISE, SAMPLING, FINE, SECONDS = 1e-3, 2e-3, 5e-5, 10.0
CASE = """
title = "A servo to identify"
plant = { system = "servo" }
run = { duration = "5 s" }
controller = [{ law = "lqr" }, { law = "grosmc" }]
computing = { delay = "1 ms" }
requirement = [{ settles_within = "6 s", of = ["grosmc"] }]
uncertain = [
  { body = "rotor", mass_scale = [0.3, 4] },
  { joint = "shaft", damping = [0.0005, 0.1] },
  { computing = true, delay = ["0 ms", "20 ms"] },
]
"""
NAMES = ("rotor mass scale", "shaft damping", "computing delay")


def case(folder: Path) -> Experiment:
    """The case that the machines are fitted to."""
    path = folder / "servo_to_identify.toml"
    path.write_text(CASE, encoding="utf-8")
    return experiment_of(parse_case_file(CASE, path), path)


def machine(number: int) -> tuple[Array, Log]:
    """A servo by its number: the true values of ``NAMES``, and a log of it, exact to 50 us."""
    random = np.random.default_rng([7, number])
    scale, damping = random.uniform(0.6, 2.5), random.uniform(0.004, 0.03)
    delay = random.uniform(1e-3, 8e-3)
    steps, every = round(SECONDS / FINE), round(SAMPLING / FINE)
    time = np.arange(steps // every) * SAMPLING
    u = np.repeat(random.uniform(-0.8, 0.8, len(time) // 60 + 1), 60)[: len(time)]
    late, inertia = round(delay / FINE), scale * INERTIA
    angle, rate, angles = 0.0, 0.0, np.zeros(len(time))
    fades = np.exp(-damping * FINE / inertia)
    for k in range(steps):
        if k % every == 0:
            angles[k // every] = angle
        end = TORQUE * u[max(k - late, 0) // every] / damping
        angle += end * FINE + (rate - end) * (1 - fades) * inertia / damping
        rate = end + (rate - end) * fades
    measured = angles + NOISE * random.standard_normal(len(time))
    true = np.array([scale, damping, late * FINE])
    whole = [slice(0, len(time))]
    return true, Log(f"servo {number}", time, u[:, None], {"rotor angle": measured}, whole)


def fitted(experiment: Experiment, log: Log) -> Fit:
    """The fit of a machine."""
    parameters = parameters_of(experiment, NAMES)
    plant = experiment.plant("physics")
    return fit(parameters, log, plant, horizon=1.0, timestep=1e-3)


def covered(true: Array, found: Fit) -> dict[str, Any]:
    """Which intervals contain the true values."""
    half = np.full(len(true), np.nan)
    half[found.fitted] = found.half
    rows = zip(NAMES, true, found.values, half, strict=True)
    return {n: {"true": t, "value": v, "half": h} for n, t, v, h in rows}


def main() -> None:
    """Measure, a machine a line."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("file", type=Path)
    options.add_argument("--machines", type=int, default=200)
    asked = options.parse_args()
    done = asked.file.read_text().splitlines() if asked.file.is_file() else []
    experiment = case(asked.file.parent)
    with asked.file.open("a", encoding="utf-8") as file:
        for number in range(len(done), asked.machines):
            true, log = machine(number)
            done.append(json.dumps(covered(true, fitted(experiment, log))))
            print(done[-1], file=file, flush=True)
    rows = [json.loads(line) for line in done]
    for name in NAMES:
        inside = sum(abs(r[name]["value"] - r[name]["true"]) <= r[name]["half"] for r in rows)
        low, high = stats.binomtest(inside, len(rows)).proportion_ci(0.95)
        ends = f"{100 * low:.1f} to {100 * high:.1f} %"
        print(f"{name}: {inside} of {len(rows)}, {ends}")  # noqa: T201


if __name__ == "__main__":
    main()
