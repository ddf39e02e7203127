"""The verdicts that the repository expects, each with its reason: a file to be reviewed."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from grosmc_mj.chapter.claims.claim import Finding, Verdict
from grosmc_mj.errors import SetupError

EXPECTED_FILE = Path(__file__).with_name("expected_verdicts.toml")


class Expectation(NamedTuple):
    """What is expected of a claim.

    Attributes:
        verdicts: By plant.
        reason: Why.
    """

    verdicts: dict[str, Verdict]
    reason: str


def load_expectations() -> dict[str, Expectation]:
    """The expected verdicts by the claims' ids.

    Raises:
        SetupError: If the file is missing or broken.
    """
    try:
        content = tomllib.loads(EXPECTED_FILE.read_text(encoding="utf-8"))
        return {
            name: Expectation(
                {plant: Verdict(verdict) for plant, verdict in entry["verdicts"].items()},
                entry["reason"],
            )
            for name, entry in content.items()
        }
    except OSError as error:
        raise SetupError(f"{EXPECTED_FILE} is missing: install again") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SetupError(f"{EXPECTED_FILE}: {error}") from error


def verdict_differences(findings: Sequence[Finding]) -> list[str]:
    """One line for each verdict that is not the expected one."""
    expected, found = load_expectations(), []
    for finding in findings:
        name = finding.claim.id
        if name not in expected:
            found.append(f"claim {name}: no verdict is expected in {EXPECTED_FILE.name}")
            continue
        for plant, each in finding.plants.items():
            wanted = expected[name].verdicts.get(plant)
            if each.verdict is not wanted:
                words = "none" if wanted is None else wanted.value
                found.append(f"claim {name} on {plant}: {each.verdict.value}, expected {words}")
    return found
