"""The ledger's claims with a policy in the place of the sliding mode law."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from grosmc_mj.control.law import Law
from grosmc_mj.environments.policy_controllers import Takes, policy_controller
from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.experiments.case import Case
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
    takes: Takes = "observation",
    settings: Settings | None = None,
    refine: bool = True,
) -> list[Finding]:
    """Judge the claims about a system's GROSMC law as if they were made of a policy.

    A claim that asks for the law's inside (its surface, its gains) can't be: it is inconclusive,
    and its note says ``not judged`` and why. Claims that are not about that law are left out,
    unless they are named. Policies run in Python: a system takes minutes.

    Args:
        system: Name of the system.
        policy: As for ``policy_controller``; it gets the observations of each claim's case. Or
            several by the name of the design that they are for (``Case.controllers``), such as
            ``two_link_arm`` and ``two_link_arm regulation``.
        claims: Claims or their ids; by default all that the policy enters.
        takes: What the policy is called with.
        settings: How cases are run. The policy itself runs in the Python engine.
        refine: Whether to look at half the time steps too.

    Returns:
        One finding for each claim.

    Raises:
        ModelError: If there is no such system.
        ArgumentError: If there is no such claim, or it is about another system.
        PolicyError: If the policy raises an error.
    """
    name = find_system(system).name
    chosen = select_claims(name) if claims is None else [_claim(name, each) for each in claims]

    lab = _PolicyLaboratory(settings or Settings(), policy, takes)
    findings = []
    for claim in chosen:
        lab.asked = False
        finding = _judged(lab, claim, refine=refine)
        if lab.asked or claims is not None:
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


class _Noted:
    """A policy's law that notes when it is asked."""

    python_only = True

    def __init__(self, law: Law, lab: _PolicyLaboratory) -> None:
        self._law, self._lab = law, lab

    def __call__(self, t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        self._lab.asked = True
        self._law(t, x, memory, p, u)


class _PolicyLaboratory(Laboratory):
    """A laboratory with a policy in the law's place.

    Attributes:
        asked: Whether the policy had a part in anything since this was last set to False.
    """

    asked = False

    def __init__(self, settings: Settings, policy: Any, takes: Takes) -> None:
        self._policy: Any = policy
        self._takes: Takes = takes
        self._entered: set[Any] = set()
        super().__init__(settings, Fault("policy", "a policy is the law", controller=self._put_in))

    def _put_in(self, law: Controller, experiment: Experiment, _plant: PlantName) -> Controller:
        if law.name != REPLACED:
            return law
        made = policy_controller(self._policy_for(experiment.case), law, takes=self._takes)
        return replace(made, law=_Noted(made.law, self), parameters=_Guarded(law.parameters))

    def _policy_for(self, case: Case) -> Any:
        """The policy for the design of a case."""
        if not isinstance(self._policy, Mapping):
            return self._policy
        if case.controllers not in self._policy:
            raise ArgumentError(unknown_name("policy", case.controllers, map(str, self._policy)))
        return self._policy[case.controllers]

    def run(self, experiment: Experiment, plant: PlantName, controller: str) -> RunResult:
        """A run that is there already counts as well."""
        self.asked |= controller == REPLACED
        return super().run(experiment, plant, controller)

    def once(self, key: Any, make: Callable[[], Any]) -> Any:
        """The same for what else is made once."""
        before, self.asked = self.asked, False
        value = super().once(key, make)
        if self.asked:
            self._entered.add(key)
        self.asked = before or key in self._entered
        return value


def _claim(system: str, claim: str | Claim) -> Claim:
    """A claim about the system."""
    chosen = find_claim(claim) if isinstance(claim, str) else claim
    if chosen.system != system:
        raise ArgumentError(f"claim {chosen.id} is about {chosen.system}, not about {system}")
    return chosen


def _judged(lab: _PolicyLaboratory, claim: Claim, *, refine: bool) -> Finding:
    """What is found about a claim, or why nothing can be."""
    try:
        # The premises are those of the law's theorem; a policy relies on none.
        return judge(lab, replace(claim, premise=None), refine=refine)
    except NeedsSlidingModeError as error:
        lab.asked = True
        nothing = Measured(None, f"not judged: {error}", broken=True)
        finding = PlantFinding(nothing, None, Verdict.INCONCLUSIVE)
        return Finding(claim, dict.fromkeys(claim.plants, finding))
