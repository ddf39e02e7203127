from .campaign import Specification
from .findings import Findings, run_campaign

__all__ = ["Findings", "Specification", "run_campaign"]
