"""The plants as environments of dm_control and Gymnasium, and their policies as controllers.

The names load on first use: neither dm_control nor Gymnasium is needed for what doesn't use it.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from grosmc_mj.environments.gymnasium_ids import register
    from grosmc_mj.environments.judging import judge_policy
    from grosmc_mj.environments.law_policies import law_policy
    from grosmc_mj.environments.loading import load
    from grosmc_mj.environments.policy_controllers import policy_controller

# No module has the name of a function: importing it would take the function's place.
_HOMES = {
    "judge_policy": "judging",
    "law_policy": "law_policies",
    "load": "loading",
    "policy_controller": "policy_controllers",
    "register": "gymnasium_ids",
}

__all__ = ["judge_policy", "law_policy", "load", "policy_controller", "register"]


def __getattr__(name: str) -> Any:
    """Load a public name from the module that it lives in."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    """The public names."""
    return sorted([*globals(), *__all__])
