"""Formulas of signal temporal logic that hold at each instant, and bounds of a signal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.experiments.requirements.conditions import RecordedRun
from grosmc_mj.experiments.requirements.requirement import Requirement, missing_signals
from grosmc_mj.experiments.requirements.signals import SLIDING, named_units
from grosmc_mj.experiments.requirements.temporal import samples_between
from grosmc_mj.experiments.requirements.temporal_text import (
    TemporalSpecification,
    read_formula,
    signals_in,
)
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.units import number_in
from grosmc_mj.theory.control.controller import Controller


@dataclass(frozen=True, kw_only=True)
class Always(Requirement):
    """A formula holds at each instant from ``after`` on.

    An instant counts if the run is long enough for what the formula asks after it.

    Where all of a formula bounds one quantity by numbers, such as ``abs(error) < 20 mrad`` or
    ``0.9 rad < rotor angle < 1.1 rad``, the measured value is the one of this quantity that is
    nearest to its bound or furthest past it. Any other formula has a margin alone. The number, of
    which margins are told as a part, is the smallest constant that something is compared with.

    Attributes:
        specification: The formula.
        until: Last instant at which it must hold [s].
    """

    key = "always"
    quantity = "formula"
    options = ("after",)
    recorded = True

    specification: TemporalSpecification
    until: float = math.inf

    @classmethod
    def can_be_asked_of(cls, law: Controller, value: Any) -> bool:
        """Whether a law has all signals of a formula: only laws with a surface have s."""
        used = signals_in(value, named_units(law, "1"))
        if any(name.split()[0] == SLIDING for name in used):
            return bool(law.designed.sliding_unit)
        return True

    @classmethod
    def refuse_undefined(cls, error: Any, laws: Sequence[str], signal: str) -> None:
        """Refuse laws without the signals of the formula."""
        if not laws:
            raise ArgumentError(f"no law that it is asked of has a surface, and so {SLIDING!r}")

    @classmethod
    def options_in(
        cls,
        written: Mapping[str, Any],
        units: Mapping[str, str],
        duration: float,
    ) -> dict[str, Any]:
        """Return the attributes that a table of a file gives.

        Args:
            written: Values of the table by key.
            units: Units of the signals by name.
            duration: Duration of a run [s].

        Raises:
            ArgumentError: If the formula cannot be read, or asks for a longer run.
        """
        after = written["after"]
        return {**cls.read(written[cls.key], units, duration - after), "after": after}

    @classmethod
    def read(cls, text: str, units: Mapping[str, str], wait: float) -> dict[str, Any]:
        """Return the formula, its unit and its number.

        Args:
            text: The formula.
            units: Units of the signals by name.
            wait: Time between the first instant and the end of a run [s].

        Raises:
            ArgumentError: If it cannot be read, or asks for a longer run.
        """
        specification = read_formula(text, units)
        horizon = specification.formula.horizon
        if horizon > wait * (1 + 1e-12):
            raise ArgumentError(
                f"it asks for {horizon:g} s after an instant; the run has {wait:g} s"
            )
        return {
            "specification": specification,
            "unit": specification.unit,
            "number": specification.number,
        }

    def why_not_measured(self, law: Controller, known: Set[str]) -> str:
        """Name the signals of the formula that a log does not have."""
        return missing_signals(self.watched(law.designed.error), known)

    @property
    def has_value(self) -> bool:
        """Whether one quantity is bounded, which can be measured."""
        return self.specification.formula.bounds is not None

    def margin_of(self, value: Any) -> Any:
        """Return the margin of a measured value; a formula without one measures its margin."""
        bounds = self.specification.formula.bounds
        return value if bounds is None else bounds.margin(value)

    def in_file_unit(self, value: float) -> tuple[float, str]:
        """Return a value and the unit of the formula, which has no one number."""
        return value, self.unit

    def refuse_timestep(self, timestep: float, duration: float) -> None:
        """Refuse windows and intervals between two timesteps."""
        reason = self._why_no_sample(timestep, duration)
        if reason:
            raise ArgumentError(reason)

    def why_too_few_samples(self, period: float, duration: float) -> str:
        """Name the window or the interval in which there is no sample."""
        too_few = super().why_too_few_samples(period, duration)
        return too_few or self._why_no_sample(period, duration)

    def _why_no_sample(self, period: float, duration: float) -> str:
        """Name the window or the interval in which there is no sample."""
        intervals = list(self.specification.formula.intervals())
        if math.isfinite(self.until):
            intervals.append((self.after, self.until))
        for begin, end in intervals:
            first, last = samples_between(begin, end, period, round(duration / period))
            if last < first:
                return (
                    f"no sample is between {begin:g} s and {end:g} s: one comes each {period:g} s"
                )
        return ""

    @property
    def metric(self) -> str:
        """Name of the measured value, or of the margin where there is none."""
        return f"{self.words} {self.unit}"

    def watched(self, error: Any) -> list[str]:
        """Return the names of the signals in the formula."""
        return sorted(self.specification.signals - {"t"})

    def of_record(self, run: RecordedRun) -> float:
        """Return the value nearest to its bound, or the least margin of a formula without one.

        It is infinite where a quotient is undefined.
        """
        formula = self.specification.formula
        bounds = formula.bounds
        time = run.trajectory.time
        period = float(time[1])
        signals = run.signals(self.specification.signals)
        try:
            with np.errstate(divide="raise", invalid="raise"):
                if bounds is None:
                    values = formula.margins(signals, period)
                else:
                    values = np.broadcast_to(bounds.quantity.values(signals), time.shape)
        except FloatingPointError:
            return -math.inf if bounds is None else bounds.undefined

        most = len(values) - 1
        first, last = samples_between(self.after, self.until, period, most)
        # The last instants have no samples for all that the formula asks after them.
        needed, _ = samples_between(formula.horizon, math.inf, period, most)
        last = min(last, most - needed)
        asked = values[first : last + 1]
        return float(np.min(asked)) if bounds is None else bounds.nearest(asked)


@dataclass(frozen=True, kw_only=True)
class SignalBetween(Always):
    """A signal is ``above`` one number and ``below`` another one, ``from`` one instant ``to`` one.

    It is the formula ``SIGNAL > ABOVE and SIGNAL < BELOW`` at these instants.

    Attributes:
        bounds: The bounds in words.
    """

    key = "signal"
    options = ("above", "below", "from", "to")

    bounds: str

    @classmethod
    def can_be_asked_of(cls, law: Controller, value: Any) -> bool:
        """Whether a law has the signal, see ``Always``."""
        require_known("signal", value, named_units(law, "1"))
        return super().can_be_asked_of(law, value)

    @classmethod
    def options_in(
        cls,
        written: Mapping[str, Any],
        units: Mapping[str, str],
        duration: float,
    ) -> dict[str, Any]:
        """Read the bounds, see ``Always``."""
        name = written[cls.key]
        unit = units[name]
        sides = []
        bounds = []
        for option, sign in (("above", ">"), ("below", "<")):
            if written[option] is None:
                continue
            number = number_in(written[option], unit)
            sides.append(f"{name} {sign} {number!r} {unit.removesuffix('1')}")
            bounds.append(f"{option} {written[option]}")
        if not sides:
            raise ArgumentError(f'give a bound, such as above = "1 {unit}", or below')

        begin = written["from"]
        end = math.inf if written["to"] is None else written["to"]
        if duration < end < math.inf:
            raise ArgumentError(f"to = {end:g} s is after the end of a run at {duration:g} s")
        last = min(end, duration)
        if not 0 <= begin < last:
            raise ArgumentError(f"there is no time from {begin:g} s to {last:g} s")
        read = cls.read(" and ".join(sides), units, duration - begin)
        return {**read, "after": begin, "until": end, "bounds": ", ".join(bounds)}

    @property
    def words(self) -> str:
        """The requirement in words."""
        words = f"{self.written} {self.bounds}"
        if math.isfinite(self.until):
            return f"{words} from {self.after:g} s to {self.until:g} s"
        if self.after:
            return f"{words} from {self.after:g} s on"
        return words
