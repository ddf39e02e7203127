"""Claims judged and tried many at once: the same answers in processes as here, in their order."""

from __future__ import annotations

import pytest

from grosmc_mj.chapter.claims.claim import Claim
from grosmc_mj.chapter.claims.faults import FAULTS
from grosmc_mj.chapter.claims.judging import judge, judge_claims, parts_of
from grosmc_mj.chapter.claims.ledger import CLAIMS, find_claim
from grosmc_mj.chapter.claims.self_test import self_test
from grosmc_mj.executors import make_executor
from grosmc_mj.executors.batch import Batch
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.runs import Settings

# Exact ones of three systems, not in the order of their files.
QUICK = [find_claim(name) for name in ("pendulum-eq40", "arm-eq57", "servo-circular-bound")]


def test_every_claim_is_in_one_part_of_one_system() -> None:
    parts = parts_of(CLAIMS)
    assert sorted(claim.id for part in parts for claim in part) == sorted(c.id for c in CLAIMS)
    assert all(len({claim.system for claim in part}) == 1 for part in parts)
    # Enough of them for a handful of cores.
    assert len(parts) >= 12


def test_findings_come_in_the_order_of_the_claims() -> None:
    lab, told = Laboratory(Settings()), []
    findings = judge_claims(lab, QUICK, Batch(), told.append)
    assert [finding.claim for finding in findings] == QUICK
    assert findings == [judge(lab, claim) for claim in QUICK]
    assert sorted(told) == sorted(claim.id for claim in QUICK)


@pytest.mark.slow
def test_processes_find_the_same() -> None:
    lab = Laboratory(Settings())
    executor = make_executor("processes", workers=2)
    assert judge_claims(lab, QUICK, executor) == [judge(lab, claim) for claim in QUICK]
    faults = [each for each in FAULTS if each.name in ("printed physics", "gravity upside down")]
    here, there = (
        self_test(Settings(), QUICK, faults, each, thorough=True) for each in (Batch(), executor)
    )
    assert there == here
    assert here[0].claims or here[1].claims


def test_a_laboratory_travels_without_its_runs() -> None:
    claim = find_claim("servo-circular-bound")
    lab = Laboratory(Settings(control_period=2e-3))
    judge(lab, claim, refine=False)
    other = Laboratory(*lab.__reduce__()[1])
    assert other.settings == lab.settings
    assert other.refined.settings == lab.refined.settings


@pytest.mark.parametrize("name", ["pendulum-region-lqr"])
def test_a_law_that_works_nowhere_has_no_region(name: str) -> None:
    """That it fails from every start does not support that it works from small ones only."""
    claim: Claim = find_claim(name)
    (wrong,) = [each for each in FAULTS if each.name == "wrong sign of u"]
    finding = judge(Laboratory(Settings(), wrong), claim, refine=False)
    measured = finding.plants["corrected"].measured
    assert (measured.value, measured.note) == (None, "not from 5 degrees")
    assert not claim.holds(measured)
