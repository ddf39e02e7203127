"""From a log to the parameters of its machine: logs, fits, what they do not show, the case file."""

from __future__ import annotations

import contextlib
import errno
import json
import math
import re
import tomllib
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import assert_one_line, run
from mcap_ros2.writer import Writer

import grosmc_mj as gm
from benchmarks import coverage
from benchmarks import logs as logs_made
from grosmc_mj import cli
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.reading import parse_case_file
from grosmc_mj.experiments.logs.log import Log, held, join_logs
from grosmc_mj.experiments.logs.read import read_log
from grosmc_mj.experiments.logs.table import LogTable
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, ImplausibleWarning
from grosmc_mj.identify import hidden
from grosmc_mj.identify.case_file import write_case
from grosmc_mj.identify.compare import PredictionError, best_model, prediction_errors
from grosmc_mj.identify.fit import Fit, fit, slip
from grosmc_mj.identify.hidden import HiddenParameter, hidden_parameter
from grosmc_mj.identify.model import LogModel, models_of
from grosmc_mj.identify.parameters import parameters_of
from grosmc_mj.identify.quality import Quality, quality, residuals
from grosmc_mj.identify.replay import Predictor
from grosmc_mj.identify.report import _prediction_words, _values_row
from grosmc_mj.identify.residual import Residual, rescaled, residual_of
from grosmc_mj.identify.slips import likely_slip, unexplained_share
from grosmc_mj.simulation.loop import Computing, Loop, Sensor
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.specification import specification_of
from grosmc_mj.theory.plants import find_system

SERVO = find_system("servo")
HOW: dict[str, Any] = {"horizon": 1.0, "timestep": 1e-3}
HEADER = "time [s],current [A],rotor angle [rad]"
ARM_LOG = Path(gm.__file__).parent / "experiments/cases/logs/arm.csv"


# A machine of the coverage benchmark is integrated in steps of 50 us.
@cache
def short(number: int, seconds: float = 4.0) -> tuple[Array, Log]:
    """The first seconds of a machine of the coverage benchmark."""
    true, log = coverage.machine(number)
    samples = round(seconds / coverage.SAMPLING)
    outputs = {name: values[:samples] for name, values in log.states.items()}
    part = Log(
        name=log.name,
        time=log.time[:samples],
        inputs=log.inputs[:samples],
        states=outputs,
        pieces=[slice(0, samples)],
    )
    return true, part


@pytest.fixture(scope="module")
def log() -> Log:
    return short(0)[1]


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    return coverage.case(tmp_path_factory.mktemp("case"))


def csv(path: Path, rows: Array, header: str = HEADER) -> Path:
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def columns(log: Log) -> Array:
    return np.column_stack([log.time, log.inputs, log.states["rotor angle"]])


def test_a_log_is_read_as_it_was_written(tmp_path: Path, log: Log) -> None:
    read = read_log(csv(tmp_path / "log.csv", columns(log)), SERVO, None)
    assert np.allclose(read.time, log.time, atol=1e-9)
    assert np.allclose(read.inputs, log.inputs)
    assert np.allclose(read.states["rotor angle"], log.states["rotor angle"], atol=1e-7)


def test_a_log_is_read_in_the_units_of_its_headers(tmp_path: Path, log: Log) -> None:
    rows = columns(log)
    rows[:, 0] *= 1e3
    rows[:, 2] = np.degrees(rows[:, 2])
    path = csv(tmp_path / "log.csv", rows, "t [ms],i,Rotor_Angle (deg)")

    read = read_log(path, SERVO, None)
    assert np.allclose(read.time, log.time, atol=1e-9)
    assert np.allclose(read.inputs, log.inputs)
    assert np.allclose(read.states["rotor angle"], log.states["rotor angle"], atol=1e-7)


def test_a_gap_ends_a_piece(tmp_path: Path, log: Log) -> None:
    rows = np.delete(columns(log), slice(500, 700), axis=0)
    read = read_log(csv(tmp_path / "gap.csv", rows), SERVO, None)
    assert read.pieces == [slice(0, 500), slice(500, 1800)]


def test_parts_of_a_log_meet_at_their_share_of_its_time(tmp_path: Path, log: Log) -> None:
    rows = np.delete(columns(log), slice(500, 700), axis=0)
    whole = read_log(csv(tmp_path / "gap.csv", rows), SERVO, None)
    fitted = whole.between(0, 0.7)
    held_out = whole.between(0.7, 1)
    border = held_out.pieces[0].start
    assert fitted.pieces[-1].stop == border
    assert whole.time[border] == pytest.approx(0.7 * whole.time[-1], abs=0.002)


def read_counts(folder: Path, log: Log) -> Log:
    """Read a log without times, its angle as counts, by the table of a case."""
    rows = columns(log)[:, 1:]
    rows[:, 1] = 100 - rows[:, 1] / 0.01
    path = csv(folder / "log.csv", rows, "command,counts")
    counts = {"column": "counts", "sign": -1, "scale": 0.01, "offset": 100.0}
    named = {"current": {"column": "command"}, "rotor angle": counts}
    table = LogTable.model_validate({"sampling": "2 ms", "columns": named})
    return read_log(path, SERVO, table)


def test_a_case_says_the_sampling_of_a_log(tmp_path: Path, log: Log) -> None:
    assert np.allclose(read_counts(tmp_path, log).time, log.time)


def test_a_case_converts_the_columns_of_a_log(tmp_path: Path, log: Log) -> None:
    read = read_counts(tmp_path, log)
    assert np.allclose(read.states["rotor angle"], log.states["rotor angle"], atol=1e-6)


def write_bag(path: Path, log: Log) -> None:
    """An MCAP file whose angle comes at each sample, and whose current when it changes."""
    begin = 1_760_000_000_000_000_000
    with path.open("wb") as file:
        writer = Writer(file)
        joints = writer.register_msgdef("sensor_msgs/msg/JointState", "float64[] position\n")
        number = writer.register_msgdef("std_msgs/msg/Float64", "float64 data\n")
        for k, (time, u, angle) in enumerate(columns(log)):
            stamp = begin + round(1e9 * time)
            if k % 60 == 0:
                writer.write_message("/current", number, {"data": u}, log_time=stamp)
            writer.write_message("/joints", joints, {"position": [angle]}, log_time=stamp)
        writer.finish()


