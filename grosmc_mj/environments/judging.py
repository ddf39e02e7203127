"""The ledger's claims with a policy in the place of the sliding mode law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from grosmc_mj.chapter.claims.claim import (
    Claim,
    Finding,
    Measured,
    NeedsSlidingModeError,
    PlantFinding,
    Verdict,
)
from grosmc_mj.chapter.claims.judging import judge
from grosmc_mj.chapter.claims.ledger import find_claim, select_claims
from grosmc_mj.environments.policies import policy_controller
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import find_system

# The law whose place the policy takes.
REPLACED = "grosmc"


def judge_policy(
    system: str,
    policy: Any,
    claims: Sequence[str | Claim] | None = None,
    *,
    settings: Settings | None = None,
    refine: bool = True,
) -> list[Finding]:
    """Judge the claims about a system's GROSMC law as if they were made of a policy.

    A claim that needs the law's inside (its surface, its gains) can't be: it is inconclusive,
    and its note says ``not judged`` and why. A claim about another law keeps its verdict. Policies
    run in Python: a system takes minutes.

    Args:
        system: Name of the system.
        policy: As for ``policy_controller``; it gets the observations of each claim's case.
        claims: Claims or their ids; by default all of the system.
        settings: How cases are run. The policy itself runs in the Python engine.
        refine: Whether to look at half the time steps too.

    Returns:
        One finding for each claim.

    Raises:
        ModelError: If there is no such system.
        ArgumentError: If there is no such claim, or it is about another system.
        LawError: If the policy raises an error.
    """
    name = find_system(system).name
    lab = _PolicyLaboratory(settings or Settings(), policy)
    findings = []
    for claim in select_claims(name) if claims is None else claims:
        if isinstance(claim, str):
            claim = find_claim(claim)
        if claim.system != name:
            raise ArgumentError(f"claim {claim.id} is about {claim.system}, not about {name}")
        try:
            # The premises are those of the law's theorem; a policy relies on none.
            finding = judge(lab, replace(claim, premise=None), refine=refine)
        except NeedsSlidingModeError as error:
            nothing = Measured(None, f"not judged: {error}", broken=True)
            on_each = PlantFinding(nothing, None, Verdict.INCONCLUSIVE)
            finding = Finding(claim, dict.fromkeys(claim.plants, on_each))
        findings.append(finding)
    return findings


class _PolicyLaboratory(RunCache):
    """Runs with a policy in the place of the sliding mode law."""

    def __init__(self, settings: Settings, policy: Any) -> None:
        super().__init__(settings)
        self._policy = policy

    def controller(self, experiment: Experiment, plant: PlantName, name: str) -> Controller:
        """Controller of the case, or the policy."""
        law = super().controller(experiment, plant, name)
        if law.name != REPLACED:
            return law
        judged = policy_controller(self._policy, law)
        return replace(judged, parameters=_Guarded(law.parameters))


class _Guarded:
    """Parameters of a law, of which a policy has the nominal plant and the reference only."""

    def __init__(self, parameters: Any) -> None:
        self.plant = parameters.plant
        self.reference = parameters.reference

    def __getattr__(self, name: str) -> Any:
        # No AttributeError: hasattr must not take a policy for a law without that gain.
        if name.startswith("__"):
            raise AttributeError(name)
        raise NeedsSlidingModeError(f"it asks for the law's {name}")
