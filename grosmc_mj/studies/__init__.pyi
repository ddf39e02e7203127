from .campaign.campaign import Campaign
from .campaign.findings import Findings, run_campaign
from .campaign.specification import Specification

__all__ = ["Campaign", "Findings", "Specification", "run_campaign"]
