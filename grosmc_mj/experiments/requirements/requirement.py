"""The base class of all kinds of requirements."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any, ClassVar

from grosmc_mj.experiments.requirements.conditions import RecordedRun
from grosmc_mj.experiments.requirements.measured_run import MeasuredRun
from grosmc_mj.experiments.requirements.measurement import Windows
from grosmc_mj.experiments.requirements.metrics import DWELL, MeasuredSignal, Metric
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, name_list
from grosmc_mj.ground.wording import spelled
from grosmc_mj.theory.control.controller import Controller

# Sampling periods of a run at least: an error settles only if it stays for this share of a run.
_LEAST_INTERVALS = round(1 / DWELL)
# s(0) and an error at the start are zero to rounding of z and of its reference.
ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class Requirement:
    """A metric of a run is at most a number.

    A kind of requirement is a subclass in a file of its own, listed in ``KINDS``.

    Attributes:
        key: Key of the kind in a file.
        quantity: The quantity whose unit the number has: ``output``, ``input``, ``sliding``, or
            the unit itself; empty for a kind that is asked for with ``true``.
        options: Further keys of a file that the kind reads, such as ``state`` and ``after``.
        needs_band: Whether it has no default for ``band``.
        figure: The quantity in whose figure it is shown; empty for none.
        usual_metric: Name of the limited metric, if it is one of every run.
        not_in_logs: Reason why no log of the machine decides it; empty if one may.
        of_actuators: Whether it is about the range of the actuators, not about the task.
        of_onsets: Whether it is about instants at which disturbances begin or end.
        recorded: Whether it is measured on a recorded run, not accumulated during the run.
        undefined: Reason why there is no value where the metric is infinite.
        usual: Largest usual number; a larger one is allowed, and probably a mistake.
        number: The largest value allowed.
        unit: Unit of the number.
        written: The number as written in the file.
        laws: Names of the controllers that must keep it.
        plants: Names of the plants on which they must keep it.
        name: Unique name among the requirements of a campaign.
        signal: Name of the state or output that it is about; empty for all outputs.
        after: Instant from which on it holds [s].
        periodic: Whether an angle counts modulo a turn.
    """

    key: ClassVar[str] = ""
    quantity: ClassVar[str] = ""
    options: ClassVar[tuple[str, ...]] = ()
    figure: ClassVar[str] = ""
    usual_metric: ClassVar[str] = ""
    not_in_logs: ClassVar[str] = ""
    of_actuators: ClassVar[bool] = False
    of_onsets: ClassVar[bool] = False
    recorded: ClassVar[bool] = False
    needs_band: ClassVar[bool] = False
    undefined: ClassVar[str] = ""
    usual: ClassVar[float] = math.inf

    number: float
    unit: str = ""
    written: str = ""
    laws: tuple[str, ...] = ()
    plants: tuple[str, ...] = ()
    name: str = ""
    signal: str = ""
    after: float = 0.0
    periodic: bool = False

    # -- where it is defined -----------------------------------------------------------------------

    @classmethod
    def can_be_asked_of(cls, law: Controller, value: Any) -> bool:
        """Whether a law has the quantity; ``value`` is that of the key in the file."""
        return True

    @classmethod
    def refuse_undefined(cls, error: Any, laws: Sequence[str], signal: str) -> None:
        """Refuse a requirement on a quantity that the plant or the laws do not have.

        Args:
            error: Error coordinates of the laws.
            laws: Names of the laws that it is asked of.
            signal: Name of the state or output that it is about; empty for all outputs.

        Raises:
            ArgumentError: With the reason.
        """
        if cls.quantity == "output" and not signal:
            units = {error.units[row] for row in error.output_rows}
            if len(units) > 1:
                raise ArgumentError("the outputs have different units: there is no one error")

    @classmethod
    def holds_from(cls, after: float, duration: float) -> float:
        """Return the instant from which on it holds [s].

        Args:
            after: The file's ``after`` [s].
            duration: Duration of a run [s].
        """
        return after if "after" in cls.options else 0.0

    def on_motors(self, *, stronger: bool) -> Requirement:
        """Return the requirement on runs in which motors stand in the place of ideal inputs.

        Args:
            stronger: Whether one of them may give more than the largest input.
        """
        return self

    def refuse_start(self, law: Controller, x0: Sequence[float]) -> None:
        """Refuse a start from which nothing can be measured.

        Args:
            law: One of the laws that must keep it.
            x0: Start, (n,).

        Raises:
            ArgumentError: If it is a share of the error at the start, which is zero to rounding.
        """

    def refuse_duration(self, duration: float) -> None:
        """Refuse runs that are too short to decide it.

        Args:
            duration: Duration of a run [s].

        Raises:
            ArgumentError: If one that fails in it might be kept in a longer one.
        """

    def refuse_timestep(self, timestep: float, duration: float) -> None:
        """Refuse a requirement on times between two timesteps.

        Args:
            timestep: Timestep of runs [s].
            duration: Duration of a run [s].

        Raises:
            ArgumentError: If a time that it is about has no instant in it.
        """

    def why_undecidable(self, transient: float) -> str:
        """Return why no run can decide it, or nothing.

        Args:
            transient: Time before a disturbance begins or a run ends [s].
        """
        return ""

    def why_unfailing(self, law: Controller, input_limits: Array) -> str:
        """Return why a run that reaches its end keeps it whatever it does, or nothing.

        Args:
            law: The controller of the run.
            input_limits: Least and largest of each input, (2, m).
        """
        return ""

    def why_not_measured(self, law: Controller, known: Set[str]) -> str:
        """Return why a log of the machine cannot decide it, or nothing.

        Args:
            law: The controller under which the log was made.
            known: Names of the signals that the log has, see ``signals``.
        """
        if self.not_in_logs or self.of_actuators:
            return self.not_in_logs
        error = law.designed.error
        needed = [error.names[row] for row in error.output_rows]
        if self.signal:
            needed = [self.signal]
        return missing_signals(needed, known)

    def why_too_few_samples(self, period: float, duration: float) -> str:
        """Return why equally spaced samples cannot decide it, or nothing.

        Args:
            period: Time between two of them [s].
            duration: Time from the first to the last one [s].
        """
        intervals = round(duration / period)
        if intervals < _LEAST_INTERVALS:
            return (
                f"its samples are {period:g} s apart: {duration:g} s need one in each "
                f"{DWELL * duration:g} s"
            )
        if self.quantity == "s" and self.number < period:
            return f"its samples are {period:g} s apart"
        return ""

    # -- what is measured --------------------------------------------------------------------------

    @property
    def has_value(self) -> bool:
        """Whether a value is measured, not a margin alone."""
        return True

    def margin_of(self, value: Any) -> Any:
        """Return allowed less measured value."""
        return self.number - value

    def in_file_unit(self, value: float) -> tuple[float, str]:
        """Return a value in the unit in which the file writes the number, and that unit."""
        allowed, _, unit = self.written.partition(" ")
        try:
            return value * float(allowed) / self.number, unit
        except ValueError:
            # A requirement that is asked for with ``true`` has no number in the file.
            return value, self.unit

    @property
    def metric(self) -> str:
        """Name of the limited metric."""
        return self.usual_metric

    @property
    def tolerated_as(self) -> str:
        """Name of the metric whose tolerance on another machine the margin has."""
        return self.metric

    @property
    def windows(self) -> Windows:
        """Windows, bands and signals that the metric needs."""
        if self.recorded:
            return Windows()
        signal = MeasuredSignal(self.signal, self.periodic)
        signals = (signal,) if signal != MeasuredSignal() else ()
        after = (self.after,) if self.after else ()
        return Windows(after=after, signals=signals)

    def watched(self, error: Any) -> list[str]:
        """Return the names of the signals that it is about, see ``signals``.

        Args:
            error: Error coordinates of the law.
        """
        if self.of_actuators:
            return [signal.name for signal in error.system.inputs]
        if not self.signal:
            return [f"{error.names[row]} error" for row in error.output_rows]
        return [f"{self.signal} error" if self.signal in error.names else self.signal]

    @property
    def title(self) -> str:
        """The kind in words, behind the state or output that it is about."""
        return f"{self.signal} {spelled(self.key)}".lstrip()

    @property
    def words(self) -> str:
        """The requirement in words."""
        words = f"{self.title} {self.written}"
        if self.periodic:
            words += " modulo a turn"
        if self.after and "after" in self.options:
            words += f" from {self.after:g} s on"
        return words

    @property
    def shown_with(self) -> str:
        """The quantity, state or output in whose figure it is shown; empty for none."""
        if self.figure and self.signal:
            return self.signal
        return self.figure

    @property
    def is_level(self) -> bool:
        """Whether it is a line in its figure."""
        return bool(self.figure) and self.quantity in ("output", "input", "sliding")

    def applies_to(self, run: MeasuredRun) -> bool:
        """Whether it is about a run."""
        return run.controller.name in self.laws and run.plant in self.plants

    def measured(self, run: MeasuredRun) -> tuple[float | None, str]:
        """Return the limited value of a run, or None and the reason why there is none."""
        if self.after and run.trajectory.time[-1] < self.after * (1 - 1e-12):
            return None, "the run is shorter"
        value = self.value_of(run)
        if self.undefined and math.isinf(value):
            return None, self.undefined
        return value, ""

    def value_of(self, run: MeasuredRun) -> float:
        """Return the limited metric of a recorded run; infinite where it is not defined."""
        if self.recorded:
            return self.of_record(run.record)
        return run.values(self.windows)[self.metric]

    def of_record(self, run: RecordedRun) -> float:
        """Return the limited metric of a recorded run of a kind that is ``recorded``."""
        raise NotImplementedError

    def of_optimum(self, run: MeasuredRun) -> Metric | None:
        """Return the value of the run's nominal optimum itself; None where it tells nothing."""
        return None

    def note(self, run: MeasuredRun, *, kept: bool) -> str:
        """Return a note on the judgement of a completed run, or nothing."""
        return ""

    def order_share(
        self, share: Array, metrics: Mapping[str, Array], transient: Array, start: float
    ) -> Array:
        """Return margins in parts of the number without the bound that a run's length gives, (n,).

        Args:
            share: Margins in parts of the number, (n,).
            metrics: Metrics of the runs, (n,) each.
            transient: Length of their transients [s], (n,).
            start: Size of the nominal error at the start, in the outputs' unit.
        """
        return share


def missing_signals(needed: Iterable[str], known: Set[str]) -> str:
    """Return a line on the signals that a log does not have, or nothing."""
    missing = [name for name in needed if name not in known]
    if not missing:
        return ""
    return f"the log does not have {name_list(missing)}"
