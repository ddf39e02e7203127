"""Messages of ROS 2: joints by their names, one clock, signals only where messages show them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer
from steps import STEP, step

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import MeasuredTable
from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.experiments.logs.read import read_log
from grosmc_mj.experiments.logs.table import LogTable
from grosmc_mj.experiments.measured import MeasuredResult, results_of_logs
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.identify.predict import question_of
from grosmc_mj.theory.plants import find_system

SERVO = find_system("servo")
BEGIN = 1_700_000_000 * 10**9
STEP_OF_TIME = 2_000_000
SAMPLES = 400
TIME = np.arange(SAMPLES) * 0.002
CURRENT = np.sin(5 * TIME)
ANGLE = np.sin(3 * TIME)
SPEED = 3 * np.cos(3 * TIME)

_RULE = "=" * 80
JOINT_STATE = f"""std_msgs/Header header
string[] name
float64[] position
float64[] effort
{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


class Message(NamedTuple):
    """A message of a topic.

    Attributes:
        topic: Its topic.
        at: Instant at which it was recorded, from the begin of the bag on [ns].
        content: Its fields.
    """

    topic: str
    at: int
    content: Mapping[str, Any]


def joints(k: int, names: list[str], *, stamp: int = 0, late: int = 0) -> Message:
    """The state of a shaft and of a gripper, in the order of the names.

    Args:
        k: Number of the sample.
        names: The joints.
        stamp: Stamp of the header [ns]; 0 for none.
        late: Time from the sample to its record [ns].
    """
    positions = {"shaft": float(ANGLE[k]), "gripper": 0.02}
    efforts = {"shaft": float(CURRENT[k]), "gripper": 0.0}
    content = {
        "header": {
            "stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9},
            "frame_id": "",
        },
        "name": names,
        "position": [positions[name] for name in names],
        "effort": [efforts[name] for name in names],
    }
    return Message("/joint_states", k * STEP_OF_TIME + late, content)


def write_joints(path: Path, messages: Iterable[Message]) -> Path:
    """Write states of joints as ROS 2 does."""
    with path.open("wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for topic, at, content in messages:
            writer.write_message(topic, schema, content, log_time=BEGIN + at)
        writer.finish()
    return path


def write_json(path: Path, messages: Iterable[Message]) -> Path:
    """Write messages in JSON."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channels: dict[str, int] = {}
        for topic, at, content in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", 0)
            writer.add_message(
                channels[topic], BEGIN + at, json.dumps(content).encode(), BEGIN + at
            )
        writer.finish()
    return path


def table_of(**columns: str) -> LogTable:
    """A table with the columns of the current, the angle and perhaps the speed."""
    named = {name.replace("_", " "): {"column": column} for name, column in columns.items()}
    return LogTable.model_validate({"columns": named})


def read_joint(path: Path, joint: str) -> Log:
    """The log of a joint, by its name or its number."""
    table = table_of(
        current=f"/joint_states.effort[{joint}]", rotor_angle=f"/joint_states.position[{joint}]"
    )
    return read_log(path, SERVO, table)


# -- joints by their names -------------------------------------------------------------------------

FORWARD = ["shaft", "gripper"]
BACKWARD = ["gripper", "shaft"]


def one_order() -> list[Message]:
    return [joints(k, FORWARD) for k in range(SAMPLES)]


def other_order_half_way() -> list[Message]:
    return [joints(k, FORWARD if k < SAMPLES // 2 else BACKWARD) for k in range(SAMPLES)]


def two_publishers() -> list[Message]:
    messages = []
    for k in range(SAMPLES):
        messages.append(joints(k, ["shaft"]))
        if k % 10 == 5:
            messages.append(joints(k, ["gripper"], late=1_000_000))
    return messages


BAGS = {
    "one order": one_order,
    "another order half way": other_order_half_way,
    "two publishers": two_publishers,
}


@pytest.mark.parametrize("messages", BAGS.values(), ids=BAGS)
def test_a_joint_is_read_by_its_name_in_any_order(tmp_path: Path, messages: Any) -> None:
    log = read_joint(write_joints(tmp_path / "bag.mcap", messages()), "shaft")
    assert np.array_equal(log.states["rotor angle"], ANGLE)
    assert np.array_equal(log.inputs[:, 0], CURRENT)


def test_a_number_is_a_joint_while_its_name_stays(tmp_path: Path) -> None:
    path = write_joints(tmp_path / "bag.mcap", one_order())
    log = read_joint(path, "0")
    assert np.array_equal(log.states["rotor angle"], ANGLE)


@pytest.mark.parametrize("messages", [other_order_half_way, two_publishers])
def test_a_number_whose_name_changes_is_refused_with_the_names(
    tmp_path: Path, messages: Any
) -> None:
    path = write_joints(tmp_path / "bag.mcap", messages())
    words = "its name changes from message to message: write /joint_states.effort[gripper] or"
    with pytest.raises(ArgumentError, match=re.escape(words)):
        read_joint(path, "0")


def test_a_topic_of_two_channels_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channels = [writer.register_channel("/servo", "json", 0, {"n": n}) for n in "ab"]
        for k in range(100):
            content = f'{{"u": {k % 7}, "q": {k}}}'.encode()
            writer.add_message(channels[k % 2], BEGIN + k * STEP_OF_TIME, content, BEGIN)
        writer.finish()
    with pytest.raises(ArgumentError, match=r"/servo\.u: 2 channels of the file have it"):
        read_log(path, SERVO, table_of(current="/servo.u", rotor_angle="/servo.q"))


# -- one clock -------------------------------------------------------------------------------------


def test_the_time_is_that_of_the_stamps(tmp_path: Path) -> None:
    """The network brings the messages late, by up to nine tenths of a sample."""
    late = np.random.default_rng(0).integers(0, 1_800_000, SAMPLES)
    messages = [
        joints(k, FORWARD, stamp=BEGIN + k * STEP_OF_TIME, late=int(late[k]))
        for k in range(SAMPLES)
    ]
    path = write_joints(tmp_path / "bag.mcap", messages)
    log = read_joint(path, "shaft")
    assert np.array_equal(log.time, np.arange(SAMPLES) * STEP_OF_TIME / 1e9)
    assert np.array_equal(log.states["rotor angle"], ANGLE)
    assert log.notes == ["bag.mcap: the time is header.stamp of its messages"]


def test_stamps_that_go_back_are_refused(tmp_path: Path) -> None:
    """A clock that was set back by 10 ms in the middle of the log."""
    messages = []
    for k in range(SAMPLES):
        stamp = BEGIN + k * STEP_OF_TIME - (10_000_000 if k >= 200 else 0)
        messages.append(joints(k, FORWARD, stamp=stamp))
    path = write_joints(tmp_path / "bag.mcap", messages)
    with pytest.raises(ArgumentError, match="the time does not rise in message 201"):
        read_joint(path, "shaft")


def test_the_time_is_that_of_the_record_if_a_signal_has_no_stamps(tmp_path: Path) -> None:
    messages = []
    for k in range(SAMPLES):
        stamp = {"sec": 5, "nanosec": k}
        angle = {"header": {"stamp": stamp}, "q": float(ANGLE[k])}
        messages.append(Message("/angle", k * STEP_OF_TIME, angle))
        messages.append(Message("/current", k * STEP_OF_TIME, {"u": float(CURRENT[k])}))
    path = write_json(tmp_path / "bag.mcap", messages)
    log = read_log(path, SERVO, table_of(current="/current.u", rotor_angle="/angle.q"))
    assert np.array_equal(log.time, np.arange(SAMPLES) * STEP_OF_TIME / 1e9)
    assert log.notes == [
        "bag.mcap: the time is when its messages were recorded, since /current.u has no "
        "header.stamp"
    ]


# -- signals where messages show them --------------------------------------------------------------


def of_topics(path: Path, shown: Mapping[str, Iterable[int]]) -> Path:
    """Write topics of the current, the angle and the speed, each at some samples."""
    values = {"/u": CURRENT, "/q": ANGLE, "/w": SPEED}
    messages = []
    for k in range(SAMPLES):
        for topic, samples in shown.items():
            if k in samples:
                messages.append(Message(topic, k * STEP_OF_TIME, {"x": float(values[topic][k])}))
    return write_json(path, messages)


TOPICS = table_of(current="/u.x", rotor_angle="/q.x", rotor_speed="/w.x")
ALL = range(SAMPLES)
# Samples of the topics, and the samples that show all of them. An input is held for as long as it
# has been held before, and a state for one of its own steps.
PARTS: dict[str, tuple[dict[str, Iterable[int]], list[slice]]] = {
    "all": ({"/u": ALL, "/q": ALL, "/w": ALL}, [slice(0, SAMPLES)]),
    "input begins late": ({"/u": range(100, SAMPLES), "/q": ALL, "/w": ALL}, [slice(99, SAMPLES)]),
    "input ends early": ({"/u": range(200), "/q": ALL, "/w": ALL}, [slice(0, 201)]),
    "input is rare": ({"/u": range(0, SAMPLES, 12), "/q": ALL, "/w": ALL}, [slice(0, SAMPLES)]),
    "state begins late": ({"/u": ALL, "/q": ALL, "/w": range(100, SAMPLES)}, [slice(99, SAMPLES)]),
    "state ends early": ({"/u": ALL, "/q": ALL, "/w": range(200)}, [slice(0, 201)]),
    "state has a gap": (
        {"/u": ALL, "/q": ALL, "/w": [*range(140), *range(180, SAMPLES)]},
        [slice(0, 140), slice(180, SAMPLES)],
    ),
    "state is rare": ({"/u": ALL, "/q": ALL, "/w": range(0, SAMPLES, 5)}, [slice(0, SAMPLES)]),
}


@pytest.mark.parametrize(("shown", "pieces"), PARTS.values(), ids=PARTS)
def test_a_fit_uses_what_all_messages_show(
    tmp_path: Path, shown: dict[str, Iterable[int]], pieces: list[slice]
) -> None:
    log = read_log(of_topics(tmp_path / "bag.mcap", shown), SERVO, TOPICS)
    assert log.pieces == pieces
    left_out = SAMPLES - sum(piece.stop - piece.start for piece in pieces)
    assert any(f"at {left_out} of {SAMPLES} samples" in note for note in log.notes) == (
        left_out > 0
    )


@pytest.fixture(scope="module")
def case() -> Experiment:
    columns = {"current": "/u.x", "rotor angle": "/q.x", "rotor speed": "/w.x"}
    return step(
        {"input_below": "10 A"},
        {"state": "rotor speed", "stays_within": "10 rad/s"},
        {"state": "rotor angle", "stays_within": "10 rad"},
        run=STEP["run"] | {"duration": "0.78 s"},
        log={"columns": {name: {"column": column} for name, column in columns.items()}},
    )


def judged(case: Experiment, folder: Path, shown: Mapping[str, Iterable[int]]) -> MeasuredResult:
    """A bag as a run of the case."""
    path = of_topics(folder / "bag.mcap", shown)
    (result,) = results_of_logs(case, [MeasuredTable(log=str(path), law="pd")])
    return result


INPUT = "input below 10 A"
SPEED_WITHIN = "rotor speed stays within 10 rad/s"
ANGLE_WITHIN = "rotor angle stays within 10 rad"
JUDGED = {
    "all": [INPUT, SPEED_WITHIN, ANGLE_WITHIN],
    "input begins late": [SPEED_WITHIN, ANGLE_WITHIN],
    "input ends early": [SPEED_WITHIN, ANGLE_WITHIN],
    "input is rare": [INPUT, SPEED_WITHIN, ANGLE_WITHIN],
    "state ends early": [INPUT, ANGLE_WITHIN],
    "state has a gap": [INPUT, ANGLE_WITHIN],
}


@pytest.mark.parametrize(("part", "words"), JUDGED.items(), ids=JUDGED)
def test_a_requirement_is_judged_by_what_messages_show(
    case: Experiment, tmp_path: Path, part: str, words: list[str]
) -> None:
    """No value is held backwards, and none is frozen."""
    result = judged(case, tmp_path, PARTS[part][0])
    assert [judgement.requirement.words for judgement in result.requirements] == words
    missing = [line for line in (INPUT, SPEED_WITHIN, ANGLE_WITHIN) if line not in words]
    assert len(result.not_judged) == len(missing)
    assert all(line in reason for line, reason in zip(missing, result.not_judged, strict=True))
    assert any("s of the run only" in note for note in result.notes) == bool(missing)


def test_the_largest_input_is_unknown_if_a_part_of_it_is(case: Experiment, tmp_path: Path) -> None:
    assert judged(case, tmp_path, PARTS["all"][0]).metrics["max_input"].value is not None
    late = judged(case, tmp_path, PARTS["input begins late"][0])
    assert late.metrics["max_input"].value is None
    assert late.metrics["total_variation"].value is None


def test_a_prediction_needs_the_whole_input(case: Experiment, tmp_path: Path) -> None:
    path = of_topics(tmp_path / "bag.mcap", PARTS["input begins late"][0])
    log = read_log(path, case.nominal.system, case.file.log, to_learn=False)
    with pytest.raises(ArgumentError, match="a prediction needs it from the first to the last"):
        question_of(case, "pd", log, log)
