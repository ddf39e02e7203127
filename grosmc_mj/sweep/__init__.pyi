from .findings import Findings, run_campaign
from .specification import Specification

__all__ = ["Findings", "Specification", "run_campaign"]
