"""Tables of other programs as logs: their columns, units and instants; several logs as one."""

from __future__ import annotations

import contextlib
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap_ros2.writer import Writer

from grosmc_mj.experiments.logs.log import Log, held, join_logs
from grosmc_mj.experiments.logs.read import read_log
from grosmc_mj.experiments.logs.table import LogTable
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, ImplausibleWarning
from grosmc_mj.theory.plants import find_system

SERVO = find_system("servo")
SAMPLING = 0.002
TIME = SAMPLING * np.arange(400)
CURRENT = np.where(np.sin(20 * TIME + 0.1) > 0, 0.5, -0.3)
ANGLE = 4 * TIME + np.sin(3 * TIME)
ROWS = np.column_stack([TIME, CURRENT, ANGLE])
HEADER = "time [s],current [A],rotor angle [rad]"


def csv_text(
    rows: Array = ROWS, header: str = HEADER, *, comma: str = ",", point: str = "."
) -> str:
    """A log as text, with other signs between columns and in numbers."""
    lines = [header.replace(",", comma)]
    for row in rows.tolist():
        numbers = [f"{value:.10g}".replace(".", point) for value in row]
        lines.append(comma.join(numbers))
    return "\n".join(lines)


def read(folder: Path, content: str | bytes, table: dict[str, Any] | None = None) -> Log:
    """Read the text of a CSV file, by a table of a case."""
    path = folder / "log.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_log(path, SERVO, LogTable.model_validate(table or {}))


def assert_is_the_log(log: Log) -> None:
    assert log.time == pytest.approx(TIME, abs=1e-8)
    assert log.inputs[:, 0] == pytest.approx(CURRENT, abs=1e-8)
    assert log.states["rotor angle"] == pytest.approx(ANGLE, abs=1e-8)


