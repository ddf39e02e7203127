"""The ledger's claims with a policy in the place of the sliding mode law."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.law import around
from grosmc_mj.environments.policies import policy_controller
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Fault, Laboratory
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.plants import find_system

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
    and its note says ``not judged`` and why. Claims that are not about that law are left out,
    unless they are named. Policies run in Python: a system takes minutes.

    Args:
        system: Name of the system.
        policy: As for ``policy_controller``; it gets the observations of each claim's case.
        claims: Claims or their ids; by default all that the policy enters.
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
    named = [find_claim(claim) if isinstance(claim, str) else claim for claim in claims or ()]
    for claim in named:
        if claim.system != name:
            raise ArgumentError(f"claim {claim.id} is about {claim.system}, not about {name}")
    lab, findings = _PolicyLaboratory(settings or Settings(), policy), []
    for claim in named or select_claims(name):
        lab.entered = False
        try:
            # The premises are those of the law's theorem; a policy relies on none.
            finding = judge(lab, replace(claim, premise=None), refine=refine)
        except NeedsSlidingModeError as error:
            nothing = Measured(None, f"not judged: {error}", broken=True)
            on_each = PlantFinding(nothing, None, Verdict.INCONCLUSIVE)
            finding, lab.entered = Finding(claim, dict.fromkeys(claim.plants, on_each)), True
        if lab.entered or named:
            findings.append(finding)
    return findings


class _Guarded:
    """Parameters of a law, of which a policy has the nominal plant and the reference only."""

    def __init__(self, parameters: Any) -> None:
        self.plant, self.reference = parameters.plant, parameters.reference

    def __getattr__(self, name: str) -> Any:
        # No AttributeError: hasattr must not take a policy for a law without that gain.
        if name.startswith("__"):
            raise AttributeError(name)
        raise NeedsSlidingModeError(f"it asks for the law's {name}")


class _PolicyLaboratory(Laboratory):
    """A laboratory with a policy in the law's place.

    Attributes:
        entered: Whether the policy had a part in anything since this was last set to False.
    """

    entered = False

    def __init__(self, settings: Settings, policy: Any) -> None:
        self._policy, self._with_policy = policy, set[Any]()
        super().__init__(settings, Fault("policy", "a policy is the law", controller=self._put_in))

    def _put_in(self, law: Controller, _experiment: Experiment, _plant: PlantName) -> Controller:
        if law.name != REPLACED:
            return law
        controller = policy_controller(self._policy, law)

        def noted(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
            self.entered = True
            controller.law(t, x, memory, p, u)

        law_in_place = around(noted, controller.law)
        return replace(controller, law=law_in_place, parameters=_Guarded(law.parameters))

    def run(self, experiment: Experiment, plant: PlantName, controller: str) -> RunResult:
        """A run that is there already counts as well."""
        self.entered |= controller == REPLACED
        return super().run(experiment, plant, controller)

    def once(self, key: Any, make: Callable[[], Any]) -> Any:
        """What is made already counts as well."""
        before, self.entered = self.entered, key in self._with_policy
        value = super().once(key, make)
        if self.entered:
            self._with_policy.add(key)
        self.entered |= before
        return value
