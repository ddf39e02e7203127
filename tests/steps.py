"""A servo's step of 1 rad in 6 s under two poles with a damping of 0.5: e'' + 3 e' + 9 e = 0."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cases import case

from grosmc_mj.experiments.experiment import Experiment

STEP: dict[str, Any] = {
    "run": {"duration": "6 s", "control_period": "1 ms", "timestep": "1 ms"},
    "task": {"reference": ["1"], "sign": -1, "Q": [1, 1], "R": 1},
    "controller": [{"law": "pd", "frequency": 3, "damping": 0.5}],
}


def step(*requirements: dict[str, Any], folder: Path = Path(), **tables: Any) -> Experiment:
    """Return the step with requirements, and with tables in place of its own."""
    return case("servo", folder=folder, **(STEP | {"requirement": list(requirements)} | tables))
