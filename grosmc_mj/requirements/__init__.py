"""Requirements on runs, one file a kind, and the metrics that they limit.

``requirement`` has the base class of the kinds, ``judging`` the judgements.

``metrics`` has names, units and tolerances of metrics. ``measurement`` says what is measured of a
run, ``accumulator`` accumulates it, with ``events``, and ``run_metrics`` gives the metrics;
``error_metrics`` those of an error alone. ``optimum`` has the optimum that a run is compared with.
``event_requirement`` is the base of the kinds on events.

``always`` takes a text, as which ``envelope`` writes its bounds: ``temporal_text`` reads it,
``temporal`` has the logic, ``expressions`` the arithmetic with units, ``signals`` the signals of a
run by name.
"""

from __future__ import annotations

from grosmc_mj.requirements.always import Always
from grosmc_mj.requirements.cost_ratio_below import CostRatioBelow
from grosmc_mj.requirements.deviation_below import DeviationBelow
from grosmc_mj.requirements.envelope import Envelope
from grosmc_mj.requirements.final_error_below import FinalErrorBelow
from grosmc_mj.requirements.input_below import InputBelow
from grosmc_mj.requirements.last_peak_below import LastPeakBelow
from grosmc_mj.requirements.no_reaching_phase import NoReachingPhase
from grosmc_mj.requirements.overshoot_below import OvershootBelow
from grosmc_mj.requirements.reaches_within import ReachesWithin
from grosmc_mj.requirements.recovers_within import RecoversWithin
from grosmc_mj.requirements.requirement import Requirement
from grosmc_mj.requirements.rms_below import RmsBelow
from grosmc_mj.requirements.saturated_for_less_than import SaturatedForLessThan
from grosmc_mj.requirements.settles_within import SettlesWithin
from grosmc_mj.requirements.sliding_below import SlidingBelow
from grosmc_mj.requirements.stays_within import StaysWithin
from grosmc_mj.requirements.swings_below import SwingsBelow

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
    Envelope,
    Always,
)
