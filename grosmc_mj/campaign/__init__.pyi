from .family.specification import Specification
from .findings.findings import Findings
from .whole import run_campaign

__all__ = ["Findings", "Specification", "run_campaign"]
