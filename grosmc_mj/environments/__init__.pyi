from .gymnasium_ids import register
from .judging import judge_policy
from .law_policies import law_policy
from .loading import load
from .policy_controllers import policy_controller

__all__ = ["judge_policy", "law_policy", "load", "policy_controller", "register"]
