"""The rule that the rivals' numbers come from, and the page that compares them."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.file.schema import ControllerTable
from grosmc_mj.studies.rivals import SYSTEMS, Rival, compared, rivals, rivals_table

PAGE = Path(__file__).parents[2] / "docs" / "rivals.md"
SLIDING = ("grosmc", "grosmc-implicit")
# The number of each law that the rule chooses.
NUMBERS = {"lqi": "integral_weight", "fl-pid": "frequency", "adrc": "bandwidth"}


@cache
def nominal(system: str) -> Experiment:
    case = "regulation" if system == "two_link_arm" else "nominal"
    return Experiment.load(f"{system}/{case}")


@cache
def measured(system: str) -> list[Rival]:
    return rivals(system)


@cache
def response(system: str, law: str, factor: float) -> tuple[float, float]:
    """Settling time and largest input of a nominal run, the law's number times a factor."""
    experiment = nominal(system)
    if law in NUMBERS:
        table = experiment.file.law(law).model_dump(exclude_unset=True, exclude={"predict"})
        table[NUMBERS[law]] *= factor
        controller = [ControllerTable.model_validate({**table, "law": law, "name": law})]
        file = experiment.file.model_copy(update={"controller": controller})
        experiment = replace(experiment, file=file)
    metrics = experiment.run("corrected", law).metrics
    settled = metrics["settling_time"].value
    peak = metrics["max_input"].value
    if settled is None:
        settled = math.inf
    return settled, float(peak or 0.0)


def allowed(system: str, law: str, factor: float) -> bool:
    """True if a run settles within 5 % of the optimum's time, with GROSMC's input at most."""
    optimum, _ = response(system, "fl-lqr", 1.0)
    _, most = response(system, "grosmc", 1.0)
    settled, peak = response(system, law, factor)
    return abs(settled / optimum - 1) <= 0.05 and peak <= most


