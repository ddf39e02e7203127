from . import campaign, findings, map, radius, replay, statistics, store, worst
from .campaign import Specification
from .findings import Findings, run_campaign

__all__ = [
    "Findings",
    "Specification",
    "campaign",
    "findings",
    "map",
    "radius",
    "replay",
    "run_campaign",
    "statistics",
    "store",
    "worst",
]