def test_messages_of_several_topics_are_brought_to_the_instants_of_the_state(
    tmp_path: Path, log: Log
) -> None:
    write_bag(tmp_path / "bag.mcap", log)
    named = {
        "current": {"column": "/current.data"},
        "rotor angle": {"column": "/joints.position[0]"},
    }
    table = LogTable.model_validate({"columns": named})

    read = read_log(tmp_path / "bag.mcap", SERVO, table)
    assert np.allclose(read.time, log.time, atol=1e-9)
    assert np.array_equal(read.inputs, log.inputs)
    assert np.array_equal(read.states["rotor angle"], log.states["rotor angle"])


@pytest.fixture(scope="module")
def two_logs() -> tuple[Log, Log]:
    return short(0, 1.0)[1], short(1, 2.0)[1]


def test_joined_logs_keep_their_samples(two_logs: tuple[Log, Log]) -> None:
    both = join_logs(two_logs)
    assert both.pieces == [slice(0, 500), slice(501, 1501)]
    assert (np.diff(both.time) > 0).all()
    for piece, log in zip(both.pieces, two_logs, strict=True):
        assert np.array_equal(both.inputs[piece], log.inputs)
        assert np.array_equal(both.states["rotor angle"][piece], log.states["rotor angle"])


def test_joined_logs_have_the_noise_of_their_sensor(two_logs: tuple[Log, Log]) -> None:
    assert join_logs(two_logs).noise("rotor angle") == pytest.approx(coverage.NOISE, rel=0.1)


def test_a_late_input_of_a_joined_log_is_its_own_first_one(two_logs: tuple[Log, Log]) -> None:
    both = join_logs(two_logs)
    grid = both.time[501] + np.array([0.0, 1e-3])
    late = held(both.time, both.inputs, 5e-3, grid)
    assert late[0] == pytest.approx(two_logs[1].inputs[0])


def test_logs_of_different_states_are_not_joined(two_logs: tuple[Log, Log]) -> None:
    first, second = two_logs
    speed = replace(second, states={"rotor speed": second.states["rotor angle"]})
    with pytest.raises(ArgumentError, match="several logs must measure the same states"):
        join_logs([first, speed])


Change = Callable[[Array], Array]


def changed(where: Any, value: Callable[[Array], Any]) -> Change:
    """A change of some entries of a log's rows."""

    def change(rows: Array) -> Array:
        rows[where] = value(rows)
        return rows

    return change


def saturated(rows: Array) -> Array:
    return np.minimum(np.sin(np.linspace(0, 40, len(rows)) ** 1.5) + 0.8, 0.6)


CURRENT = (slice(None), 1)
WRONG_ROWS: list[tuple[Change, str]] = [
    (lambda rows: rows[:10], "has 10 rows of numbers; 50 or more are needed"),
    (changed((300, 0), lambda rows: rows[299, 0]), "the time does not rise in line 302"),
    (changed(CURRENT, lambda _: 0.3), "the input is 0.3 A all the time"),
    (changed((100, 2), lambda _: np.nan), "is no number in line 102, 'nan': fill or cut it"),
    (changed((100, 2), lambda _: 1e200), "is no number in line 102, '1e+200': fill or cut it"),
    (changed((100, 0), lambda _: np.nan), "time [s] is no number in line 102, 'nan'"),
    (changed(CURRENT, saturated), "it saturates"),
]
WRONG_HEADERS = [
    ("time [s],volts,rotor angle", "no column of the input 'current'"),
    ("time [s],current,x", "no column of a state"),
    ("a,current,rotor angle", "no column of the time"),
    ("time [s],current [A],rotor angle [kg]", "cannot be converted to rad"),
    ("time [kg],current [A],rotor angle", 'time [kg]: "1 kg" cannot be converted to s'),
    ("time [s],current [A],Current", "current [A] and Current are both current"),
    ("0,0,0", "has no header of two columns or more"),
    ("time [s]", "has no header of two columns or more"),
]


@pytest.mark.parametrize(("change", "words"), WRONG_ROWS)
def test_wrong_rows_of_a_log_are_named(
    tmp_path: Path, log: Log, change: Change, words: str
) -> None:
    path = csv(tmp_path / "log.csv", change(columns(log)))
    with pytest.raises(ArgumentError, match=rf"log\.csv.*{re.escape(words)}"):
        read_log(path, SERVO, None)


@pytest.mark.parametrize(("header", "words"), WRONG_HEADERS)
def test_a_wrong_header_of_a_log_is_named(
    tmp_path: Path, log: Log, header: str, words: str
) -> None:
    path = csv(tmp_path / "log.csv", columns(log), header)
    with pytest.raises(ArgumentError, match=rf"log\.csv.*{re.escape(words)}"):
        read_log(path, SERVO, None)


def test_a_log_of_the_case_s_plant_matches(log: Log, experiment: Experiment) -> None:
    predictor = Predictor.of(log, **HOW)
    model = LogModel(experiment.plant("physics"))
    assert likely_slip(predictor, model, unexplained_share(predictor, model)) == ""


@pytest.mark.parametrize(
    ("current", "angle", "words"),
    [
        (-1, 1, "rotor angle seems to have the other sign"),
        (1, 180 / np.pi, "rotor angle seems to be in degrees"),
        (1, 1e3, "rotor angle seems to be in thousandths"),
    ],
)
def test_another_sign_or_unit_of_a_column_is_noticed(
    log: Log, experiment: Experiment, current: float, angle: float, words: str
) -> None:
    outputs = {"rotor angle": angle * log.states["rotor angle"]}
    slipped = replace(log, inputs=current * log.inputs, states=outputs)
    predictor = Predictor.of(slipped, **HOW)
    model = LogModel(experiment.plant("physics"))
    # No parameter of the case's ranges mends a slip.
    line = likely_slip(predictor, model, unexplained_share(predictor, model))
    assert line.startswith(words)


def test_a_held_input_is_late_by_any_delay_without_jumps() -> None:
    time = np.arange(5) * 0.1
    values = np.array([[0.0], [1.0], [1.0], [3.0], [0.0]])
    grid = np.arange(9) * 0.05
    punctual = held(time, values, 0.0, grid)[:, 0]
    assert punctual.tolist() == pytest.approx([0, 0, 1, 1, 1, 1, 3, 3])

    late = held(time, values, 0.02, grid)[:, 0]
    assert late.tolist() == pytest.approx([0, 0, 0.6, 1, 1, 1, 0.4 * 1 + 0.6 * 3, 3])
    later = held(time, values, 0.02 + 1e-7, grid)[:, 0]
    assert np.abs(later - late).max() < 1e-5


