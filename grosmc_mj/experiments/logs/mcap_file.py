"""MCAP files: the numbers of their messages, JSON or ROS 2, as columns."""

from __future__ import annotations

import json
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from grosmc_mj.experiments.logs.columns import LogColumn
from grosmc_mj.experiments.logs.limits import LARGEST_LOG, require_few_columns, too_large
from grosmc_mj.ground.errors import SetupError

# Fields that name the entries of the arrays of a message, as in sensor_msgs/JointState.
_NAMES = ("name", "names", "joint_names")
# Longer arrays are pictures, maps or scans, and no signals of a machine.
_LONGEST_ARRAY = 1000
# A value and two instants [bytes].
_BYTES_OF_A_NUMBER = 24
_NANOSECONDS = 10**9


@dataclass(eq=False)
class _Series:
    """Numbers of one path in the messages.

    Attributes:
        values: The numbers.
        recorded: Instants at which the messages were recorded [ns].
        stamped: Their ``header.stamp`` [ns]; 0 for none.
        channels: Ids of the channels that they come from.
    """

    values: array[float] = field(default_factory=lambda: array("d"))
    recorded: array[int] = field(default_factory=lambda: array("q"))
    stamped: array[int] = field(default_factory=lambda: array("q"))
    channels: set[int] = field(default_factory=set)


class _Messages:
    """Numbers of messages, by their paths.

    Attributes:
        series: By path, such as ``/joint_states.position[shaft]``.
        named: By the path with a number, ``/joint_states.position[0]``, the paths with the names
            that stood there.
    """

    def __init__(self) -> None:
        self.series: dict[str, _Series] = {}
        self.named: dict[str, set[str]] = {}
        self._count = 0

    def add(self, topic: str, content: Any, recorded: int, channel: int) -> None:
        """Add the numbers of a message.

        Raises:
            ArgumentError: If there are too many of them.
        """
        names = _names(content)
        stamped = _stamp(content)
        for path, value in self._numbers(topic, content, names):
            series = self.series.get(path)
            if series is None:
                require_few_columns(len(self.series) + 1)
                series = self.series[path] = _Series()
            series.values.append(value)
            series.recorded.append(recorded)
            series.stamped.append(stamped)
            series.channels.add(channel)

            self._count += 1
            if self._count * _BYTES_OF_A_NUMBER > LARGEST_LOG:
                raise too_large(None)

    def _numbers(
        self, path: str, content: Any, names: Sequence[str]
    ) -> Iterator[tuple[str, float]]:
        """The numbers of a message or a part of it, with the paths to them."""
        if isinstance(content, bool | int | float):
            yield path, float(content)
        elif isinstance(content, Sequence):
            if isinstance(content, str | bytes) or len(content) > _LONGEST_ARRAY:
                return
            is_named = len(content) == len(names)
            for index, part in enumerate(content):
                place = f"{path}[{index}]"
                if is_named:
                    named = f"{path}[{names[index]}]"
                    self.named.setdefault(place, set()).add(named)
                    place = named
                yield from self._numbers(place, part, names)
        else:
            for key, part in _fields(content):
                yield from self._numbers(f"{path}.{key}", part, names)


def mcap_columns(path: Path) -> dict[str, LogColumn]:
    """The numbers of an MCAP file's messages, such as ``/joint_states.position[shaft]``.

    Entries of arrays go by the names in the message, if it has some, or else by their numbers.

    Raises:
        ArgumentError: If it has too many numbers.
        SetupError: If the library for it is missing.
    """
    messages = _Messages()
    for topic, content, recorded, channel in _decoded(path):
        messages.add(topic, content, recorded, channel)

    # Nanoseconds since 1970 do not fit into a float: each clock counts from its first instant on.
    recorded_from = min((min(series.recorded) for series in messages.series.values()), default=0)
    stamps = [min(s.stamped) for s in messages.series.values() if min(s.stamped) > 0]
    stamped_from = min(stamps, default=0)
    columns = {}
    for name, series in messages.series.items():
        columns[name] = _column(name, series, recorded_from, stamped_from)
    return {**columns, **_numbered(columns, messages.named)}


