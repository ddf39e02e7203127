"""What a campaign says, against the columns of its parts."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from campaign_cases import DEVIATION, LQR, PAIR, begun, campaign, falling, kept, servo
from rich.console import Console

from grosmc_mj.cli.commands.campaign.answer import say_findings
from grosmc_mj.results.document import json_text
from grosmc_mj.sweep.findings import ALL, Findings, findings, results_document
from grosmc_mj.sweep.statistics import Sensitivity, paired, pass_rate, sensitivities
from grosmc_mj.sweep.store import Folder, shards_of

COMPLETES = "completes"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """Eight servos in two parts."""
    return kept(campaign(servo(), seed=5), tmp_path_factory.mktemp("campaign"))


@pytest.fixture(scope="module")
def found(folder: Folder) -> Findings:
    """What they say."""
    return findings(campaign(servo(), seed=5), folder, 0.9)


def column(folder: Folder, name: str, law: str) -> np.ndarray:
    return folder.columns(campaign(servo(), seed=5), [name], range(2))[law][name]


@pytest.mark.parametrize("law", ["lqr", "grosmc"])
def test_rates_count_what_the_columns_have(folder: Folder, found: Findings, law: str) -> None:
    for words, name in (
        ("deviation below 3 mrad", "margin deviation_below"),
        ("input below 10 A", "margin input_below"),
        (ALL, "relative"),
    ):
        own = column(folder, name, law)
        rate = found.rates[words, law]
        assert (rate.kept, rate.runs) == ((own >= 0).sum(), 8)
        assert rate == pass_rate(int((own >= 0).sum()), 8, 0.9)
    assert found.rates[COMPLETES, law].kept == 8
    assert found.cut_short[law] == 0
    assert np.array_equal(found.margins[ALL, law], column(folder, "relative", law))


def test_laws_may_be_asked_for_the_same_in_two_tables(tmp_path: Path) -> None:
    both = "".join(f'{DEVIATION}of = ["{law}"]\n' for law in ("lqr", "stiff"))
    asked = campaign(servo(laws=PAIR, limits=both))
    split = findings(asked, kept(asked, tmp_path), 0.9)
    words = "deviation below 3 mrad"
    for law in ("lqr", "stiff"):
        assert split.rates[words, law].kept == (split.margins[words, law] >= 0).sum()
    assert (words, "lqr", "stiff") in split.differences


def test_a_requirement_of_one_law_says_nothing_of_another(found: Findings) -> None:
    assert ("sliding below 0.02 A s", "grosmc") in found.rates
    assert ("sliding below 0.02 A s", "lqr") not in found.rates
    assert {first for _, first, _ in found.differences} == {"lqr"}
    assert {second for _, _, second in found.differences} == {"grosmc"}


def test_differences_and_drivers_are_those_of_the_columns(folder: Folder, found: Findings) -> None:
    lqr, grosmc = (column(folder, "relative", law) for law in ("lqr", "grosmc"))
    difference = found.differences[ALL, "lqr", "grosmc"]
    assert difference == paired(lqr, grosmc, 0.9)
    assert (difference.only_first, difference.only_second) == (0, 6)
    assert ((lqr < 0) & (grosmc >= 0)).sum() == 6
    names = campaign(servo(), seed=5).family.names
    values = {name: column(folder, name, "lqr") for name in names}
    assert found.sensitivities["lqr"] == sensitivities(values, lqr, 0.9)


def test_of_runs_that_are_as_bad_the_first_comes_first(tmp_path: Path) -> None:
    asked = campaign(servo(laws=LQR, limits=""), runs=64, shard=64)
    assert findings(asked, kept(asked, tmp_path), 0.9).worst["lqr"] == list(range(16))


@pytest.mark.parametrize("law", ["lqr", "grosmc"])
def test_the_worst_runs_come_first(folder: Folder, found: Findings, law: str) -> None:
    relative = column(folder, "relative", law)
    assert sorted(found.worst[law]) == list(range(8))
    assert np.all(np.diff(relative[found.worst[law]]) >= 0)


@pytest.mark.parametrize(("share", "named"), [(0.0, False), (0.0049, False), (0.0051, True)])
def test_a_number_with_0_percent_is_not_named_as_a_driver(
    found: Findings, share: float, named: bool
) -> None:
    driver = Sensitivity("rotor mass scale", 0.1, -0.1, 0.3, share, 0.5)
    assert driver.drives == named
    console = Console(width=100, color_system=None)
    with console.capture() as shown:
        told = replace(found, sensitivities={"lqr": [driver]})
        say_findings(console, campaign(servo(), seed=5), told, [], full=False)
    said = " ".join(shown.get().split())
    assert ("rotor mass scale drives its margin most (1 % of" in said) == named
    assert "(0 % of" not in said


def test_a_campaign_that_is_not_complete_says_so(tmp_path: Path) -> None:
    asked = campaign(servo())
    folder = begun(asked, tmp_path)
    shards_of(asked, folder, 0)(1)
    found = findings(asked, folder, 0.95)
    assert (found.sampled.runs, found.sampled.planned) == (4, 8)
    assert found.sampled.words == "4 of 8 runs, random, seed 0"
    assert sorted(found.worst["lqr"]) == [4, 5, 6, 7]


def test_results_are_plain_json(found: Findings) -> None:
    content = results_document(campaign(servo(), seed=5), found)
    json.loads(json_text(content))
    assert "no proof" in content["says"]
    assert "of the declared design, not probabilities" in content["says"]
    assert "Intervals and p: of independent runs" in content["says"]
    # All runs that are kept give an interval too: 0.05^(1/8) is its lower end.
    kept_by_all = [each for each in content["pass_rates"] if each["requirement"] == COMPLETES]
    lows = [each["low"] for each in kept_by_all]
    assert lows == pytest.approx([0.05 ** (1 / 8)] * 2, rel=1e-9)
    assert {each["high"] for each in kept_by_all} == {1.0}


def test_runs_that_end_early_are_failures_with_their_cause(tmp_path: Path) -> None:
    asked = falling()
    folder = kept(asked, tmp_path)
    found = findings(asked, folder, 0.95)
    status = folder.columns(asked, ["status"], [0])["fl-lqr"]["status"]
    early = int((status == "undefined_law").sum())
    assert 0 < early < 16
    assert found.cut_short["fl-lqr"] == early
    assert found.rates[COMPLETES, "fl-lqr"].kept == 16 - early
    assert found.rates[ALL, "fl-lqr"].kept <= 16 - early
    assert np.isneginf(found.margins[ALL, "fl-lqr"]).sum() == early
    assert status[found.worst["fl-lqr"][:early]].tolist() == ["undefined_law"] * early
    # JSON has no infinities: null stands for them, and beside it how many runs ended early.
    written = json.loads(json_text(results_document(asked, found)))["margins"]
    (least,) = (
        each for each in written if (each["requirement"], each["controller"]) == (ALL, "fl-lqr")
    )
    assert (least["least"], least["diverged"]) == (None, early)


@pytest.mark.parametrize("sampler", ["sobol", "lhs", "corners"])
def test_points_that_are_no_independent_runs_give_no_interval_and_say_why(
    sampler: str, tmp_path: Path
) -> None:
    asked = campaign(servo(laws=PAIR, limits=DEVIATION), sampler=sampler, runs=4)
    found = findings(asked, kept(asked, tmp_path), 0.9)
    rate, difference = found.rates[ALL, "lqr"], found.differences[ALL, "lqr", "stiff"]
    assert (rate.runs, rate.low, rate.high) == (4, None, None)
    assert (difference.low, difference.p_value, difference.median_low) == (None, None, None)
    assert {summary.mean_low for summary in found.summaries.values()} == {None}
    assert found.sampled.intervals.startswith(f"no interval: --sampler {sampler}")