def test_a_late_sensor_shows_what_the_state_was_before(experiment: Experiment) -> None:
    """A ramp of 1 rad/s that a sensor shows 20 ms late is 20 mrad lower at each sample."""
    time = np.arange(100) * 0.01
    late = Log(
        name="late",
        time=time,
        inputs=np.zeros((100, 1)),
        states={"rotor angle": time - 0.02},
        pieces=[slice(0, 100)],
    )
    predictor = Predictor.of(late, horizon=10.0, timestep=1e-3)
    instants = np.arange(1001) * 1e-3
    ramp = np.column_stack([instants, np.ones_like(instants)])
    loop = Loop(sensors=(Sensor("rotor angle", delay=0.02),))
    model = LogModel(experiment.plant("physics"), loop)

    (errors,) = predictor.errors([ramp], model)["rotor angle"]
    # Before the window began nothing is predicted.
    assert errors[2:] == pytest.approx(np.zeros(98), abs=1e-12)


def test_fitted_starts_take_their_degrees_of_freedom() -> None:
    """Of three windows two starts each are fitted: three numbers for each measured state."""
    parts = {"angle": [np.full(4, 2.0)] * 3, "rate": [np.full(4, 6.0)] * 3}
    residual: Any = SimpleNamespace(starts=np.zeros((3, 2)), errors=lambda _: parts, huber=False)
    scales = rescaled(residual, np.zeros(6))
    assert scales == pytest.approx({"angle": 2 * math.sqrt(12 / 9), "rate": 6 * math.sqrt(12 / 9)})


@pytest.fixture(scope="module")
def found(log: Log, experiment: Experiment) -> Fit:
    """The fit of a machine to the first 70 % of its log."""
    parameters = parameters_of(experiment, coverage.NAMES)
    return fit(parameters, Predictor.of(log.between(0, 0.7), **HOW), experiment.plant("physics"))


def test_a_fit_finds_the_machine(found: Fit) -> None:
    true, _ = short(0)
    assert found.fitted.all()
    assert (np.abs(found.values - true) < 2 * found.half).all()
    assert found.scales["rotor angle"] == pytest.approx(coverage.NOISE, rel=0.05)


def test_a_fit_predicts_what_was_held_out(found: Fit, log: Log, experiment: Experiment) -> None:
    plant = experiment.plant("physics")
    held_out = Predictor.of(log.between(0.7, 1), **HOW)
    (row,) = quality(residuals(found, held_out, plant), held_out.log, plant.system)
    assert row.rms == pytest.approx(coverage.NOISE, rel=0.1)
    assert row.white


def test_an_identified_case_has_the_distribution_of_its_fit(found: Fit, tmp_path: Path) -> None:
    path = tmp_path / "identified.toml"
    write_case(found, "a log", path)
    family = Campaign.of(specification_of(str(path), runs=4)).family
    assert family.nominal == pytest.approx(found.values)
    assert family.correlation == pytest.approx(found.correlation, abs=1e-9)

    # One standard deviation above the mean has this probability below it.
    one_deviation = 0.8413447460685429
    (upper,) = family.values(np.array([[one_deviation, 0.5, 0.5]]))
    assert upper[0] - found.values[0] == pytest.approx(found.covariance[0, 0] ** 0.5, rel=1e-3)


def test_a_number_that_was_held_stays_as_uncertain_as_declared(found: Fit, tmp_path: Path) -> None:
    """The log showed mass and delay, and not the damping."""
    shown = np.array([0, 2])
    held = replace(
        found,
        fitted=np.array([True, False, True]),
        values=np.where([True, False, True], found.values, found.parameters.nominal),
        covariance=found.covariance[shown][:, shown],
        half=found.half[shown],
    )
    path = tmp_path / "identified.toml"
    write_case(held, "a log", path)

    family = Campaign.of(specification_of(str(path), runs=4)).family
    damping = next(number for number in family.quantities if number.name == "shaft damping")
    assert len(family.quantities) == 3
    assert damping.distribution.support == (0.0005, 0.1)
    assert damping.nominal == found.parameters.nominal[1]


PUSHED_CASE = """
title = "A servo that is pushed"
plant = { system = "servo" }
run = { duration = "5 s" }
controller = [{ law = "lqr" }]
[[disturbance]]
body = "rotor"
torque = ["0N*m", "-0.2N*m", "0 N m"]
label = "push"
[[disturbance]]
input = "current"
amplitude = "0.1A"
label = "offset"
[[uncertain]]
number = "disturbance.push.scale"
name = "push amplitude"
values = [0, 3]
nominal = 0
[[uncertain]]
number = "disturbance.offset.scale"
name = "offset amplitude"
values = [0, 3]
nominal = 0
"""


def test_a_fitted_disturbance_is_written_from_its_number_in_any_spelling(tmp_path: Path) -> None:
    """Half as large again, and twice; a number needs no blank before its unit."""
    path = tmp_path / "pushed.toml"
    path.write_text(PUSHED_CASE, encoding="utf-8")
    parameters = parameters_of(Experiment.load(path), ())
    pushed = Fit(
        parameters=parameters,
        fitted=np.ones(2, bool),
        values=np.array([1.5, 2.0]),
        covariance=np.diag([0.01, 0.01]),
        half=np.array([0.2, 0.2]),
        unseen=[],
        scales={},
        timesteps=(1e-3, 5e-4),
        shift=np.zeros(2),
        left=np.zeros(2),
        converged=True,
        finished=True,
    )
    write_case(pushed, "a log", tmp_path / "identified.toml")
    push, offset = Experiment.load(tmp_path / "identified.toml").disturbances
    assert push.amplitudes == pytest.approx([0, 0, 0, 0, -0.3, 0])
    assert offset.amplitudes == pytest.approx([0.2])


@pytest.mark.parametrize(
    ("timesteps", "shift", "left", "words"),
    [
        ((1e-3, 5e-4), 0.0, 1e-5, ""),
        ((1e-3, 1e-3), 0.0, 1e-5, ""),
        ((1e-3, 1e-3), 0.0, 0.01, "fitted at a timestep of 1 ms: a shorter one may change 0.5 of"),
        ((1e-3, 2.5e-4), 0.02, 1e-5, "at 1 ms rotor mass scale would be 0.02 lower, 1 of its "),
        ((1e-3, 2.5e-4), -0.02, 0.01, "would be 0.02 higher, 1 of its interval's half width; a "),
    ],
)
def test_the_effect_of_a_timestep_is_told_beside_the_interval(
    found: Fit, timesteps: tuple[float, float], shift: float, left: float, words: str
) -> None:
    """Of the first of three parameters, whose half width is 0.02."""
    changed = replace(
        found,
        half=np.array([0.02, 1.0, 1.0]),
        timesteps=timesteps,
        shift=np.array([shift, 0.0, 0.0]),
        left=np.array([left, 0.0, 0.0]),
    )
    assert words in changed.timestep_words
    assert bool(changed.timestep_words) is bool(words)


