"""Distance from the nominal optimum, and cost of a run over the least one."""

from __future__ import annotations

from grosmc_mj.experiments.requirements.requirement import Requirement


class DeviationBelow(Requirement):
    """Largest distance from the law's own nominal optimum."""

    key = "deviation_below"
    quantity = "output"
    figure = "deviation"
    usual_metric = "deviation"
    not_in_logs = "a log is not compared with the nominal optimum"


class CostRatioBelow(Requirement):
    """J with the whole input over J*.

    Under a law that chatters it grows with the run's length: the number belongs to a file's
    duration.
    """

    key = "cost_ratio_below"
    quantity = "1"
    usual_metric = "cost_ratio"
    not_in_logs = "a log does not have the input that the index weighs"
    undefined = "J* is zero: the run starts where it shall end"
