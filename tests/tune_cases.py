"""Cases that are tuned in tests: small plants whose best numbers are known, or gridded."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cases

from grosmc_mj.studies.tune.row import TunedNumberRow

PLANTS = '''
import sympy as sp
import grosmc_mj as gm

x, v, y, m, T = sp.symbols("x v y m T")


def block():
    """A mass on a plane: m x'' = u."""
    return gm.affine_plant(
        "block", states={"x": "m", "v": "m/s"}, inputs={"force": "N"},
        f=[v, 0], g=[0, 1 / m], h=[x], parameters={"m": 1.0},
    )


def lag():
    """A first-order lag: T y' = u - y."""
    return gm.affine_plant(
        "lag", states={"y": "m"}, inputs={"u": "m"},
        f=[-y / T], g=[1 / T], h=[y], parameters={"T": 1.0},
    )


def pd(t, x, memory, p):
    """PD of the block, by the frequency and the damping of its loop."""
    return p.frequency**2 * (1.0 - x[0]) - 2 * p.damping * p.frequency * x[1]


def pi(t, x, memory, p):
    """PI of the lag."""
    e = 1.0 - x[0]
    memory.integral += p.period * e
    return p.kp * e + p.ki * memory.integral
'''
# A double integrator under PD, with at most 1.5 N.
BLOCK: Mapping[str, Any] = {
    "run": {"duration": "6 s", "control_period": "4 ms", "timestep": "4 ms"},
    "task": {"reference": ["1"], "Q": [1, 1], "R": 1},
    "actuator": {"of": "force", "limit": "1.5 N"},
    "controller": {"name": "mine", "law": "plants:pd", "frequency": 0.4, "damping": 0.3},
    "requirement": {"settles_within": "3 s", "overshoot_below": 0.02},
}
# A first-order lag with a delay under PI.
LAG: Mapping[str, Any] = {
    "run": {"duration": "6 s", "control_period": "10 ms", "timestep": "10 ms"},
    "computing": {"delay": "0.3 s"},
    "task": {"reference": ["1"], "Q": [1], "R": 1},
    "controller": {
        "name": "mine",
        "law": "plants:pi",
        "kp": 0.3,
        "ki": 0.1,
        "memory": {"integral": 0},
    },
    "requirement": {"settles_within": "2 s", "overshoot_below": 0.05, "input_below": "2.5 m"},
}


def write_block(folder: Path, **tables: Any) -> Path:
    """Write the case of the block with its plants beside it, and return its path."""
    (folder / "plants.py").write_text(PLANTS, encoding="utf-8")
    return cases.write(folder, "plants:block", **(dict(BLOCK) | tables))


def write_lag(folder: Path, **tables: Any) -> Path:
    """Write the case of the lag with its plants beside it, and return its path."""
    (folder / "plants.py").write_text(PLANTS, encoding="utf-8")
    return cases.write(folder, "plants:lag", **(dict(LAG) | tables))


def number_row(path: str, **changes: Any) -> TunedNumberRow:
    """Return a number that is 1 in the file and after a search from 0.1 to 10, but for changes."""
    row = TunedNumberRow(
        path=path,
        unit="",
        before=1.0,
        after=1.0,
        low=0.1,
        high=10.0,
        grown=False,
        at_end=False,
        logarithmic=True,
    )
    return row.model_copy(update=changes)