@pytest.mark.slow
@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("law", ["lqi", "fl-pid", "adrc", "adaptive"])
def test_numbers_of_the_case_files_keep_the_rule(system: str, law: str) -> None:
    if law == "adaptive" and not nominal(system).file.law(law).numbers:
        return
    assert allowed(system, law, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("law", ["lqi", "fl-pid"])
def test_a_tenth_more_than_the_number_of_a_case_file_breaks_the_rule(system: str, law: str) -> None:
    assert not allowed(system, law, 1.1)


# The rule binds ``adrc`` by its observer alone: a thirtieth of 1 kHz is 209 rad/s.
FASTEST_OBSERVER = 2 * math.pi * 1000 / 30


@pytest.mark.parametrize("system", SYSTEMS)
def test_the_observer_of_adrc_is_not_too_fast(system: str) -> None:
    assert nominal(system).file.law("adrc").numbers["bandwidth"] <= FASTEST_OBSERVER


@pytest.mark.parametrize("system", SYSTEMS)
def test_an_observer_that_is_a_tenth_faster_is_too_fast(system: str) -> None:
    assert 1.1 * nominal(system).file.law("adrc").numbers["bandwidth"] > FASTEST_OBSERVER


@cache
def maker_s_run() -> tuple[Experiment, RunResult]:
    """The machine of the servo without its parts and its loop, under the maker's law."""
    machine = Experiment.load("servo/machine")
    edits = tuple(edit for edit in machine.edits if edit not in machine.parts)
    machine = machine.changed(loop=None, edits=edits)
    machine = machine.changed(timestep=machine.settings.control_period)
    return machine, machine.run("corrected", "pv")


def test_the_maker_s_servo_overshoots_by_5_percent() -> None:
    """Quanser's workbook asks for 5 %; the hold of 1 ms adds 0.3 %."""
    _, run = maker_s_run()
    error = run.comparison.error
    assert -error.min() / error[0] == pytest.approx(0.053, abs=0.001)


def test_the_maker_s_servo_peaks_after_a_fifth_of_a_second() -> None:
    _, run = maker_s_run()
    peak = run.comparison.error.argmin()
    assert run.trajectory.time[peak] == pytest.approx(0.2, abs=0.002)


def test_the_maker_s_servo_has_the_gains_of_the_workbook() -> None:
    """In volts, without the friction that the model has in it."""
    machine, run = maker_s_run()
    p = machine.nominal.equations("corrected").parameters
    volts = run.controller.designed.lqr.K[0] * p.J / p.Kt * 2.6
    assert volts[0] == pytest.approx(7.82, rel=0.01)
    assert volts[1] - p.B / p.Kt * 2.6 == pytest.approx(-0.157, rel=0.02)


# The page


def cells(table: str) -> dict[tuple[str, str], list[str]]:
    """The cells of each system and law."""
    rows = [line.strip("| ").split(" | ") for line in table.splitlines()[2:]]
    return {(row[0], row[1]): row[2:] for row in rows}


def page_table() -> dict[tuple[str, str], list[str]]:
    """The cells of the page."""
    text = PAGE.read_text(encoding="utf-8")
    _, _, begun = text.partition("<!-- rivals -->")
    table, _, _ = begun.partition("<!-- /rivals -->")
    return cells(table.strip())


@pytest.mark.slow
@pytest.mark.parametrize("system", SYSTEMS)
def test_page_says_what_a_run_says(system: str) -> None:
    """To 10 %: under sign switching rounding grows, and two machines part."""
    page = page_table()
    assert {law for name, law in page if name == system} == {row.law for row in measured(system)}
    for key, row in cells(rivals_table(measured(system))).items():
        for cell, on_page in zip(row, page[key], strict=True):
            number = re.match(r"[\d.e-]+(?= )", cell)
            if number is None:
                assert cell == on_page, key
            elif float(number[0]) > 1e-4:  # a remainder that is rounding is any
                assert float(on_page.split()[0]) == pytest.approx(float(number[0]), rel=0.1), key


def by_law(system: str) -> dict[str, Rival]:
    return {row.law: row for row in measured(system)}


def rivals_of(system: str) -> list[Rival]:
    """The laws beside GROSMC."""
    return [row for row in measured(system) if row.law not in SLIDING]


def best_of(system: str) -> Rival:
    """The rival that is closest to the optimum."""
    return min(rivals_of(system), key=lambda row: row.deviation)


@pytest.mark.slow
@pytest.mark.parametrize("system", SYSTEMS)
def test_adrc_is_the_best_rival(system: str) -> None:
    assert best_of(system).law == "adrc"


@pytest.mark.slow
@pytest.mark.parametrize("system", ["servo", "cart_pendulum", "two_link_arm"])
@pytest.mark.parametrize("law", SLIDING)
def test_grosmc_is_ten_times_closer_to_the_optimum_than_the_best_rival(
    system: str, law: str
) -> None:
    sliding = by_law(system)[law]
    best = best_of(system)
    assert 10 * sliding.deviation < best.deviation
    assert sliding.peak > best.peak
    assert sliding.kept


@pytest.mark.slow
@pytest.mark.parametrize("system", ["servo", "cart_pendulum", "two_link_arm"])
def test_only_grosmc_with_sgn_chatters(system: str) -> None:
    runs = by_law(system)
    largest = max(row.variation for row in rivals_of(system))
    assert runs["grosmc"].variation > 100 * largest
    assert runs["grosmc-implicit"].variation < 1.3 * best_of(system).variation


@pytest.mark.slow
@pytest.mark.parametrize("law", SLIDING)
def test_on_the_arm_adrc_is_twice_as_close_as_grosmc(law: str) -> None:
    best = best_of("arm")
    assert 2 * best.deviation < by_law("arm")[law].deviation


@pytest.mark.slow
@pytest.mark.parametrize("law", SLIDING)
def test_on_the_arm_grosmc_is_closer_than_every_rival_but_adrc(law: str) -> None:
    best = best_of("arm")
    others = [row.deviation for row in rivals_of("arm") if row is not best]
    assert by_law("arm")[law].deviation < min(others)


@pytest.mark.slow
def test_no_law_settles_on_the_arm() -> None:
    assert not any(math.isfinite(row.settling) for row in measured("arm"))


@pytest.mark.slow
def test_lqr_leaves_an_offset_of_the_servo() -> None:
    """The offset of LQR is T_d/(Kt K_1) = 1.5 rad, eq. (15), whatever the inertia."""
    runs = by_law("servo")
    p = nominal("servo").nominal.equations("corrected").parameters
    assert runs["lqr"].remaining == pytest.approx(1 / p.Kt, rel=1e-3)
    assert max(runs["lqi"].remaining, runs["adrc"].remaining) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("law", ["adrc", "adaptive"])
def test_two_link_arm_comes_closest_under_grosmc_in_the_end(law: str) -> None:
    runs = by_law("two_link_arm")
    remaining = runs[law].remaining
    assert runs["grosmc-implicit"].remaining < remaining < runs["grosmc"].remaining / 10


@pytest.mark.slow
def test_the_best_rival_has_almost_the_peak_of_grosmc_on_the_two_link_arm() -> None:
    runs = by_law("two_link_arm")
    assert 0.95 < best_of("two_link_arm").peak / runs["grosmc-implicit"].peak < 1.0


@pytest.mark.slow
def test_the_adaptive_law_has_a_larger_peak_than_grosmc_on_the_two_link_arm() -> None:
    runs = by_law("two_link_arm")
    assert runs["adaptive"].peak > runs["grosmc"].peak


@pytest.mark.slow
@pytest.mark.parametrize("system", SYSTEMS)
def test_the_rule_alone_decides_how_close_adrc_stays(system: str) -> None:
    """Twice for half of the bandwidth, to 10 %."""
    experiment = Experiment.load(f"rivals/{system}")
    table = ControllerTable.model_validate({"law": "adrc", "bandwidth": 400})
    file = experiment.file.model_copy(update={"controller": [table], "requirement": []})
    faster = compared(replace(experiment, file=file).run(law="adrc"))
    assert 2 * faster.deviation == pytest.approx(best_of(system).deviation, rel=0.1)
