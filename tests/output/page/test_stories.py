"""The case of a system that tells most, and the quantity that is shown of it."""

from grosmc_mj.output.page.reading import CurvePanel, Curves, LimitLine, RecordedCurve
from grosmc_mj.output.page.verdicts import stories
from grosmc_mj.output.results.result import Standing


def panel(label: str, limit: str, largest: float) -> CurvePanel:
    """A quantity with a limit, in which one law is as large as this and the other one is 1."""
    curves = [
        RecordedCurve(t=[0.0, 1.0], y=[0.0, size], law=law, plant="physics")
        for law, size in (("lqr", largest), ("grosmc", 1.0))
    ]
    limits = [LimitLine(t=[0.0, 1.0], y=[2.0, 2.0], words=limit)]
    return CurvePanel(label=label, curves=curves, limits=limits)


def shown(requirement: str) -> str:
    """The quantity that is shown where a law misses a requirement."""
    panels = [
        panel("angle [rad]", "stays within 2", largest=3.0),
        panel("rate [rad/s]", "stays within 20 rad/s", largest=1.0),
        panel("current [A]", "input below 4 A", largest=9.0),
    ]
    curves = Curves(kind="curves", system="servo", case="case1", duration=1.0, panels=panels)
    missed = Standing(
        case="servo/case1",
        law="lqr",
        breaks_at="physics",
        requirement=requirement,
        words=f"{requirement}: 30",
    )
    (story,) = stories({("servo", "case1"): curves}, {"servo/case1": {"lqr": missed}})
    return story.panel.label


def test_the_quantity_of_the_requirement_that_is_missed_is_shown() -> None:
    """Though the words of another one begin alike."""
    assert shown("stays within 20 rad/s") == "rate [rad/s]"


def test_the_quantity_in_which_laws_differ_most_is_shown_where_no_curve_is_required_of() -> None:
    assert shown("no reaching phase") == "current [A]"