def _column(name: str, series: _Series, recorded_from: int, stamped_from: int) -> LogColumn:
    """A column of a path, in the order in which its messages were recorded."""
    recorded = np.array(series.recorded)
    order = np.argsort(recorded, kind="stable")
    stamped = None
    if min(series.stamped) > 0:
        stamped = (np.array(series.stamped)[order] - stamped_from) / _NANOSECONDS

    refused = ""
    if len(series.channels) > 1:
        refused = (
            f"{len(series.channels)} channels of the file have it: record one of them, or give "
            "each a topic of its own"
        )
    return LogColumn(
        name,
        np.array(series.values)[order],
        name,
        stamps=(recorded[order] - recorded_from) / _NANOSECONDS,
        stamped=stamped,
        refused=refused,
    )


def _numbered(
    columns: Mapping[str, LogColumn], named: Mapping[str, set[str]]
) -> dict[str, LogColumn]:
    """Columns by the numbers of named entries, which are refused where the names change."""
    numbered = {}
    for place, paths in named.items():
        present = sorted(path for path in paths if path in columns)
        if place in columns or not present:
            continue
        column = replace(columns[present[0]], header=place, name=place)
        if len(present) > 1:
            refused = f"its name changes from message to message: write {' or '.join(present)}"
            column = replace(column, refused=refused)
        numbered[place] = column
    return numbered


# -- messages --------------------------------------------------------------------------------------


def _decoded(path: Path) -> Iterator[tuple[str, Any, int, int]]:
    """The messages that can be decoded: topic, content, instant of the record [ns], channel."""
    try:
        from mcap.records import Channel, Message, Schema
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise SetupError("MCAP needs a library: pip install 'grosmc_mj[identify]'") from None

    ros = DecoderFactory()
    schemas: dict[int, Schema] = {}
    topics: dict[int, str] = {}
    decoders: dict[int, Callable[[bytes], Any] | None] = {}
    for record in _records(path):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            topics[record.id] = record.topic
            decoders[record.id] = json.loads
            if record.message_encoding != "json":
                schema = schemas.get(record.schema_id)
                decoders[record.id] = ros.decoder_for(record.message_encoding, schema)
        elif isinstance(record, Message):
            decode = decoders[record.channel_id]
            if decode is not None:
                content = decode(record.data)
                yield topics[record.channel_id], content, record.log_time, record.channel_id


def _records(path: Path) -> Iterator[Any]:
    """The records of an MCAP file, those of its chunks too.

    Raises:
        ArgumentError: If a chunk would be too large when it is decompressed.
    """
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True, record_size_limit=LARGEST_LOG).records:
            if not isinstance(record, Chunk):
                yield record
                continue
            if record.uncompressed_size > LARGEST_LOG:
                raise too_large(record.uncompressed_size)
            yield from breakup_chunk(record)


def _fields(content: Any) -> Iterator[tuple[str, Any]]:
    """The fields of a message of JSON or of ROS 2."""
    if isinstance(content, Mapping):
        yield from content.items()
    else:
        for key in getattr(content, "__slots__", ()):
            yield key, getattr(content, key)


def _names(content: Any) -> Sequence[str]:
    """The names of the entries of a message's arrays; none if it has no field of them."""
    for key, value in _fields(content):
        if key in _NAMES and isinstance(value, list) and value:
            is_text = all(isinstance(name, str) for name in value)
            if is_text and len(set(value)) == len(value):
                return value
    return ()


def _stamp(content: Any) -> int:
    """The ``header.stamp`` of a message [ns]; 0 for none."""
    header = dict(_fields(content)).get("header")
    stamp = dict(_fields(dict(_fields(header)).get("stamp")))
    seconds = stamp.get("sec", stamp.get("secs", 0))
    nanoseconds = stamp.get("nanosec", stamp.get("nsec", stamp.get("nsecs", 0)))
    return int(seconds) * _NANOSECONDS + int(nanoseconds)
