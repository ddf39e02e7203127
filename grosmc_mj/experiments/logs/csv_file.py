"""CSV files as spreadsheets and programs write them, as tables of texts."""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.csv

from grosmc_mj.experiments.logs.limits import LARGEST_LOG, require_few_columns, too_large
from grosmc_mj.experiments.logs.numbers import NUMBER
from grosmc_mj.ground.errors import ArgumentError, value_text

# Its functions are made at import: a type checker does not see them.
pc: Any = pyarrow.compute
# Bytes at the beginning of a file in which its header is looked for.
_BEGINNING = 1 << 20
# Letters of a line without content.
_EMPTY = " \t,;"
_COMMENT = "#"
# Mark of the order of bytes, which some programs write in UTF-8 too.
_MARK = "\ufeff"
# A line of spreadsheets that names the letter between the columns.
_SEPARATOR_LINE = re.compile(r"sep=(.)")
_WITH_POINT = r"^[+-]?(\d+\.\d*|\.\d+)([eE][+-]?\d+)?$"
_WITH_COMMA = r"^[+-]?\d*,\d+([eE][+-]?\d+)?$"


class _Layout(NamedTuple):
    """Layout of a CSV file, by its beginning.

    Attributes:
        encoding: Of its text.
        separator: Letter between two columns.
        headers: Of the columns.
        width: Number of fields in the first row.
        skipped: Lines before the first row.
    """

    encoding: str
    separator: str
    headers: list[str]
    width: int
    skipped: int


def csv_table(path: Path) -> pa.Table:
    """Read a CSV file, plain or gzip, as texts; a decimal comma becomes a decimal point.

    Commas, semicolons or tabs separate the columns. Comments begin with #; the last one before the
    rows may be the header. Empty lines, and empty columns at the end of lines, are left out.

    Raises:
        ArgumentError: If it is too large, has no header, or a row has more or fewer fields.
    """
    content = _content(path)
    layout = _layout(content)
    names = [str(index) for index in range(layout.width)]
    ragged: list[str] = []

    def skip(row: pyarrow.csv.InvalidRow) -> str:
        if not _is_left_out(row.text):
            ragged.append(row.text)
        return "skip"

    table = pyarrow.csv.read_csv(
        pa.BufferReader(content),
        pyarrow.csv.ReadOptions(
            column_names=names, skip_rows=layout.skipped, encoding=layout.encoding
        ),
        pyarrow.csv.ParseOptions(delimiter=layout.separator, invalid_row_handler=skip),
        pyarrow.csv.ConvertOptions(column_types=dict.fromkeys(names, pa.string())),
    )
    if ragged:
        raise _ragged(ragged[0])
    columns = [pc.utf8_trim_whitespace(texts) for texts in table.columns]

    is_filled = np.array([pc.not_equal(texts, "").to_numpy() for texts in columns])
    is_row = is_filled.any(axis=0) & ~pc.starts_with(columns[0], _COMMENT).to_numpy()
    beyond = is_row & is_filled[len(layout.headers) :].any(axis=0)
    if beyond.any():
        fields = table.slice(int(np.argmax(beyond)), 1).to_pylist()[0].values()
        raise _ragged(layout.separator.join(fields))
    columns = [texts.filter(pa.array(is_row)) for texts in columns[: len(layout.headers)]]

    has_points = any(_matches(texts, _WITH_POINT) for texts in columns)
    if not has_points and any(_matches(texts, _WITH_COMMA) for texts in columns):
        columns = [pc.replace_substring(texts, ",", ".") for texts in columns]
    return pa.table(columns, layout.headers)


def line_of(path: Path, row: int) -> int:
    """Return the line of a CSV file, from 1, that a row of its table, from 0, stands in."""
    content = _content(path)
    layout = _layout(content)
    lines = io.TextIOWrapper(io.BytesIO(content), encoding=layout.encoding, errors="replace")
    for number, line in enumerate(lines, start=1):
        if number <= layout.skipped or _is_left_out(line):
            continue
        if row == 0:
            return number
        row -= 1
    raise IndexError(row)