# -- columns and their units -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("header", "factors", "table"),
    [
        (HEADER, (1, 1, 1), {}),
        # By their symbols, in any spelling.
        ("t [ms],i [mA],Rotor_Angle (deg)", (1e3, 1e3, 180 / np.pi), {}),
        ("time,current,rotor angle", (1e3, 1, 1), {"time_unit": "ms"}),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_log_is_read_in_the_units_of_its_headers_or_of_the_case(
    header: str, factors: tuple[float, ...], table: dict[str, Any], tmp_path: Path
) -> None:
    assert_is_the_log(read(tmp_path, csv_text(ROWS * factors, header), table))


def test_a_case_says_the_sampling_and_the_conversion_of_columns(tmp_path: Path) -> None:
    """An encoder of 0.01 rad turns the other way, and counts 100 at zero."""
    rows = np.column_stack([CURRENT, 100 - ANGLE / 0.01])
    counts = {"column": "counts", "sign": -1, "scale": 0.01, "offset": 100.0}
    table = {
        "sampling": "2 ms",
        "columns": {"current": {"column": "command"}, "rotor angle": counts},
    }
    assert_is_the_log(read(tmp_path, csv_text(rows, "command,counts"), table))


def test_instants_of_milliseconds_without_a_unit_are_doubted(tmp_path: Path) -> None:
    text = csv_text(ROWS * (1e3, 1, 1), "time,current [A],rotor angle [rad]")
    with pytest.warns(ImplausibleWarning, match=r'write "time \[ms\]" for milliseconds'):
        read(tmp_path, text)


def test_a_gap_ends_a_piece_and_shares_are_of_the_whole_time(tmp_path: Path) -> None:
    log = read(tmp_path, csv_text(np.delete(ROWS, slice(100, 140), axis=0)))
    assert log.pieces == [slice(0, 100), slice(100, 360)]

    fitted, held_out = log.between(0, 0.7), log.between(0.7, 1)
    border = held_out.pieces[0].start
    assert fitted.pieces == [slice(0, 100), slice(100, border)]
    assert log.time[border] == pytest.approx(0.7 * TIME[-1], abs=SAMPLING)


# -- CSV files of other programs -------------------------------------------------------------------


def with_column(ending: str, header: str) -> str:
    """A log with another column, of one value."""
    first, *rows = csv_text().split("\n")
    return "\n".join([first + header, *[row + ending for row in rows]])


def dated() -> str:
    """A log with dates and times in place of the seconds."""
    instants = np.datetime64("2026-01-01", "ns") + np.round(TIME * 1e9).astype(np.int64)
    rows = zip(instants, CURRENT, ANGLE, strict=True)
    return "\n".join(
        ["time,current [A],rotor angle [rad]", *(f"{t},{u},{angle:.10g}" for t, u, angle in rows)]
    )


def quoted() -> str:
    """A log with decimal commas in quotes, and commas between the columns."""
    rows = [line.split(";") for line in csv_text(comma=";", point=",").split("\n")]
    return "\n".join(",".join(f'"{field}"' for field in row) for row in rows)


# Each as text, or as bytes of another encoding than UTF-8.
CSV_FILES: dict[str, str | bytes] = {
    "semicolons": csv_text(comma=";"),
    "decimal commas": csv_text(comma=";", point=","),
    "decimal commas, points in words": csv_text(
        np.column_stack([ROWS, CURRENT]), f"{HEADER},note", comma=";", point=","
    ).replace(";-0,3\n", ";v1.2\n"),
    "decimal commas in quotes": quoted(),
    "tabs and decimal commas": csv_text(comma="\t", point=","),
    "byte order mark": "\ufeff" + csv_text(),
    "UTF-16": csv_text().encode("utf-16"),
    "Latin-1": with_column(",20", ",T [\xb0C]").encode("latin-1"),
    "comments before": "# a comment\n# and another one\n" + csv_text(),
    "comments after": csv_text() + "\n# end, of, it\n# end\n\n",
    "header in a comment": "# a bench\n# " + csv_text(),
    "line of the separator": "sep=;\n" + csv_text(comma=";"),
    "commas end all lines": with_column(",,", ",,"),
    "a comma ends the header": with_column("", ","),
    "a comma ends the rows": with_column(",", ""),
    "empty rows": csv_text() + "\n,,\n,,\n",
    "lines end as in Windows": csv_text().replace("\n", "\r\n"),
    "dates": dated(),
}


@pytest.mark.parametrize("content", CSV_FILES.values(), ids=CSV_FILES)
def test_a_csv_file_of_another_program_is_read(content: str | bytes, tmp_path: Path) -> None:
    assert_is_the_log(read(tmp_path, content))


# -- refusals --------------------------------------------------------------------------------------


def with_entry(row: int, column: int, value: float) -> str:
    """A log with another number; rows are counted from 0."""
    rows = ROWS.copy()
    rows[row, column] = value
    return csv_text(rows)


def with_current(values: Any) -> str:
    rows = ROWS.copy()
    rows[:, 1] = values
    return csv_text(rows)


def with_line(number: int, line: str) -> str:
    """A log with another line, counted from 1."""
    lines = csv_text().split("\n")
    lines[number - 1] = line
    return "\n".join(lines)


def saturated(share: float) -> str:
    """A log whose input is at its upper end for a share of the time."""
    sweep = np.sin(np.linspace(0, 40, len(TIME)) ** 1.5)
    return with_current(np.minimum(sweep, np.quantile(sweep, 1 - share)))


REFUSED: list[tuple[str, str]] = [
    (csv_text(ROWS[:10]), "has 10 rows of numbers; 50 or more are needed"),
    (with_entry(300, 0, TIME[299]), "the time does not rise in line 302"),
    (with_current(0.3), "the input is 0.3 A all the time"),
    (saturated(0.52), " A for 52 % of the log: it saturates"),
    (with_entry(100, 2, np.nan), "rotor angle [rad] is no number in line 102, 'nan': fill or cut"),
    (with_entry(100, 2, 1e200), "is no number in line 102, '1e+200': fill or cut it"),
    (with_entry(100, 0, np.nan), "time [s] is no number in line 102, 'nan'"),
    (csv_text(header="time [s],volts,rotor angle"), "no column of the input 'current'"),
    (csv_text(header="time [s],current,x"), "no column of a state"),
    (csv_text(header="a,current,rotor angle"), "no column of the time"),
    (csv_text(header="time [s],current [A],rotor angle [kg]"), "cannot be converted to rad"),
    (
        csv_text(header="time [kg],current [A],rotor angle"),
        'time [kg]: "1 kg" cannot be converted to s',
    ),
    (
        csv_text(header="time [s],current [A],Current"),
        "current [A] and Current are both current",
    ),
    (
        csv_text(header="time [s],current [A],current [A]"),
        "two columns are called 'current [A]'",
    ),
    (csv_text(header="0,0,0"), "has no header of two columns or more"),
    (csv_text(header="time [s]"), "has no header of two columns or more"),
    (with_line(30, "0.058,err,0.1"), "current [A] is no number in line 30, 'err'"),
    (with_line(30, "# a\n\n0.058,err,0.1"), "current [A] is no number in line 32, 'err'"),
    (with_line(30, "0.058,0.1"), "fields than in the header in the row '0.058,0.1'"),
    (with_line(2, "0,1,5,2,3"), "fields than in the header in the row '0,1,5,2,3'"),
    (csv_text(point=","), "decimal commas need semicolons between"),
    ("", "has no rows"),
    (HEADER, "has no rows below its header"),
    ("PK\0\0", "is no text: export the log as CSV"),
]


@pytest.mark.parametrize(("text", "words"), REFUSED, ids=[words for _, words in REFUSED])
def test_a_mistake_in_a_csv_file_is_named_with_its_place(
    text: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(ArgumentError, match=rf"log\.csv: .*{re.escape(words)}"):
        read(tmp_path, text)


def test_an_input_at_its_end_for_less_than_half_of_the_log_is_read(tmp_path: Path) -> None:
    assert read(tmp_path, saturated(0.48)).pieces == [slice(0, len(TIME))]


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"columns": {"curent": {"column": "current [A]"}}}, "unknown signal 'curent': did you"),
        ({"time": "zeit"}, "[log]: unknown column 'zeit'"),
        ({"columns": {"current": {"column": "current"}}}, "unknown column 'current': did you mean"),
        ({"columns": {"current": {"column": "u", "scale": 0.0}}}, "0 must be another number"),
        ({"columns": {"current": {"column": "u", "scale": np.nan}}}, "finite number"),
        ({"columns": {"current": {"column": "u", "offset": np.inf}}}, "finite number"),
    ],
)
def test_a_mistake_in_the_table_of_a_case_is_named(
    table: dict[str, Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=re.escape(words)):
        read(tmp_path, csv_text(), table)


# -- Parquet files and bags ------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [pa.timestamp("us", "UTC"), pa.duration("us")])
def test_instants_and_decimals_of_a_parquet_file_are_read(
    kind: pa.DataType, tmp_path: Path
) -> None:
    ticks = pa.array(np.round(1e6 * TIME), pa.int64()).cast(kind)
    angles = pa.array(ANGLE).cast(pa.decimal128(30, 20))
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table({"time": ticks, "current": CURRENT, "rotor angle": angles}), path)
    assert_is_the_log(read_log(path, SERVO, None))


