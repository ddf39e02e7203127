"""Requirements on runs, and the metrics that they limit.

``requirement`` has the base class of the kinds, ``judging`` the judgements. The kinds are in
``magnitudes``, ``transient``, ``actuators``, ``surface``, ``swings``, ``recovers_within`` and
``always``; a further one is a class in a file of its own or in one of them,
and stands in ``KINDS``.

``metrics`` has names, units and tolerances of metrics. ``measurement`` says what is measured of a
run, ``accumulator`` accumulates it during a simulation or over the rows of a record, and
``run_metrics`` gives the metrics. ``optimum`` has the optimum that a run is compared with.

``always`` takes a text, as which bounds are written too: ``temporal_text`` reads it, ``temporal``
has the logic, ``expressions`` the arithmetic with units, ``signals`` the signals of a run by name.
"""

from __future__ import annotations

from grosmc_mj.experiments.requirements.actuators import InputBelow, SaturatedForLessThan
from grosmc_mj.experiments.requirements.always import Always, SignalBetween
from grosmc_mj.experiments.requirements.magnitudes import (
    CostRatioBelow,
    DeviationBelow,
    FinalErrorBelow,
    RmsBelow,
    StaysWithin,
)
from grosmc_mj.experiments.requirements.recovers_within import RecoversWithin
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.experiments.requirements.surface import NoReachingPhase, SlidingBelow
from grosmc_mj.experiments.requirements.swings import LastPeakBelow, ReachesWithin, SwingsBelow
from grosmc_mj.experiments.requirements.transient import OvershootBelow, SettlesWithin

# All kinds, in the order in which a table of a file is read.
KINDS: tuple[type[Requirement], ...] = (
    SettlesWithin,
    StaysWithin,
    FinalErrorBelow,
    RmsBelow,
    OvershootBelow,
    DeviationBelow,
    InputBelow,
    SlidingBelow,
    NoReachingPhase,
    CostRatioBelow,
    ReachesWithin,
    SwingsBelow,
    LastPeakBelow,
    RecoversWithin,
    SaturatedForLessThan,
    SignalBetween,
    Always,
)
