"""PID as people write it: one for each output, of the measured output alone, on any plant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import ArgumentError, GainError, array_text
from grosmc_mj.ground.fields import Is, checked
from grosmc_mj.theory.control.controller import (
    Controller,
    TaskNumbers,
    named_gains,
    noting_controller,
)
from grosmc_mj.theory.control.coordinates.base import OutputCoordinates
from grosmc_mj.theory.control.coordinates.state import StateCoordinates
from grosmc_mj.theory.control.design import linear_lqr, linearized_lqr
from grosmc_mj.theory.control.kinds.fl_pid import MOST_FREQUENCY
from grosmc_mj.theory.control.kinds.kind import OF_OUTPUTS, LawKind, Where
from grosmc_mj.theory.control.law import Law
from grosmc_mj.theory.control.law_number import LawNumber
from grosmc_mj.theory.control.memory import Memory, memory_of, vector
from grosmc_mj.theory.control.pid_tuning import (
    PidGains,
    Tuning,
    pid_loop,
    placed_gains,
    tuned_gains,
    without_fast_poles,
)
from grosmc_mj.theory.control.task import Limit, Task


@dataclass(frozen=True, eq=False, kw_only=True)
class PidNumbers(TaskNumbers):
    """Numbers of a PID of m outputs, each of which acts on the input of the same number.

    Attributes:
        kp: Gain of the error, in the unit of the input per unit of the output, (m,).
        ki: Gain of its integral, in that unit per second, (m,).
        kd: Gain of its rate, in that unit times seconds, (m,).
        filter: Time constant of the rate's filter [s]; 0 for none.
        setpoint_weight: Weight b of the setpoint in the proportional part.
        rate_setpoint_weight: Weight c of the setpoint in the rate.
        low: Least input, in its unit, (m,).
        high: Largest input, in its unit, (m,).
        tracking_time: Time constant of the anti-windup [s]; 0 to hold the integral instead.
    """

    kp: Array
    ki: Array
    kd: Array
    filter: float
    setpoint_weight: float
    rate_setpoint_weight: float
    low: Array
    high: Array
    tracking_time: float


@dataclass
class PidMemory(Memory):
    """Memory of a PID of m outputs, on n entries of z.

    Attributes:
        z: Error state at the last sample, in the units of the error coordinates, (n,).
        setpoint: Setpoint r at the last sample, in the units of the outputs, (m,).
        first_output: Output at the first sample, in its unit, (m,).
        integral: Integral part of the input at the next sample, in the units of the inputs, (m,).
        rate: Filtered rate of ``last``, in the units of the outputs per second, (m,).
        last: Weighted setpoint less output, c r - y, at the last sample, in the units of the
            outputs, (m,).
    """

    z: Array = vector("n")
    setpoint: Array = vector("m")
    first_output: Array = vector("m")
    integral: Array = vector("m")
    rate: Array = vector("m")
    last: Array = vector("m")


def _gain(meaning: str, search: tuple[float, float]) -> LawNumber:
    """Return the declaration of a gain, which may be negative."""
    return LawNumber(meaning=meaning, search=search, each="output")


@checked(eq=False)
class Pid(LawKind):
    """PID of each output, which acts on the input of the same number.

        u = u_e + kp (b (r - y_0) - (y - y_0)) + ki xi + kd d,    xi' = r - y,

    with the output y, its value y_0 at the first sample, its setpoint r, and the rate d of c r - y
    through a first-order filter: K. J. Astrom and T. Hagglund, "Advanced PID Control", 2006,
    sections 3.3 to 3.5. With b = c = 1 it is PID of the error r - y. The law sees no rate: d is
    the difference of two samples, filtered by backward Euler. Before the first sample r is y_0, so
    a reference that begins elsewhere is a step, with a kick of c kd (r - y_0) in the rate; an
    operating point has always been held. u_e is the operating point's input, 0 for a task without
    one. With several inputs there is an output for each.

    An input is cut off at its limit, by default those of the task. Meanwhile the integral holds if
    it would push further beyond or, with a tracking time T_t, is driven back by the excess over
    T_t.

    Its gains are given, or come from a frequency (all poles of the linearized loop there,
    ``placed_gains``), or from a settling time (``tuned_gains``). ``controls`` has the names of the
    error state's entries that are y; by default the outputs.
    """

    key = "pid"
    where = OF_OUTPUTS | {Where.UNDERACTUATED}
    follows_weights = False
    takes_limits = True
    ways = (("kp", "ki", "kd"), ("frequency",), ("tune",))

    kp: Annotated[ArrayLike, _gain("gain of the error", (1e-3, 1e4))] | None = None
    ki: Annotated[ArrayLike, _gain("gain of its integral", (1e-3, 1e4))] = 0.0
    kd: Annotated[ArrayLike, _gain("gain of its rate", (1e-4, 1e3))] = 0.0
    frequency: (
        Annotated[
            float,
            LawNumber(
                low=0,
                high=MOST_FREQUENCY,
                unit="rad/s",
                above=True,
                meaning="place of all poles, instead of gains",
                search=(0.3, 300),
            ),
        ]
        | None
    ) = None
    tune: Annotated[Tuning, Is(Tuning, "a Tuning, such as Tuning(settles_within=2.0)")] | None = (
        None
    )
    filter: Annotated[
        float,
        LawNumber(
            low=0,
            unit="s",
            meaning="time constant of the rate's filter; 0 for none",
            search=(1e-4, 0.1),
        ),
    ] = 0.0
    setpoint_weight: Annotated[
        float,
        LawNumber(
            low=0,
            meaning="weight b of the setpoint in the proportional part",
            search=(0, 1),
            log=False,
        ),
    ] = 1.0
    rate_setpoint_weight: Annotated[
        float,
        LawNumber(
            low=0,
            meaning="weight c of the setpoint in the rate",
            search=(0, 1),
            log=False,
        ),
    ] = 1.0
    limit: Limit | None = None
    tracking_time: Annotated[
        float,
        LawNumber(
            low=0,
            unit="s",
            meaning="time constant T_t of the anti-windup; 0 to hold the integral instead",
            search=(1e-2, 10),
        ),
    ] = 0.0
    controls: Sequence[str] = ()

    @classmethod
    def holds_states(cls, where: Where, *, follows: bool) -> bool:
        """Whether it holds the operating point, where it knows the input: it follows no outputs."""
        return where in (Where.AT_REST, Where.UNDERACTUATED) and not follows

    def design(self, task: Task) -> Controller:
        """Return the law for a task.

        Raises:
            ArgumentError: If not exactly one way to the gains is given.
            GainError: If the outputs are not as many as the inputs, or no gains are found.
        """
        error = task.error
        rows = _controlled(error, self.controls)
        gains, neglected = self._gains(task, rows)

        low, high = task.input_limits
        if self.limit is not None:
            low, high = -self.limit, self.limit
        m = error.inputs
        of_outputs = isinstance(error, OutputCoordinates)
        like = linearized_lqr(task) if of_outputs else linear_lqr(task)
        numbers = PidNumbers(
            plant=like.parameters.plant,
            reference=like.parameters.reference,
            kp=gains.kp,
            ki=gains.ki,
            kd=gains.kd,
            filter=self.filter,
            setpoint_weight=self.setpoint_weight,
            rate_setpoint_weight=self.rate_setpoint_weight,
            low=np.broadcast_to(low, m).astype(float),
            high=np.broadcast_to(high, m).astype(float),
            tracking_time=self.tracking_time,
        )
        controller = noting_controller(
            "pid",
            _law(error, tuple(rows)),
            like,
            numbers,
            memory_of(PidMemory, m=m, n=error.size),
            source="Astrom and Hagglund 2006",
            gains=_gains_to_show(gains),
        )
        return replace(controller, design=replace(controller.designed, neglected=neglected))

    def _gains(self, task: Task, rows: list[int]) -> tuple[PidGains, tuple[complex, ...]]:
        """Return the gains, given or computed, and the poles that are left out of computing them.

        They are computed from a frequency or a settling time.
        """
        ways = [way[0] for way in self.ways]
        given = [name for name in ways if getattr(self, name) is not None]
        if len(given) != 1:
            beside = f", not {' and '.join(given)}" if given else ""
            raise ArgumentError(
                "pid needs kp (with ki and kd), or frequency, or "
                f'tune = {{ settles_within = "2 s" }}{beside}'
            )

        if self.kp is not None:
            m = task.error.inputs
            given_gains = PidGains(
                _of_each_output("kp", self.kp, m),
                _of_each_output("ki", self.ki, m),
                _of_each_output("kd", self.kd, m),
            )
            return given_gains, ()
        if np.any(self.ki) or np.any(self.kd):
            raise ArgumentError(f"pid: ki and kd belong to kp, {given[0]} computes them")

        loop = pid_loop(task, rows, self.filter)
        if self.tune is not None:
            slow = without_fast_poles(loop, self.tune.bandwidth)
            return tuned_gains(loop, self.tune), slow.neglected
        assert self.frequency is not None
        slow = without_fast_poles(loop, self.frequency)
        placed = placed_gains(slow, self.frequency)
        if placed is None:
            raise GainError(
                f"pid: frequency places the poles of a plant of order one or two for each output; "
                f"{task.plant.system.name} has more: give kp, ki and kd, or tune"
            )
        return placed, slow.neglected


def _gains_to_show(gains: PidGains) -> dict[str, float]:
    """Gains by their names, without a number where there is one output."""
    shown = named_gains(kp=gains.kp[None], ki=gains.ki[None], kd=gains.kd[None])
    if len(gains.kp) > 1:
        return shown
    return {name.rstrip("1"): value for name, value in shown.items()}


def _controlled(error: OutputCoordinates | StateCoordinates, names: Sequence[str]) -> list[int]:
    """Entries of z that the law controls, one for each input."""
    rows = list(error.output_rows)
    if names:
        for name in names:
            require_known("name", name, error.names, "controls: ")
        rows = [error.names.index(name) for name in names]
    if len(rows) != error.inputs:
        raise GainError(
            f"pid: {len(rows)} outputs and {error.inputs} inputs: each input controls one; name "
            f"them with controls, of {', '.join(error.names)}"
        )
    return rows


def _of_each_output(name: str, value: Any, m: int) -> Array:
    """Gain of each output, (m,)."""
    gain = np.asarray(value, float)
    if gain.shape not in ((), (m,)):
        raise ArgumentError(f"pid: {name} = {array_text(gain)} must be a number or {m} numbers")
    return np.broadcast_to(gain, m).copy()


# A law of the same coordinates is one function, which is compiled once.
@cache
def _law(error: OutputCoordinates | StateCoordinates, rows: tuple[int, ...]) -> Law:
    """The law of these entries of z."""
    error_state = error.state
    setpoints = _setpoints(error, rows)
    apply, _ = error.input_maps(linearizing=False)
    controlled = np.array(rows)
    sign = float(error.sign)
    # Before t = 0 a reference is where the output is; an operating point has always been held.
    steps = isinstance(error, OutputCoordinates)

    def law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        z = memory.z
        v = memory.v
        r = memory.setpoint
        error_state(t, x, p, z)
        setpoints(t, p, r)

        for i in range(len(v)):
            e = -sign * z[controlled[i]]
            y = r[i] - e
            weighted = p.rate_setpoint_weight * r[i] - y
            if not memory.begun:
                r_before = y if steps else r[i]
                memory.first_output[i] = y
                memory.last[i] = p.rate_setpoint_weight * r_before - y
            y_0 = memory.first_output[i]

            quotient = (weighted - memory.last[i]) / p.period
            share = p.period / (p.filter + p.period)
            memory.rate[i] += share * (quotient - memory.rate[i])
            memory.last[i] = weighted

            proportional = p.kp[i] * (p.setpoint_weight * (r[i] - y_0) - (y - y_0))
            v[i] = proportional + memory.integral[i] + p.kd[i] * memory.rate[i]
        apply(t, x, v, memory, p, u)

        # The limits, and an integral that does not wind up beyond them.
        for i in range(len(u)):
            excess = u[i] - min(p.high[i], max(p.low[i], u[i]))
            u[i] -= excess
            growth = p.ki[i] * -sign * z[controlled[i]]
            if p.tracking_time > 0:
                growth -= excess / p.tracking_time
            elif growth * excess > 0:
                growth = 0.0
            memory.integral[i] += p.period * growth

    return law


def _setpoints(error: OutputCoordinates | StateCoordinates, rows: tuple[int, ...]) -> Any:
    """Jitable (t, p, r): write the reference of each controlled entry of z, (m,)."""
    if not isinstance(error, OutputCoordinates):
        states = np.array(rows)

        def held(t: float, p: Any, r: Any) -> None:
            for i in range(len(r)):
                r[i] = p.reference.x[states[i]]

        return jitable(held)

    places = np.array(error.lower)[list(rows)]
    reference = error.reference

    def moving(t: float, p: Any, r: Any) -> None:
        y = reference(t, p.reference)
        for i in range(len(r)):
            r[i] = y[places[i]]

    return jitable(moving)