def _content(path: Path) -> bytearray:
    """The bytes of a CSV file, decompressed if it ends in ``.gz``.

    Raises:
        ArgumentError: If there are more than a log may have.
    """
    opened = gzip.open if path.suffix.lower() == ".gz" else open
    content = bytearray()
    with opened(path, "rb") as file:
        while piece := file.read(_BEGINNING):
            content += piece
            if len(content) > LARGEST_LOG:
                raise too_large(None)
    return content


def _layout(content: bytearray) -> _Layout:
    """The layout of a CSV file.

    Raises:
        ArgumentError: If it has no header or no rows.
    """
    encoding = _encoding(content)
    # The beginning may end within a letter.
    text = content[:_BEGINNING].decode(encoding, errors="ignore").removeprefix(_MARK)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    filled = [k for k, line in enumerate(lines) if line.strip(_EMPTY)]
    rows = [k for k in filled if not lines[k].startswith(_COMMENT)]

    separators = ";\t"
    if rows and (match := _SEPARATOR_LINE.fullmatch(lines[rows[0]].strip())):
        separators = match[1]
        del rows[0]
    if not rows:
        raise ArgumentError("it has no rows: log some seconds")

    header = lines[rows[0]]
    if re.match(NUMBER, re.split(r"[,;\s]", header)[0]):
        # NumPy writes the header as a comment.
        comments = [lines[k] for k in filled if k < rows[0]]
        header = comments[-1].lstrip(_COMMENT) if comments else ""
    else:
        del rows[0]
    if not rows:
        raise ArgumentError("it has no rows below its header: log some seconds")

    # A comma may also be one of decimals.
    first = lines[rows[0]]
    separator = next((s for s in separators if s in header and s in first), ",")
    headers = _fields(header.rstrip(_EMPTY), separator)
    fields = _fields(first, separator)
    require_few_columns(len(headers))
    if len(headers) < 2:
        raise ArgumentError(
            "it has no header of two columns or more: begin it with their names, such as "
            "'time [s],current [A]', separated by commas, semicolons or tabs"
        )
    if len(fields) < len(headers) or any(fields[len(headers) :]):
        raise _ragged(first)
    return _Layout(encoding, separator, headers, len(fields), rows[0])


def _encoding(content: bytearray) -> str:
    """Encoding of a file.

    Raises:
        ArgumentError: If it is no text.
    """
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    if b"\0" in content:
        raise ArgumentError("it is no text: export the log as CSV")

    # All of it: a single letter of another encoding may stand in its last line.
    decoder = codecs.getincrementaldecoder("utf-8")()
    try:
        for begin in range(0, len(content), _BEGINNING):
            decoder.decode(content[begin : begin + _BEGINNING])
        decoder.decode(b"", final=True)
    except UnicodeDecodeError:
        # The degree sign and the micro sign of western Europe.
        return "latin-1"
    return "utf-8"


def _fields(line: str, separator: str) -> list[str]:
    """The fields of a line, without blanks around them."""
    fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    return [field.strip() for field in fields]


def _is_left_out(line: str) -> bool:
    """Whether a line is a comment or has no content."""
    return line.startswith(_COMMENT) or not line.strip(_EMPTY + "\r\n")


def _matches(texts: pa.ChunkedArray, pattern: str) -> bool:
    """Whether a pattern matches one of some texts."""
    return bool(pc.any(pc.match_substring_regex(texts, pattern)).as_py())


def _ragged(row: str) -> ArgumentError:
    """The error of a row with more or fewer fields than the header."""
    return ArgumentError(
        f"more or fewer fields than in the header in the row {value_text(row)}: correct it; "
        "numbers with decimal commas need semicolons between the columns"
    )