@pytest.mark.parametrize(
    ("least", "most", "value", "half", "at_end"),
    [
        # A wide range says nothing about how near its end is.
        (0.01, 100.0, 0.08, 1e-3, False),
        (0.01, 100.0, 0.0101, 1e-2, True),
        (0.0, 0.5, 0.0, 1e-2, True),
        (0.0, 0.5, 0.5, 1e-9, True),
        (0.0, 0.5, 0.4999, 1e-5, False),
    ],
)
def test_a_value_is_at_the_end_of_its_range_by_its_interval(
    least: float, most: float, value: float, half: float, at_end: bool
) -> None:
    support = SimpleNamespace(support=(least, most))
    quantity: Any = SimpleNamespace(name="damping", unit="", nominal=0.1, distribution=support)
    note = _values_row(quantity, value, half)[-1]
    assert note.startswith("at the end of its range") is at_end


def test_an_interval_is_the_value_and_its_half_width_on_either_side_in_four_digits() -> None:
    support = SimpleNamespace(support=(0.5, 30.0))
    quantity: Any = SimpleNamespace(name="m", unit="kg", nominal=1.23456, distribution=support)
    assert _values_row(quantity, 2.345678, 0.0123456) == (
        *("m", "2.346", "2.333 to 2.358", "kg", "1.235", ""),
    )
    assert _values_row(quantity, 2.345678, None)[1:3] == ("2.346", "-")


def test_the_quality_of_a_fit_is_the_residual_beside_the_motion_of_its_windows() -> None:
    """Residuals of 0.5 rad in two windows of a ramp of an encoder with steps of 0.02 rad."""
    time = 0.01 * np.arange(400)
    angle = 0.02 * np.arange(400)
    log = Log("log", time, time[:, None], {"rotor angle": angle}, [slice(0, 400)])
    residual = 0.5 * (-1.0) ** np.arange(100)
    windows = [(slice(0, 100), residual), (slice(300, 400), residual)]
    (row,) = quality({"rotor angle": windows}, log, find_system("servo"))
    spread = np.std([*angle[:100], *angle[300:]])
    assert (row.rms, row.step) == pytest.approx((0.5, 0.02))
    assert row.fit == pytest.approx(1 - 0.5 / spread)
    assert row.moves
    assert not row.diverges


def test_the_worst_prediction_is_that_of_the_most_steps_of_its_sensor() -> None:
    """0.03 rad are 15 steps, 0.4 rad/s are 8."""
    rows = [
        Quality("angle", "rad", 0.0, 1.0, 2e-3, moves=True, diverges=False, white=True),
        Quality("rate", "rad/s", 0.0, 1.0, 50e-3, moves=True, diverges=False, white=True),
    ]
    predicted = [
        PredictionError("physics", "angle", "rad", [0.1, 2.0], [4e-3, 30e-3]),
        PredictionError("physics", "rate", "rad/s", [0.1, 2.0], [0.3, 0.4]),
    ]
    assert _prediction_words(rows, predicted) == (
        "angle of the held-out part predicted to 4.0e-3 rad after 0.1 s and 0.03 rad after 2 s "
        "(2 and 15 steps of its sensor)"
    )


def with_gaps(log: Log, every: float) -> Log:
    """A log whose samples are lost now and then."""
    samples = round(every / log.sampling)
    starts = range(0, len(log.time), samples)
    pieces = [slice(start, start + samples - 5) for start in starts]
    return replace(log, pieces=pieces)


def test_gaps_that_cut_predictions_short_are_told(log: Log) -> None:
    assert Predictor.leading(log, 1.0, 1e-3).short_words(1.0) == ""
    words = Predictor.leading(with_gaps(log, 0.4), 1.0, 1e-3).short_words(1.0)
    assert words.startswith("the log has 9 gaps or masked parts: predictions last 0.29 s in the ")
    assert words.endswith("at most, not --horizon 1 s")


MASS = '{ number = "edit.rotor.mass_scale", values = [0.3, 4] }'
ARMATURE = '{ number = "edit.shaft.armature", values = [0, 0.1] }'
DAMPING = '{ number = "edit.shaft.damping", values = [0.001, 0.1] }'
FRICTION = '{ number = "edit.shaft.friction", values = [0, 0.05] }'
LATE_INPUT = '{ number = "actuator.current.delay", values = ["0 ms", "10 ms"] }'
LATE_SENSOR = '{ number = "sensor.rotor angle.delay", values = ["0 ms", "10 ms"] }'
SCALE = '{ number = "sensor.rotor angle.scale", values = [0.5, 2] }'
BIAS = '{ number = "sensor.rotor angle.bias", values = ["-1 rad", "1 rad"] }'
OFFSET = (
    '{ number = "disturbance.offset.scale", values = [-0.5, 0.5], name = "offset amplitude", '
    "nominal = 0 }"
)
SERVO_CASE = """
title = "A servo to identify"
plant = {{ system = "servo" }}
run = {{ duration = "5 s" }}
controller = [{{ law = "lqr" }}, {{ law = "grosmc" }}]
computing = {{ delay = "1 ms" }}
requirement = [{{ settles_within = "6 s", of = ["grosmc"] }}]
uncertain = [{uncertain}]
sensor = [{{ of = "rotor angle", delay = "2 ms" }}]
actuator = [{{ of = "current", delay = "2 ms" }}]
disturbance = [{{ input = "current", amplitude = "1 A", label = "offset" }}]
"""


def weak_of(folder: Path, log: Log, uncertain: list[str]) -> HiddenParameter | None:
    """What a log of current and angle does not show of the numbers of a case."""
    path = folder / "case.toml"
    text = SERVO_CASE.format(uncertain=", ".join(uncertain))
    path.write_text(text, encoding="utf-8")
    case = Experiment.of_file(parse_case_file(text, path), path).checked()
    parameters = parameters_of(case, ())

    free = np.ones(len(parameters.names), bool)
    predictor = Predictor.of(log, **HOW)
    scales = {"rotor angle": coverage.NOISE}
    residual = residual_of(
        parameters, free, predictor, case.plant("physics"), scales, parameters.nominal
    )
    values = parameters.first
    return hidden_parameter(parameters, free, residual.jacobian(residual.point(values)), values)


