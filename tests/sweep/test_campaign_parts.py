"""A part is believed when it is that part of that campaign, to the last bit."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from campaign_cases import campaign, forged, kept, pair, replaced
from hypothesis import given, settings
from hypothesis import strategies as st

from grosmc_mj.errors import GrosmcError
from grosmc_mj.sweep.findings import findings
from grosmc_mj.sweep.store import Folder, checksum


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """Sixteen servos in four parts."""
    return kept(campaign(pair(), runs=16), tmp_path_factory.mktemp("campaign"))


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """The same with another seed."""
    return kept(campaign(pair(), runs=16, seed=1), tmp_path_factory.mktemp("other"))


@pytest.fixture
def copy(finished: Folder, tmp_path: Path) -> Folder:
    """The campaign, to be broken."""
    return Folder(Path(shutil.copytree(finished.path, tmp_path / "copy")))


def refused(folder: Folder, index: int) -> None:
    """A part is refused by name in one line, which reading and resuming both give."""
    asked, lines = campaign(pair(), runs=16), set()
    for use in (
        lambda: folder.begin(asked, resume=True),
        lambda: findings(asked, folder, 0.95),
        lambda: folder.columns(asked, ["relative"], range(4)),
    ):
        with pytest.raises(GrosmcError) as error:
            use()
        lines.add(str(error.value))
    assert lines == {
        f"{folder.part(index)} is damaged, or is not part {index} of this campaign: remove it, and "
        "--resume runs it again"
    }


def permuted(table: pa.Table) -> pa.Table:
    """Two runs of one controller, exchanged."""
    return table.take([1, 0, *range(2, 8)])


def exchanged(table: pa.Table) -> pa.Table:
    """What two runs did, exchanged, under their own numbers."""
    ids = permuted(table)
    return ids.set_column(0, ids.field("id"), table["id"])


def flipped(table: pa.Table) -> pa.Table:
    """The lowest bit of one margin."""
    value = np.nextafter(table["relative"][3].as_py(), 9)
    return replaced(table, "relative", 3, value)


def of_another_type(table: pa.Table) -> pa.Table:
    """Margins of half the precision."""
    place = table.column_names.index("relative")
    return table.set_column(place, "relative", table["relative"].cast(pa.float32()))


def of_another_unit(table: pa.Table) -> pa.Table:
    """Margins in degrees, it says."""
    place = table.column_names.index("deviation")
    field = table.field("deviation").with_metadata({"unit": "deg"})
    return table.set_column(place, field, table["deviation"])


def without_a_value(table: pa.Table) -> pa.Table:
    """A margin that is not there, which counts would take for one that is not kept."""
    return replaced(table, "relative", 0, None)


@pytest.mark.parametrize(
    "tampered",
    [
        permuted,
        lambda table: table.take([4, 5, 6, 7, 0, 1, 2, 3]),
        exchanged,
        flipped,
        of_another_unit,
        of_another_type,
        lambda table: table.drop_columns(["relative"]),
        lambda table: table.append_column("more", table["id"]),
        lambda table: table.slice(0, 5),
        lambda table: pa.concat_tables([table] * 2),
        without_a_value,
        lambda table: table.replace_schema_metadata({}),
        lambda table: table.replace_schema_metadata({b"grosmc_mj": b"[]"}),
    ],
)
def test_rows_that_are_not_those_that_were_written(copy: Folder, tampered: Any) -> None:
    pq.write_table(tampered(pq.read_table(copy.part(2))), copy.part(2))
    refused(copy, 2)


def test_a_part_of_another_seed_or_place(copy: Folder, other: Folder) -> None:
    mine = copy.part(2).read_bytes()
    shutil.copy(other.part(2), copy.part(2))
    refused(copy, 2)
    copy.part(2).write_bytes(mine)
    shutil.copy(copy.part(3), copy.part(1))
    refused(copy, 1)
    forged(copy.part(1), pq.read_table(copy.part(3)), part=1)
    refused(copy, 1)


@pytest.mark.parametrize("cut", [0, 100, -20])
def test_half_a_part(copy: Folder, cut: int) -> None:
    copy.part(1).write_bytes(copy.part(1).read_bytes()[:cut])
    refused(copy, 1)
    copy.part(1).unlink()
    copy.part(1).mkdir()
    refused(copy, 1)


def test_any_byte_that_is_flipped_is_noticed_or_decides_nothing(copy: Folder) -> None:
    asked, whole = campaign(pair(), runs=16), copy.part(0).read_bytes()
    before = copy.columns(asked, pq.read_table(copy.part(0)).column_names, [0])

    def read() -> Any:
        try:
            return copy.columns(asked, list(before["lqr"]), [0])
        except GrosmcError as error:
            return str(error)

    noticed = 0
    for place in range(0, len(whole), 23):
        copy.part(0).write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        after = read()
        if isinstance(after, str):
            assert after.startswith(f"{copy.part(0)} is damaged")
            noticed += 1
            continue
        for law, columns in before.items():
            for name, values in columns.items():
                assert repr(after[law][name].tolist()) == repr(values.tolist())
    assert noticed > 30


def test_a_part_in_another_compression_is_the_same(copy: Folder, finished: Folder) -> None:
    asked = campaign(pair(), runs=16)
    for index, compression in enumerate(["none", "snappy", "gzip", "brotli"]):
        table = pq.read_table(copy.part(index))
        file = copy.part(index)
        pq.write_table(table, file, compression=compression, row_group_size=3, use_dictionary=False)
    for before, after in zip(*(of.tables(asked, range(4)) for of in (finished, copy)), strict=True):
        for name in before.column_names:
            np.testing.assert_array_equal(after[name].to_numpy(), before[name].to_numpy())


def test_a_part_says_nothing_of_when_and_where(finished: Folder) -> None:
    said = json.loads(pq.read_schema(finished.part(1)).metadata[b"grosmc_mj"])
    assert set(said) == {"schema_version", "campaign", "part", "first", "count", "sha256"}
    assert (said["part"], said["first"], said["count"]) == (1, 4, 4)


ODD = st.sampled_from([0.0, -0.0, float("nan"), -float("nan"), float("inf"), 5e-324])


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.tuples(st.floats() | ODD, st.text(), st.integers(-(2**63), 2**63 - 1)), min_size=1)
)
def test_a_checksum_survives_the_file(rows: list[tuple[float, str, int]]) -> None:
    columns = [[row[i] for row in rows] for i in range(3)]
    kinds = [pa.float64(), pa.string(), pa.int64()]
    table = pa.table({str(i): pa.array(column, kinds[i]) for i, column in enumerate(columns)})
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, row_group_size=2)
    assert checksum(pq.read_table(pa.BufferReader(sink.getvalue())), {}) == checksum(table, {})