def test_a_wrong_number_of_a_parquet_file_is_named_by_its_row(tmp_path: Path) -> None:
    angles = ANGLE.copy()
    angles[30] = np.nan
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table({"time": TIME, "current": CURRENT, "rotor angle": angles}), path)
    with pytest.raises(ArgumentError, match="rotor angle is no number in row 31, nan"):
        read_log(path, SERVO, None)


BAG = LogTable.model_validate(
    {
        "columns": {
            "current": {"column": "/current.data"},
            "rotor angle": {"column": "/joints.position[0]"},
        }
    }
)


def write_bag(path: Path, between: int = round(1e9 * SAMPLING)) -> Path:
    """An MCAP file whose angle comes at each sample, and whose current when it changes.

    Args:
        path: The file.
        between: Time between two samples [ns].
    """
    with path.open("wb") as file:
        writer = Writer(file)
        joints = writer.register_msgdef("sensor_msgs/msg/JointState", "float64[] position\n")
        number = writer.register_msgdef("std_msgs/msg/Float64", "float64 data\n")
        for k in range(len(TIME)):
            at = 1_760_000_000_000_000_000 + k * between
            if k == 0 or CURRENT[k] != CURRENT[k - 1]:
                writer.write_message("/current", number, {"data": CURRENT[k]}, log_time=at)
            writer.write_message("/joints", joints, {"position": [ANGLE[k]]}, log_time=at)
        writer.finish()
    return path


