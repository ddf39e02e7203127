from .gymnasium_face import CaseEnv
from .gymnasium_ids import register
from .judging import judge_policy
from .loading import load
from .policies import law_policy, policy_controller

__all__ = [
    "CaseEnv",
    "judge_policy",
    "law_policy",
    "load",
    "policy_controller",
    "register",
]
