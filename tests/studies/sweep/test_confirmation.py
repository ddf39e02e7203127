"""Which runs by equations MuJoCo confirms, and the bound that those drawn at random give."""

import numpy as np
import pytest
from scipy import stats

from grosmc_mj.studies.sweep.confirmation import (
    FACTOR,
    LEAST_BAND,
    Confirmation,
    MarginConfirmation,
    confirmation_words,
    drawn_at_random,
)

RUNS = 200
NONE = np.zeros(RUNS, bool)
DRAWN = drawn_at_random(RUNS)
IN_DOUBT = np.arange(RUNS) < 10


def test_one_run_in_fifty_is_drawn_and_one_at_least() -> None:
    assert DRAWN.sum() == 4
    assert drawn_at_random(3).sum() == 1


def test_runs_in_doubt_and_drawn_runs_are_confirmed_and_no_others() -> None:
    confirmation = Confirmation(IN_DOUBT, DRAWN)
    rows = confirmation.rows()
    assert rows.tolist() == np.flatnonzero(IN_DOUBT | DRAWN).tolist()
    confirmation.note(rows, np.zeros(len(rows), bool))
    assert confirmation.rows().size == 0


def test_all_are_confirmed_after_one_difference_of_a_run_that_was_not_in_doubt() -> None:
    confirmation = Confirmation(IN_DOUBT, DRAWN)
    rows = confirmation.rows()
    confirmation.note(rows, rows == np.flatnonzero(DRAWN & ~IN_DOUBT)[0])
    assert confirmation.refuted
    assert len(rows) + len(confirmation.rows()) == RUNS


def test_a_difference_of_a_run_in_doubt_refutes_nothing() -> None:
    confirmation = Confirmation(IN_DOUBT, DRAWN)
    rows = confirmation.rows()
    confirmation.note(rows, IN_DOUBT[rows])
    assert confirmation.rows().size == 0


def test_runs_that_are_doubted_later_are_confirmed_then() -> None:
    confirmation = Confirmation(NONE, DRAWN)
    rows = confirmation.rows()
    confirmation.note(rows, np.zeros(len(rows), bool))
    confirmation.doubt(IN_DOUBT | DRAWN)
    assert confirmation.rows().tolist() == np.flatnonzero(IN_DOUBT & ~DRAWN).tolist()
    # Runs that were drawn before they were in doubt still stand for the others.
    assert confirmation.drawn.sum() == DRAWN.sum()


@pytest.mark.parametrize("overturned", [0, 2])
def test_the_share_of_wrong_verdicts_is_bounded_by_drawn_runs_alone(overturned: int) -> None:
    confirmation = Confirmation(IN_DOUBT, DRAWN)
    rows = confirmation.rows()
    drawn = np.flatnonzero(DRAWN & ~IN_DOUBT)
    confirmation.note(rows, IN_DOUBT[rows] | np.isin(rows, drawn[:overturned]))
    share = confirmation.wrong_at_most
    assert stats.binom.cdf(overturned, len(drawn), share) == pytest.approx(0.05, rel=1e-9)


def test_without_a_drawn_run_there_is_no_bound() -> None:
    assert Confirmation(IN_DOUBT, NONE).wrong_at_most == 1.0
    words = confirmation_words(0, 0)
    assert words == "none confirmed at random, so no bound on those by the equations"


def test_words_on_drawn_runs_have_the_bound() -> None:
    # 1 - 0.05^(1/41) of 41 runs without an overturned one.
    assert confirmation_words(41, 0) == (
        "of 41 confirmed at random, 0 overturned: at most 7 % of those by the equations at 95 %"
    )


def test_the_band_about_a_limit_is_widened_by_the_differences_that_are_found() -> None:
    margins = np.linspace(0.001, 1, RUNS)[None]
    confirmation = MarginConfirmation(margins, NONE, np.arange(RUNS) == RUNS - 1)
    assert confirmation.band == LEAST_BAND
    rows = confirmation.rows()
    assert rows.tolist() == [RUNS - 1]

    confirmation.note_margins(rows, np.zeros(1, bool), margins[:, rows] - 0.01)
    assert confirmation.band == pytest.approx(FACTOR * 0.01)
    assert confirmation.rows().tolist() == np.flatnonzero(margins[0] <= confirmation.band).tolist()


@pytest.mark.parametrize("by_physics", [-0.001, -np.inf])
def test_a_margin_whose_sign_is_overturned_is_within_the_band(by_physics: float) -> None:
    """Also that of a run that ends early in MuJoCo."""
    confirmation = MarginConfirmation(np.array([[0.2, 1.0]]), np.ones(2, bool), np.zeros(2, bool))
    confirmation.note_margins(np.arange(2), np.array([True, False]), np.array([[by_physics, 1.0]]))
    assert confirmation.band >= FACTOR * 0.2


def test_runs_without_a_margin_are_not_near_a_limit() -> None:
    margins = np.array([[np.nan, -np.inf, np.inf]])
    confirmation = MarginConfirmation(margins, np.zeros(3, bool), np.zeros(3, bool))
    assert confirmation.rows().size == 0