def test_messages_of_several_topics_are_brought_to_the_instants_of_the_state(
    tmp_path: Path,
) -> None:
    assert_is_the_log(read_log(write_bag(tmp_path / "bag.mcap"), SERVO, BAG))


def test_messages_at_one_instant_are_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag.mcap", between=0)
    with pytest.raises(ArgumentError, match="the time does not rise in message 2"):
        read_log(path, SERVO, BAG)


def test_an_empty_bag_says_what_ends(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(b"")
    with pytest.raises(ArgumentError, match="cannot be read: EndOfFile"):
        read_log(path, SERVO, None)


@pytest.mark.parametrize("seed", range(20))
def test_a_damaged_bag_is_one_line(seed: int, tmp_path: Path) -> None:
    """Cut off, or with other bytes here and there."""
    path = write_bag(tmp_path / "log.mcap")
    content = bytearray(path.read_bytes())
    random = np.random.default_rng(seed)
    if seed % 2:
        del content[random.integers(1, len(content)) :]
    for place in random.integers(0, len(content), 20):
        content[place] = random.integers(256)
    path.write_bytes(bytes(content))
    with contextlib.suppress(ArgumentError):
        read_log(path, SERVO, None)


# -- several logs as one ---------------------------------------------------------------------------


def noisy(first: int, stop: int) -> Log:
    """Some samples of the log, from 0 s on, whose angle has a noise of 0.03 rad."""
    count = stop - first
    angle = ANGLE[first:stop] + 0.03 * np.random.default_rng(first).standard_normal(count)
    inputs = CURRENT[first:stop, None]
    return Log(f"from {first}", TIME[:count], inputs, {"rotor angle": angle}, [slice(0, count)])


SHORT, LONG = noisy(100, 200), noisy(150, 400)


def test_joined_logs_keep_their_samples_and_the_noise_of_their_sensor() -> None:
    both = join_logs([SHORT, LONG])
    assert both.pieces == [slice(0, 100), slice(101, 351)]
    assert (np.diff(both.time) > 0).all()
    for piece, log in zip(both.pieces, [SHORT, LONG], strict=True):
        assert np.array_equal(both.inputs[piece], log.inputs)
        assert np.array_equal(both.states["rotor angle"][piece], log.states["rotor angle"])
    assert both.noise("rotor angle") == pytest.approx(0.03, rel=0.15)


def test_a_late_input_of_a_joined_log_is_its_own_first_one() -> None:
    both = join_logs([SHORT, LONG])
    grid = both.time[101] + np.array([0.0, 1e-3])
    assert SHORT.inputs[-1] != LONG.inputs[0]
    assert held(both.time, both.inputs, 5e-3, grid)[0] == pytest.approx(LONG.inputs[0])


def test_logs_of_different_states_are_not_joined() -> None:
    speed = replace(LONG, states={"rotor speed": LONG.states["rotor angle"]})
    with pytest.raises(ArgumentError, match="several logs must measure the same states"):
        join_logs([SHORT, speed])


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
