"""The rule that the rivals' numbers come from, and the page that compares them."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import ControllerTable
from grosmc_mj.studies.rivals import SYSTEMS, Rival, compared, rivals, rivals_table

PAGE = Path(__file__).parents[2] / "docs" / "rivals.md"
SLIDING = ("grosmc", "grosmc-implicit")
# The number of each law that the rule chooses.
NUMBERS = {"lqi": "integral_weight", "pid": "frequency", "adrc": "bandwidth"}


@cache
def nominal(system: str) -> Experiment:
    return Experiment.load(f"{system}/{'regulation' if system == 'two_link_arm' else 'nominal'}")


@cache
def measured(system: str) -> list[Rival]:
    return rivals(system)


def response(experiment: Experiment, law: str, factor: float = 1.0) -> tuple[float, float]:
    """Settling time and largest input of a nominal run, the law's number times a factor."""
    if law in NUMBERS:
        table = experiment.file.law(law).model_dump(exclude_unset=True, exclude={"predict"})
        table[NUMBERS[law]] *= factor
        controller = [ControllerTable.model_validate({**table, "law": law, "name": law})]
        file = experiment.file.model_copy(update={"controller": controller})
        experiment = replace(experiment, file=file)
    metrics = experiment.run("corrected", law).metrics
    settled, peak = metrics["settling_time"].value, metrics["max_input"].value
    return math.inf if settled is None else float(settled), float(peak or 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("law", ["lqi", "pid", "adrc", "adaptive"])
def test_numbers_of_the_case_files_keep_the_rule_and_a_tenth_more_breaks_it(
    system: str, law: str
) -> None:
    """Settled within 5 % of the optimum's time, with GROSMC's input at most; no observer too fast.

    The third line alone binds ``adrc``: a thirtieth of 1 kHz is 209 rad/s.
    """
    experiment = nominal(system)
    if law == "adaptive" and not experiment.file.law(law).numbers:
        return
    (optimum, _), (_, most) = response(experiment, "fl-lqr"), response(experiment, "grosmc")

    def allowed(factor: float) -> bool:
        settled, peak = response(experiment, law, factor)
        return abs(settled / optimum - 1) <= 0.05 and peak <= most

    assert allowed(1.0)
    if law == "adrc":
        number = experiment.file.law(law).numbers["bandwidth"]
        assert number <= 2 * math.pi * 1000 / 30 < 1.1 * number
    elif law in NUMBERS:
        assert not allowed(1.1)


def test_the_maker_s_servo_has_its_overshoot_and_peak() -> None:
    """Quanser's workbook asks for 5 % and 0.2 s; the hold of 1 ms adds 0.3 %."""
    machine = Experiment.load("servo/machine")
    own = tuple(edit for edit in machine.case.edits if edit not in machine.case.parts)
    machine = machine.varied(loop=None, edits=own)
    machine = machine.with_settings(timestep=machine.settings.control_period)
    run = machine.run("corrected", "pv")
    error, time = run.comparison.error, run.trajectory.time
    assert -error.min() / error[0] == pytest.approx(0.053, abs=0.001)
    assert time[error.argmin()] == pytest.approx(0.2, abs=0.002)
    p, law = machine.nominal.equations("corrected").parameters, run.controller.designed
    volts = law.lqr.K[0] * p.J / p.Kt * 2.6
    assert volts[0] == pytest.approx(7.82, rel=0.01)
    assert volts[1] - p.B / p.Kt * 2.6 == pytest.approx(-0.157, rel=0.02)


# The page


def cells(table: str) -> dict[tuple[str, str], list[str]]:
    """The cells of each system and law."""
    rows = [line.strip("| ").split(" | ") for line in table.splitlines()[2:]]
    return {(row[0], row[1]): row[2:] for row in rows}


@pytest.mark.slow
@pytest.mark.parametrize("system", SYSTEMS)
def test_page_says_what_a_run_says(system: str) -> None:
    """To 10 %: under sign switching rounding grows, and two machines part."""
    text = PAGE.read_text(encoding="utf-8")
    shown = cells(text.partition("<!-- rivals -->")[2].partition("<!-- /rivals -->")[0].strip())
    for key, row in cells(rivals_table(measured(system))).items():
        for here, there in zip(row, shown[key], strict=True):
            number = re.match(r"[\d.e-]+(?= )", here)
            if number is None:
                assert here == there, key
            elif float(number[0]) > 1e-4:  # a remainder that is rounding is any
                assert float(there.split()[0]) == pytest.approx(float(number[0]), rel=0.1), key
    assert {law for name, law in shown if name == system} == {row.law for row in measured(system)}


@pytest.mark.slow
@pytest.mark.parametrize("system", SYSTEMS)
def test_words_of_the_page_hold(system: str) -> None:
    """GROSMC is ten times closer to the optimum than the best rival, but on the arm."""
    runs = {row.law: row for row in measured(system)}
    rivals_here = [row for law, row in runs.items() if law not in SLIDING]
    best, sliding = min(rivals_here, key=lambda row: row.deviation), [runs[x] for x in SLIDING]
    assert best.law == "adrc"
    if system == "arm":
        others = [row.deviation for row in rivals_here if row is not best]
        assert all(2 * best.deviation < row.deviation < min(others) for row in sliding)
        assert not any(math.isfinite(row.settling) for row in runs.values())
    else:
        for row in sliding:
            assert 10 * row.deviation < best.deviation
            assert row.peak > best.peak
            assert row.kept
        assert runs["grosmc"].variation > 100 * max(row.variation for row in rivals_here)
        assert runs["grosmc-implicit"].variation < 1.3 * best.variation
    left = {law: row.remaining for law, row in runs.items()}
    if system == "servo":
        # The offset of LQR is T_d/(Kt K_1) = 1.5 rad, eq. (15), whatever the inertia.
        p = nominal("servo").nominal.equations("corrected").parameters
        assert left["lqr"] == pytest.approx(1 / p.Kt, rel=1e-3)
        assert max(left["lqi"], left["adrc"]) < 1e-4
    if system == "two_link_arm":
        for law in ("adrc", "adaptive"):
            assert left["grosmc-implicit"] < left[law] < left["grosmc"] / 10
        assert 0.95 < best.peak / runs["grosmc-implicit"].peak < 1.0
        assert runs["adaptive"].peak > runs["grosmc"].peak
    # The rule alone decides how close adrc stays: twice for half of the bandwidth, to 10 %.
    experiment = Experiment.load(f"rivals/{system}")
    table = ControllerTable.model_validate({"law": "adrc", "bandwidth": 400})
    file = experiment.file.model_copy(update={"controller": [table], "requirement": []})
    faster = compared(replace(experiment, file=file).run(law="adrc"))
    assert 2 * faster.deviation == pytest.approx(best.deviation, rel=0.1)