@pytest.mark.parametrize(
    ("uncertain", "hidden", "words"),
    [
        # The inertia is that of the mass, 0.0577 kg m^2, plus the armature.
        (
            [MASS, DAMPING, ARMATURE],
            {"rotor mass scale", "shaft armature"},
            "only shaft armature + 0.0577 times rotor mass scale is visible",
        ),
        (
            [MASS, DAMPING, SCALE],
            {"rotor mass scale", "shaft damping", "rotor angle scale"},
            "a change of all of them is not visible",
        ),
        ([MASS, BIAS, DAMPING], {"rotor angle bias"}, "rotor angle bias is not visible"),
        (
            [MASS, LATE_INPUT, LATE_SENSOR],
            {"current delay", "rotor angle delay"},
            "only their sum is visible",
        ),
    ],
)
def test_parameters_that_a_log_does_not_show_are_named(
    tmp_path: Path, log: Log, uncertain: list[str], hidden: set[str], words: str
) -> None:
    weak = weak_of(tmp_path, log, uncertain)
    assert weak is not None
    assert {weak.held, *weak.others} == hidden
    assert words in weak.words


def test_a_log_shows_damping_and_friction(tmp_path: Path, log: Log) -> None:
    assert weak_of(tmp_path, log, [DAMPING, FRICTION]) is None


def test_of_friction_and_offset_a_motion_one_way_shows_the_difference(tmp_path: Path) -> None:
    """Torque of an offset of the current less friction: it is 0.667 N m for an ampere."""
    random = np.random.default_rng(3)
    u = np.repeat(random.uniform(0.3, 0.8, 34), 60)[:2000]
    angles = coverage.simulated_angles(np.pad(u, (0, 3000)), 0.0577, 0.0088, late=0)[:2000]
    time = np.arange(2000) * coverage.SAMPLING
    log = Log("one way", time, u[:, None], {"rotor angle": angles}, [slice(0, 2000)])
    weak = weak_of(tmp_path, log, [MASS, FRICTION, OFFSET])
    assert weak is not None
    assert "only shaft friction - 0.667 times offset amplitude is visible" in weak.words


def test_changes_that_cancel_each_other_are_told_for_one_unit_of_the_first() -> None:
    members = [
        hidden._Member("mass", "kg", 2.0, 0.4),
        hidden._Member("friction", "N m", 0.5, -0.1),
        hidden._Member("scale", "1", 1.0, 0.05),
    ]
    assert hidden._changes(members) == "mass by 1 kg, friction by -0.25 N m, scale by 0.125"


# Jacobians of two parameters, whose null direction is (1, change).
@pytest.mark.parametrize(
    ("values", "change", "words"),
    [
        ((0.5, 1.0), 2.0, "only their ratio is visible"),
        ((0.5, 1.0), -2.0, "only their product is visible"),
        ((0.5, 2.0), 1.0, "only their difference is visible"),
        ((0.5, 2.0), -1.0, "only their sum is visible"),
        ((0.0, 2.0), 1.0, "only their difference is visible"),
        ((0.0, 0.0), -1.0, "only their sum is visible"),
        ((0.5, 2.0), 0.5, "only {0} - 2 times {1} is visible"),
        ((0.5, 2.0), -0.4, "only {0} + 2.5 times {1} is visible"),
    ],
)
def test_the_visible_combination_is_what_the_null_direction_leaves_as_it_is(
    values: tuple[float, float], change: float, words: str
) -> None:
    """Both in one unit, of equal size and range."""
    names = ["shaft friction", "rail friction"]
    quantities = [SimpleNamespace(name=name, unit="N m") for name in names]
    parameters: Any = SimpleNamespace(
        names=names,
        quantities=quantities,
        bounds=(np.zeros(2), np.full(2, 4.0)),
        scales=np.ones(2),
    )
    random = np.random.default_rng(0)
    column = 100 * random.standard_normal(50)
    start = random.standard_normal(50)
    jacobian = np.column_stack([change * column, -column, start])
    weak = hidden_parameter(parameters, np.ones(2, bool), jacobian, np.array(values))
    assert weak is not None
    # The one that changes more is held, and named first.
    assert words.format(*names) in weak.words


def test_the_rung_that_made_a_log_explains_it_best(experiment: Experiment) -> None:
    true, log = short(1)
    parameters = parameters_of(experiment, coverage.NAMES)
    plant = parameters.model(true, experiment.plant("physics")).plant
    late = Loop(computing=Computing(delay=round(float(true[2]), 3)))
    rungs = {**models_of(experiment), "ideal": LogModel(plant), "as it is": LogModel(plant, late)}
    assert {"corrected", "physics", "loop", "machine"} < set(rungs)
    rows, _ = prediction_errors(rungs, log, 1.0, 1e-3)
    assert best_model(rows) == {"rotor angle": "as it is"}


def error_row(rung: str, *rms: float) -> PredictionError:
    """Prediction errors of a rung after 0.1 s, 0.5 s and 1 s."""
    return PredictionError(rung, "rotor angle", "rad", (0.1, 0.5, 1.0), rms)


@pytest.mark.parametrize(
    ("rows", "best"),
    [
        ([error_row("physics", 1.0, 5.0, 9.0), error_row("machine", 8.0, 6.0, 2.0)], "machine"),
        ([error_row("physics", 8.0, 6.0, 2.0), error_row("machine", 1.0, 1.0, 3.0)], "physics"),
        ([error_row("physics", 1.0, 1.0, math.nan), error_row("loop", 2.0, 4.0, 8.0)], "loop"),
        # Errors that differ by less than 0.1 % are equal.
        (
            [error_row("physics", 1.0, 2.0, 2.0), error_row("loop", 3.0, 4.0, 2.001)],
            "physics and loop",
        ),
        ([error_row("physics", 1.0, 2.0, 2.0), error_row("loop", 3.0, 4.0, 2.003)], "physics"),
    ],
)
def test_the_best_rung_is_that_with_the_least_error_at_the_longest_horizon(
    rows: list[PredictionError], best: str
) -> None:
    assert best_model(rows) == {"rotor angle": best}


