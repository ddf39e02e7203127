from .gymnasium_face import CaseEnv
from .gymnasium_ids import register
from .loading import load
from .policies import law_policy, policy_controller

__all__ = [
    "CaseEnv",
    "law_policy",
    "load",
    "policy_controller",
    "register",
]
