"""The optimum that a campaign's running laws are compared with, beside that of recorded runs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from campaign_cases import PAIR, PLANT, campaign

from grosmc_mj.experiments.metrics import compare_with_optimum
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.sweep.screening import EQUATIONS, evaluate

UNCERTAIN = '[[uncertain]]\nbody = "rotor"\nmass_scale = [1, 3]\n'
LIMIT = '[[requirement]]\ndeviation_below = "3 mrad"\n'
H, SECONDS, LAWS = 1e-3, 0.2, ["lqr", "stiff"]
LOOP = '[computing]\ndelay = "1 ms"\n'


@pytest.mark.parametrize("loop", ["", LOOP], ids=["ideal", "loop"])
@pytest.mark.parametrize("period", ["1 ms", "4 ms"])
def test_the_optimum_moves_on_by_the_time_between_two_comparisons(period: str, loop: str) -> None:
    """By a timestep, whatever the control period and with a loop or without."""
    text = PLANT.format(system="servo", duration=SECONDS, start='{}\ntimestep = "1 ms"')
    text = text.replace('control_period = "1 ms"', f'control_period = "{period}"')
    asked = campaign(text + loop + PAIR + LIMIT + UNCERTAIN)
    values = asked.values(range(1))
    sample = asked.plant_sample(values[0])
    plant: Any = sample.plant(asked.plant)
    for law, outcome in ((law, evaluate(asked, law, values)) for law in LAWS):
        run = simulate(
            plant.analytic() if outcome["judged_by"][0] == EQUATIONS else plant,
            asked.laws[law],
            sample.case.x0,
            duration=SECONDS,
            control_period=asked.experiment.settings.control_period,
            timestep=H,
        )
        deviation = compare_with_optimum(run, asked.laws[law]).deviation[:-1]
        # One step of the optimum after another, and a norm in another order.
        assert outcome["deviation"][0] == pytest.approx(np.abs(deviation).max(), rel=1e-9)