def test_the_log_of_the_arm_gives_a_case_that_runs_on_its_physics(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The equations of the arm have no damping: the identified case leaves them out."""
    assert run("identify", ARM_LOG, "logs/arm", "--out", tmp_path) == cli.DONE
    assert "2 of 2 parameters fitted" in capsys.readouterr().out
    document = json.loads((tmp_path / "identification_logs_arm_arm.json").read_text())
    payload, damping = document["parameters"]
    assert payload["value"] == pytest.approx(logs_made.PAYLOAD / 0.02, rel=2e-3)
    assert damping["value"] == pytest.approx(logs_made.DAMPING, rel=0.02)
    assert (tmp_path / "identification_logs_arm_arm.png").is_file()
    assert Experiment.load(tmp_path / "identify_logs_arm_arm.toml").plant_names == ["physics"]


def test_a_full_disk_loses_no_fit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """No file can be written: the values and the case are on the screen, then the error."""

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    assert run("identify", ARM_LOG, "logs/arm", "--out", tmp_path) == cli.WRONG
    printed = capsys.readouterr()
    assert "2 of 2 parameters fitted" in printed.out
    assert "No space left on device" in printed.err
    assert_one_line(printed.err)

    _, mark, text = printed.out.partition("# Written by grosmc-mj identify")
    path = tmp_path / "from_the_screen.toml"
    path.write_text(mark + text, encoding="utf-8")
    payload = tomllib.loads(path.read_text(encoding="utf-8"))["uncertain"][0]
    assert payload["nominal"] == pytest.approx(logs_made.PAYLOAD / 0.02, rel=2e-3)


def test_ctrl_c_keeps_the_best_so_far(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """After six steps of a search: the answer says so, and the case has the values so far."""
    steps = iter(range(6))
    jacobian = Residual.jacobian

    def interrupted(residual: Residual, x: Array) -> Array:
        if next(steps, None) == 5:
            raise KeyboardInterrupt
        return jacobian(residual, x)

    monkeypatch.setattr(Residual, "jacobian", interrupted)
    assert run("identify", ARM_LOG, "logs/arm", "--out", tmp_path) == cli.INTERRUPTED
    assert "interrupted: values are the best so far" in capsys.readouterr().out
    document = json.loads((tmp_path / "identification_logs_arm_arm.json").read_text())
    payload, _ = document["parameters"]
    assert payload["value"] == pytest.approx(logs_made.PAYLOAD / 0.02, rel=0.1)
    assert Experiment.load(tmp_path / "identify_logs_arm_arm.toml").plant_names == ["physics"]


def test_a_batch_of_any_size_has_the_same_residuals(
    log: Log, experiment: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    parameters = parameters_of(experiment, coverage.NAMES)
    free = np.ones(3, bool)
    predictor = Predictor.of(log, **HOW)
    scales = {"rotor angle": coverage.NOISE}
    plant = experiment.plant("physics")
    residual = residual_of(parameters, free, predictor, plant, scales, parameters.nominal)
    x = residual.point(parameters.first)
    points = [x, 1.01 * x, 0.99 * x]
    at_once = residual.of(points)
    monkeypatch.setattr("grosmc_mj.identify.residual._MOST_ROWS", 1)
    for one, other in zip(residual.of(points), at_once, strict=True):
        assert np.array_equal(one, other)


def test_a_search_that_ends_at_its_limit_of_steps_says_so(
    log: Log, experiment: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grosmc_mj.identify.residual.MOST_STEPS", 2)
    parameters = parameters_of(experiment, coverage.NAMES)
    plant = experiment.plant("physics")
    found = fit(parameters, Predictor.of(log.between(0, 0.4), **HOW), plant)
    assert found.doubts[0].startswith("the search ended after")


@pytest.mark.parametrize("command", ["identify", "compare"])
def test_a_place_that_takes_no_file_is_refused_before_the_work(
    command: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("grosmc_mj.identify.replay.simulate", lambda *_, **__: pytest.fail("ran"))
    out = tmp_path / "a file"
    out.touch()
    assert run(command, ARM_LOG, "logs/arm", "--out", out) == cli.WRONG
    error = capsys.readouterr().err
    assert "a file is a file, and a folder is needed" in error
    assert_one_line(error)


def test_the_log_of_the_arm_is_compared_with_every_rung(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("compare", ARM_LOG, "logs/arm", "--out", tmp_path) == cli.DONE
    assert "Least error after" in capsys.readouterr().out


def test_the_shipped_logs_are_those_of_the_benchmark() -> None:
    """To a unit of the last digit, which another libm may round the other way."""
    computed = np.column_stack(logs_made.arm())
    shipped = np.loadtxt(ARM_LOG, delimiter=",", skiprows=1)
    assert np.abs(shipped - computed).max() < 1e-4


FITTED = "edit.rotor.mass_scale"


@pytest.mark.parametrize(
    ("fitted", "options", "words"),
    [
        (FITTED, ("--hold-out", 1.5), "--hold-out 1.5 must be above 0 and below 0.9"),
        (FITTED, ("--hold-out", 1e-4), "too few samples are left to predict"),
        (FITTED, ("--horizon", 0.001), "0.001 s is 0.5 samples of bench.csv: it must be 10"),
        (FITTED, ("--horizon", "nan"), "--horizon nan must be above 0 s"),
        ("rotor mass", (), "unknown parameter 'rotor mass'"),
        ("edit.shaft.armature", (), "the case has none: give it a range"),
        ("edit.rotr.mass_scale", (), "unknown body 'rotr'"),
    ],
)
def test_a_wrong_option_is_one_line(
    tmp_path: Path,
    log: Log,
    capsys: pytest.CaptureFixture[str],
    fitted: str,
    options: tuple[Any, ...],
    words: str,
) -> None:
    path = csv(tmp_path / "bench.csv", columns(log)[:800])
    assert run("identify", path, "servo/nominal", "--fit", fitted, *options) == cli.WRONG
    error = capsys.readouterr().err
    assert words in error
    assert_one_line(error)


def unlike_log(inertia: float, damping: float) -> Log:
    """Log of a servo of another inertia and damping, exact, from the benchmark's integrator."""
    random = np.random.default_rng(11)
    u = np.repeat(random.uniform(-0.8, 0.8, 84), 60)[:5000]
    angles = coverage.simulated_angles(u, inertia, damping, late=0)
    time = np.arange(len(u)) * coverage.SAMPLING
    return Log("unlike", time, u[:, None], {"rotor angle": angles}, [slice(0, len(u))])


@pytest.mark.parametrize(("sign", "told"), [(1, False), (-1, True)])
def test_a_machine_unlike_its_case_is_fitted_and_a_slip_is_told(
    sign: int, told: bool, experiment: Experiment
) -> None:
    """Its case leaves much of the motion unexplained; only what its fit leaves is a slip."""
    log = unlike_log(0.037, 0.05)
    log = replace(log.between(0, 0.4), inputs=sign * log.between(0, 0.4).inputs)
    plant = experiment.plant("physics")
    predictor = Predictor.of(log, **HOW)
    found = fit(parameters_of(experiment, coverage.NAMES), predictor, plant)
    line = slip(found, predictor, plant)
    assert line.startswith("rotor angle seems to have the other sign") is told


COULOMB_CASE = """
title = "A servo with dry friction"
[plant]
system = "servo"
[run]
duration = "5 s"
[[controller]]
law = "lqr"
[[uncertain]]
number = "edit.rotor.mass_scale"
values = [0.3, 4]
[[uncertain]]
number = "edit.shaft.damping"
values = [0.0005, 0.1]
[[uncertain]]
number = "edit.shaft.friction"
values = [0, 0.5]
"""


def dry_machine(number: int) -> tuple[Array, Log]:
    """Mass, damping and dry friction of a servo, and four seconds of its log with noise.

    By an integration that shares nothing with MuJoCo, exact to 50 us.
    """
    random = np.random.default_rng([5, number])
    scale = random.uniform(0.7, 2.0)
    damping = random.uniform(0.005, 0.03)
    friction = random.uniform(0.03, 0.15)
    u = np.repeat(random.uniform(-0.8, 0.8, 34), 60)[:2000]
    inertia = scale * coverage.INERTIA
    rest = np.zeros(3000)
    angles = coverage.simulated_angles(np.append(u, rest), inertia, damping, 0, friction)[:2000]
    angles = angles + coverage.NOISE * random.standard_normal(2000)
    time = np.arange(2000) * coverage.SAMPLING
    log = Log(f"dry {number}", time, u[:, None], {"rotor angle": angles}, [slice(0, 2000)])
    return np.array([scale, damping, friction]), log


@pytest.mark.slow
def test_intervals_of_machines_with_dry_friction_have_no_bias(tmp_path: Path) -> None:
    """Mean of (estimate - truth)/deviation: 0 but for 1/sqrt(6), three times which are allowed.

    At 1 ms dry friction stops a joint late: there the mean of the inertias is -1.6.
    """
    path = tmp_path / "dry.toml"
    path.write_text(COULOMB_CASE, encoding="utf-8")
    experiment = Experiment.load(path)
    plant = experiment.plant("physics")
    parameters = parameters_of(experiment, ())

    deviations = []
    for number in range(8, 14):
        true, log = dry_machine(number)
        found = fit(parameters, Predictor.of(log, **HOW), plant)
        deviations.append((found.values - true) / np.sqrt(np.diag(found.covariance)))
    assert np.abs(deviations).max() < 3.5
    assert (np.abs(np.mean(deviations, axis=0)) < 3 / math.sqrt(6)).all()


# Logs as other programs write them


def table_text(log: Log, comma: str = ",", point: str = ".", header: str = HEADER) -> str:
    """A log as text, with other signs between columns and in numbers."""
    lines = [header.replace(",", comma)]
    for row in columns(log).tolist():
        numbers = [f"{value:.9f}".replace(".", point) for value in row]
        lines += [comma.join(numbers)]
    return "\n".join(lines)


def dated(log: Log) -> str:
    """A log with dates and times in place of the seconds."""
    seconds = np.round(log.time * 1e9).astype(np.int64)
    instants = np.datetime64("2026-01-01", "ns") + seconds
    rows = zip(instants, log.inputs[:, 0], log.states["rotor angle"], strict=True)
    lines = [f"{instant},{u:.9f},{angle:.9f}" for instant, u, angle in rows]
    return "\n".join(["time,current [A],rotor angle [rad]", *lines])


def quoted(log: Log) -> str:
    """A log with decimal commas in quotes, and commas between the columns."""
    rows = [line.split(";") for line in table_text(log, ";", ",").split("\n")]
    return "\n".join(",".join(f'"{field}"' for field in row) for row in rows)


def with_commas(log: Log) -> str:
    """A log with a comma at the end of each row, but not of the header."""
    header, *rows = table_text(log).split("\n")
    return "\n".join([header, *[f"{row}," for row in rows]])


# Each as text, or as bytes of another encoding than UTF-8.
CSV_FILES: dict[str, Callable[[Log], str | bytes]] = {
    "semicolons": lambda log: table_text(log, ";"),
    "decimal commas": lambda log: table_text(log, ";", ","),
    "decimal commas and a decimal point in words": lambda log: (
        table_text(log, ";", ",").replace("\n", ";v1.2\n").replace(";v1.2", ";note", 1) + ";v1.2"
    ),
    "decimal commas in quotes": quoted,
    "tabs": lambda log: table_text(log, "\t"),
    "tabs and decimal commas": lambda log: table_text(log, "\t", ","),
    "byte order mark": lambda log: "\ufeff" + table_text(log),
    "UTF-16": lambda log: table_text(log).encode("utf-16"),
    "Latin-1": lambda log: (
        table_text(log).replace("\n", ",20\n").replace(",20", ",T [\xb0C]", 1) + ",20"
    ).encode("latin-1"),
    "comments before": lambda log: "# a comment\n# and another one\n" + table_text(log),
    "comments after": lambda log: table_text(log) + "\n# end, of, it\n# end\n\n",
    "header in a comment": lambda log: "# a bench\n# " + table_text(log),
    "line of the separator": lambda log: "sep=;\n" + table_text(log, ";"),
    "commas end all lines": lambda log: table_text(log).replace("\n", ",,\n") + ",,",
    "a comma ends the header": lambda log: table_text(log, header=f"{HEADER},"),
    "a comma ends the rows": with_commas,
    "empty rows": lambda log: table_text(log) + "\n,,\n,,\n",
    "lines end as in Windows": lambda log: table_text(log).replace("\n", "\r\n"),
    "dates": dated,
}


@pytest.mark.parametrize("text_of", CSV_FILES.values(), ids=CSV_FILES)
def test_a_csv_file_of_another_program_is_read(
    text_of: Callable[[Log], str | bytes], tmp_path: Path, log: Log
) -> None:
    path = tmp_path / "log.csv"
    content = text_of(log)
    path.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
    read = read_log(path, SERVO, None)
    assert read.time == pytest.approx(log.time, abs=1e-8)
    assert read.inputs == pytest.approx(log.inputs, abs=1e-8)
    assert read.states["rotor angle"] == pytest.approx(log.states["rotor angle"], abs=1e-8)


def with_line(number: int, line: str) -> Callable[[Log], str]:
    """A log with another line, counted from 1."""

    def changed_text(log: Log) -> str:
        lines = table_text(log).split("\n")
        lines[number - 1] = line
        return "\n".join(lines)

    return changed_text


@pytest.mark.parametrize(
    ("text_of", "words"),
    [
        (with_line(30, "0.058,err,0.1"), "current [A] is no number in line 30, 'err'"),
        (with_line(30, "# a\n\n0.058,err,0.1"), "current [A] is no number in line 32, 'err'"),
        (with_line(30, "0.058,0.1"), "fields than in the header in the row '0.058,0.1'"),
        (with_line(2, "0,1,5,2,3"), "fields than in the header in the row '0,1,5,2,3'"),
        (with_line(2, "0,1"), "fields than in the header in the row '0,1'"),
        (lambda log: table_text(log, ",", ","), "decimal commas need semicolons between"),
        (lambda _: "", "has no rows"),
        (lambda _: HEADER, "has no rows below its header"),
        (lambda _: "PK\0\0", "is no text: export the log as CSV"),
    ],
)
def test_a_mistake_in_a_csv_file_is_named_with_its_place(
    text_of: Callable[[Log], str], words: str, tmp_path: Path, log: Log
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text_of(log), encoding="utf-8")
    with pytest.raises(ArgumentError, match=re.escape(words)):
        read_log(path, SERVO, None)


def test_instants_and_decimals_of_a_parquet_file_are_read(tmp_path: Path, log: Log) -> None:
    path = tmp_path / "log.parquet"
    ticks = pa.array(np.round(1e6 * log.time), pa.int64())
    angle = pa.array(log.states["rotor angle"])
    for time in (ticks.cast(pa.timestamp("us", "UTC")), ticks.cast(pa.duration("us"))):
        angles = angle.cast(pa.decimal128(30, 20))
        table = pa.table({"time": time, "current": log.inputs[:, 0], "rotor angle": angles})
        pq.write_table(table, path)
        read = read_log(path, SERVO, None)
        assert read.time == pytest.approx(log.time, abs=1e-6)
        assert read.states["rotor angle"] == pytest.approx(log.states["rotor angle"])


def test_a_wrong_number_of_a_parquet_file_is_named_by_its_row(tmp_path: Path, log: Log) -> None:
    path = tmp_path / "log.parquet"
    angles = log.states["rotor angle"].copy()
    angles[30] = np.nan
    table = {"time": log.time, "current": log.inputs[:, 0], "rotor angle": angles}
    pq.write_table(pa.table(table), path)
    with pytest.raises(ArgumentError, match="rotor angle is no number in row 31, nan"):
        read_log(path, SERVO, None)


def test_two_columns_of_one_name_are_refused(tmp_path: Path, log: Log) -> None:
    header = "time [s],current [A],current [A]"
    path = csv(tmp_path / "log.csv", columns(log), header)
    with pytest.raises(ArgumentError, match=r"two columns are called 'current \[A\]'"):
        read_log(path, SERVO, None)


def test_a_misspelt_signal_in_a_case_is_named(tmp_path: Path, log: Log) -> None:
    table = LogTable.model_validate({"columns": {"curent": {"column": "current [A]", "sign": -1}}})
    path = csv(tmp_path / "log.csv", columns(log))
    with pytest.raises(ArgumentError, match=r"\[log.columns\]: unknown signal 'curent': did you"):
        read_log(path, SERVO, table)


def test_instants_of_milliseconds_without_a_unit_are_doubted(tmp_path: Path, log: Log) -> None:
    rows = columns(log)
    rows[:, 0] *= 1e3
    path = csv(tmp_path / "log.csv", rows, "time,current [A],rotor angle [rad]")
    with pytest.warns(ImplausibleWarning, match=r'write "time \[ms\]" for milliseconds'):
        read_log(path, SERVO, None)


def test_a_case_says_the_unit_of_the_time(
    tmp_path: Path, log: Log, recwarn: pytest.WarningsRecorder
) -> None:
    rows = columns(log)
    rows[:, 0] *= 1e3
    path = csv(tmp_path / "log.csv", rows, "time,current [A],rotor angle [rad]")
    read = read_log(path, SERVO, LogTable(time_unit="ms"))
    assert read.time == pytest.approx(log.time)
    assert not recwarn.list


@pytest.mark.parametrize(
    "table",
    [{"time": "zeit"}, {"columns": {"current": {"column": "current"}}}],
)
def test_a_misspelt_column_in_a_case_is_named(
    table: dict[str, Any], tmp_path: Path, log: Log
) -> None:
    path = csv(tmp_path / "log.csv", columns(log))
    with pytest.raises(ArgumentError, match=r"\[log\]: unknown column .* valid: 'time \[s\]'"):
        read_log(path, SERVO, LogTable.model_validate(table))


@pytest.mark.parametrize("number", [{"scale": 0.0}, {"scale": np.nan}, {"offset": np.inf}])
def test_numbers_of_a_case_that_leave_no_log_are_refused(number: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"0 must be another number|finite number"):
        LogTable.model_validate({"columns": {"current": {"column": "u", **number}}})


def test_messages_at_one_instant_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        both = writer.register_msgdef("a/msg/Both", "float64 current\nfloat64 angle\n")
        for k in range(60):
            message = {"current": float(k % 7), "angle": 0.1 * k}
            writer.write_message("/servo", both, message, log_time=5)
        writer.finish()

    named = {
        "current": {"column": "/servo.current"},
        "rotor angle": {"column": "/servo.angle"},
    }
    with pytest.raises(ArgumentError, match="the time does not rise in message 2"):
        read_log(path, SERVO, LogTable.model_validate({"columns": named}))


def test_an_empty_bag_says_what_ends(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(b"")
    with pytest.raises(ArgumentError, match="cannot be read: EndOfFile"):
        read_log(path, SERVO, None)


@pytest.mark.parametrize("seed", range(20))
def test_a_damaged_bag_is_one_line(seed: int, tmp_path: Path, log: Log) -> None:
    """Cut off, or with other bytes here and there."""
    path = tmp_path / "log.mcap"
    write_bag(path, log)
    content = bytearray(path.read_bytes())
    random = np.random.default_rng(seed)
    if seed % 2:
        del content[random.integers(1, len(content)) :]
    for place in random.integers(0, len(content), 20):
        content[place] = random.integers(256)
    path.write_bytes(bytes(content))
    with contextlib.suppress(ArgumentError):
        read_log(path, SERVO, None)
