from . import (
    campaign,
    document,
    figures,
    findings,
    folder,
    manifest,
    radius,
    replay,
    specification,
    statistics,
    tables,
    work,
    worst,
)
from .findings import Findings, run_campaign
from .specification import Specification

__all__ = [
    "Findings",
    "Specification",
    "campaign",
    "document",
    "figures",
    "findings",
    "folder",
    "manifest",
    "radius",
    "replay",
    "run_campaign",
    "specification",
    "statistics",
    "tables",
    "work",
    "worst",
]
