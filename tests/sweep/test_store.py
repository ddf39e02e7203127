"""The folder of a campaign: the same bits from everybody, and one line about any that are not."""

from __future__ import annotations

import errno
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from campaign_cases import (
    DEVIATION,
    LQR,
    begun,
    bits,
    campaign,
    forged,
    kept,
    pair,
    refusal,
    replaced,
    run,
    servo,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from grosmc_mj import cli
from grosmc_mj.executors import make_executor
from grosmc_mj.sweep import store
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.findings import findings, run_campaign
from grosmc_mj.sweep.screening import evaluate
from grosmc_mj.sweep.store import (
    Folder,
    checksum,
    manifest_of,
    open_campaign,
    read_campaign,
    read_manifest,
    run_missing,
    run_shard,
)


@pytest.fixture
def copy(pairs: Folder, tmp_path: Path) -> Folder:
    """Eight servos under two LQRs in two parts, to be broken."""
    return Folder(Path(shutil.copytree(pairs.path, tmp_path / "copy")))


def pair_shard(folder: Folder, index: int, threads: int = 0) -> Any:
    """Run a part of the campaign that most tests are of."""
    bound_to = manifest_of(campaign(pair()))["hash"]
    return run_shard(str(folder.path), campaign(pair()).specification, bound_to, index, threads)


def test_a_part_has_a_row_for_each_run_and_controller(pairs: Folder) -> None:
    declared, table = campaign(pair()), pq.read_table(pairs.part(1))
    assert table["id"].to_pylist() == [4, 5, 6, 7] * 2
    assert table["controller"].to_pylist() == ["lqr"] * 4 + ["stiff"] * 4
    for law in declared.laws:
        stored = pairs.columns(declared, table.column_names, [1])[law]
        rows = evaluate(declared, law, declared.values(range(4, 8)))
        for name in set(stored) - {"id", "controller"}:
            np.testing.assert_array_equal(stored[name], rows[name], err_msg=name)
    units = {field.name: field.metadata[b"unit"] for field in table.schema if field.metadata}
    assert units["deviation"] == units["margin deviation_below"] == b"rad"
    assert (units["max_input"], units["ended"]) == (b"A", b"s")
    # Nothing of when and where.
    noted = json.loads(table.schema.metadata[b"grosmc_mj"])
    assert set(noted) == {"schema_version", "campaign", "part", "first", "count", "sha256"}
    assert (noted["part"], noted["first"], noted["count"]) == (1, 4, 4)


@pytest.mark.parametrize("name", ["batch", pytest.param("processes", marks=pytest.mark.slow)])
def test_every_executor_writes_the_same_bits(name: str, pairs: Folder, tmp_path: Path) -> None:
    declared, advances = campaign(pair()), []
    folder = begun(declared, tmp_path / "folder")
    executor = make_executor(name, workers=None if name == "batch" else 2)
    assert run_missing(declared, folder, executor, print, lambda *now: advances.append(now)) == 0
    assert bits(folder) == bits(pairs)
    assert sum(runs for runs, _ in advances) == 16
    columns = pairs.columns(declared, ["relative"], range(2))
    assert advances[-1][1] == {law: (own["relative"] >= 0).mean() for law, own in columns.items()}


def test_parts_are_the_same_in_any_order_and_with_any_threads(
    pairs: Folder, tmp_path: Path
) -> None:
    folder = begun(campaign(pair()), tmp_path / "again")
    for index, threads in ((1, 1), (0, 3)):
        pair_shard(folder, index, threads)
    assert bits(folder) == bits(pairs)
    assert not list((folder.path / "parts").glob(".*"))


def test_only_missing_parts_are_run(copy: Folder, pairs: Folder) -> None:
    copy.part(0).unlink()
    (copy.path / "parts" / ".part-0000000.0123456789abcdef.part.parquet").write_bytes(b"half")
    (copy.path / "parts" / ".other.parquet").touch()
    untouched = copy.part(1).stat().st_mtime_ns
    run_campaign(campaign(pair()), copy.path, resume=True)
    assert [file.name for file in (copy.path / "parts").glob(".*")] == [".other.parquet"]
    assert bits(copy) == bits(pairs)
    assert copy.part(1).stat().st_mtime_ns == untouched


def test_other_versions_read_a_complete_campaign_and_add_nothing_to_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    declared = campaign(pair(), runs=5)
    folder = kept(declared, tmp_path / "campaign")
    now = store.versions
    monkeypatch.setattr(store, "versions", lambda names: {**now(names), "scipy": "0.1"})
    (line,) = folder.begin(declared, resume=True)
    _, (also,) = read_campaign(folder.path)
    assert "versions.scipy: " in line
    assert also.endswith("there, 0.1 now: bits may differ")
    assert findings(declared, folder).sampled.words == "5 runs, random, seed 0"
    # The last part is short.
    folder.part(1).unlink()
    assert findings(declared, folder).sampled.words == "4 of 5 runs, random, seed 0"
    assert "install those to go on" in refusal(folder.begin, declared, resume=True)
    bound_to = read_manifest(folder.path)["hash"]
    # A worker, which has not opened the campaign yet.
    other = shutil.copytree(folder.path, tmp_path / "other")
    adds = refusal(run_shard, str(other), declared.specification, bound_to, 1)
    assert "was begun with other versions: versions.scipy: " in adds


def test_a_full_disk_keeps_finished_parts(
    copy: Folder, pairs: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    copy.part(1).unlink()
    monkeypatch.setattr(os, "fsync", full)
    assert refusal(pair_shard, copy, 1).startswith(
        f"cannot write {copy.part(1)}: No space left on device"
    )
    assert [file.name for file in (copy.path / "parts").iterdir()] == [copy.part(0).name]
    assert bits(copy) == bits(pairs)[:1]


@pytest.mark.parametrize(
    ("changed", "difference"),
    [
        ({"runs": 9}, "runs: 8 there, 9 now"),
        ({"sampler": "lhs", "seed": 1}, "seed: 0 there, 1 now; sampler: random there, lhs now"),
        ({"controllers": ("lqr",)}, "controllers 2: stiff there, nothing now"),
    ],
)
def test_another_campaign_in_the_folder_is_refused_with_the_difference(
    pairs: Folder, changed: dict[str, Any], difference: str
) -> None:
    other = Campaign.of(replace(campaign(pair()).specification, **changed))
    for resume in (False, True):
        line = refusal(pairs.begin, other, resume=resume)
        assert difference in line
        assert line.endswith("take another --out")


def test_folders_that_a_campaign_cannot_be_begun_in(copy: Folder, tmp_path: Path) -> None:
    declared = campaign(pair())
    assert "--resume runs what is missing" in refusal(copy.begin, declared, resume=False)
    (copy.path / "manifest.json").unlink()
    assert "parts without a manifest.json" in refusal(copy.begin, declared, resume=False)
    assert "is no campaign" in refusal(pair_shard, copy, 0)
    way = tmp_path / "file"
    way.touch()
    for path in (way, way / "below"):
        assert refusal(begun, declared, path).startswith(f"cannot write {path}")
    assert "has no runs yet" in refusal(findings, declared, begun(declared, tmp_path / "empty"))


def test_another_campaign_under_the_same_name_is_not_taken_for_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "campaign"
    kept(campaign(pair(), runs=2), path)
    shutil.rmtree(path)
    declared = campaign(pair(), runs=2, seed=1)
    folder = kept(declared, path)
    bound_to = read_manifest(path)["hash"]
    assert open_campaign(str(path), declared.specification, bound_to).specification.seed == 1
    before = campaign(pair(), runs=2)
    line = refusal(open_campaign, str(path), before.specification, bound_to)
    assert "was begun with something else: seed: 1 there, 0 now" in line
    line = refusal(open_campaign, str(path), before.specification, manifest_of(before)["hash"])
    assert "has another campaign than the one" in line
    stored = folder.columns(declared, ["rotor mass scale"], [0])["lqr"]["rotor mass scale"]
    assert np.array_equal(stored, declared.values(range(2))[:, 0])


# Manifests and parts that are damaged or forged.


def changed_manifest(folder: Folder, **content: Any) -> None:
    path = folder.path / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **content}))


@pytest.mark.parametrize(
    "content",
    [b"{", b"[1]", b"[" * 3000, b"\xff", {"model": "0"}, {"sources": None}, {"question": "servo"},
     {"schema_version": 2, "hash": "0"}],
)  # fmt: skip
def test_a_manifest_that_is_not_ours(copy: Folder, content: bytes | dict[str, Any]) -> None:
    path = copy.path / "manifest.json"
    path.write_bytes(content) if isinstance(content, bytes) else changed_manifest(copy, **content)
    line = refusal(read_campaign, copy.path)
    assert line.startswith(f"{path} is damaged, or of another version")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"text": 3}, "text = 3"),
        ({"name": "../up"}, "'../up' must be a name for files"),
        ({"runs": 8.0}, "runs = 8 must be a whole number"),
        ({"runs": 10**4000}, "must be a whole number from 1 to"),
        ({"controllers": [["lqr"]]}, "controllers.0"),
        ({"colour": "red"}, "there is no argument colour"),
    ],
)
def test_a_question_that_is_none(copy: Folder, content: dict[str, Any], words: str) -> None:
    changed_manifest(copy, question={**read_manifest(copy.path)["question"], **content})
    assert words in refusal(read_campaign, copy.path)


def exchanged(table: pa.Table) -> pa.Table:
    """The outcomes of two runs under each other's number."""
    other = table.take([1, 0, *range(2, 8)])
    return other.set_column(0, other.field("id"), table["id"])


def flipped(table: pa.Table) -> pa.Table:
    """The lowest bit of one margin."""
    return replaced(table, "relative", 3, np.nextafter(table["relative"][3].as_py(), 9))


def halved(table: pa.Table) -> pa.Table:
    """Margins of half the precision."""
    place = table.column_names.index("relative")
    return table.set_column(place, "relative", table["relative"].cast(pa.float32()))


def in_degrees(table: pa.Table) -> pa.Table:
    place = table.column_names.index("deviation")
    field = table.field("deviation").with_metadata({"unit": "deg"})
    return table.set_column(place, field, table["deviation"])


@pytest.mark.parametrize(
    "change",
    [
        lambda table: table.take([4, 5, 6, 7, 0, 1, 2, 3]),
        exchanged, flipped, halved, in_degrees,
        lambda table: table.append_column("more", table["id"]),
        lambda table: table.slice(0, 5),
        lambda table: pa.concat_tables([table] * 2),
        # A margin that is not there, which counts would take for one that is not kept.
        lambda table: replaced(table, "relative", 0, None),
        lambda table: table.replace_schema_metadata({}),
        lambda table: table.replace_schema_metadata({b"grosmc_mj": b"[]"}),
    ],
)  # fmt: skip
def test_rows_that_are_not_those_that_were_written(
    copy: Folder, change: Callable[[pa.Table], pa.Table]
) -> None:
    pq.write_table(change(pq.read_table(copy.part(1))), copy.part(1))
    refused(copy, 1)


def refused(folder: Folder, index: int) -> None:
    """Reading and resuming refuse a part by its name."""
    declared = campaign(pair())
    for use in (lambda: folder.begin(declared, resume=True), lambda: findings(declared, folder)):
        assert refusal(use) == (
            f"{folder.part(index)} is damaged, or is not part {index} of this campaign: remove it, "
            "and --resume runs it again"
        )


def test_a_part_of_another_seed_or_place_or_none(copy: Folder, tmp_path: Path) -> None:
    other = kept(campaign(pair(), seed=1), tmp_path / "other")
    shutil.copy(other.part(1), copy.part(1))
    refused(copy, 1)
    shutil.copy(copy.part(0), copy.part(1))
    refused(copy, 1)
    forged(copy.part(1), pq.read_table(copy.part(0)), part=1)
    refused(copy, 1)
    copy.part(1).write_bytes(copy.part(0).read_bytes()[:-20])
    refused(copy, 1)
    copy.part(1).unlink()
    copy.part(1).mkdir()
    refused(copy, 1)


def test_a_part_in_another_compression_is_the_same(copy: Folder, pairs: Folder) -> None:
    for index, compression in enumerate(["none", "gzip"]):
        table, file = pq.read_table(copy.part(index)), copy.part(index)
        pq.write_table(table, file, compression=compression, row_group_size=3, use_dictionary=False)
    both = zip(*(of.tables(campaign(pair()), range(2)) for of in (pairs, copy)), strict=True)
    for before, after in both:
        for name in before.column_names:
            np.testing.assert_array_equal(after[name].to_numpy(), before[name].to_numpy())


ODD = st.sampled_from([0.0, -0.0, float("nan"), -float("nan"), float("inf"), 5e-324])


@settings(max_examples=15)
@given(
    st.lists(st.tuples(st.floats() | ODD, st.text(), st.integers(-(2**63), 2**63 - 1)), min_size=1)
)
def test_a_checksum_survives_the_file(rows: list[tuple[float, str, int]]) -> None:
    columns, kinds = zip(*rows, strict=True), (pa.float64(), pa.string(), pa.int64())
    arrays = [pa.array(column, kind) for column, kind in zip(columns, kinds, strict=True)]
    table, sink = pa.table(dict(zip("abc", arrays, strict=True))), pa.BufferOutputStream()
    pq.write_table(table, sink, row_group_size=2)
    assert checksum(pq.read_table(pa.BufferReader(sink.getvalue())), {}) == checksum(table, {})


# A campaign that is killed goes on as if nothing had been.

PARTS = 4
# The command line, which never ends its last part: parts are synchronised before they are whole.
HELD = f"""
import os, pathlib, sys, time
from grosmc_mj import cli
parts, sync = pathlib.Path(sys.argv[1], "parts"), os.fsync
def held(file):
    while len(list(parts.glob("part-*"))) == {PARTS - 1}:
        time.sleep(0.01)
    sync(file)
os.fsync = held
cli.main(sys.argv[2:])
"""


@pytest.mark.slow
def test_a_killed_campaign_goes_on_as_if_nothing_had_been(tmp_path: Path) -> None:
    file, out, whole = tmp_path / "small.toml", tmp_path / "killed", tmp_path / "whole"
    file.write_text(servo(laws=LQR, limits=DEVIATION))
    words = ["campaign", str(file), "--runs", "64", "--shard", "16", "--no-figures", "--out"]
    with subprocess.Popen(
        [sys.executable, "-c", HELD, str(out), *words, str(out)],
        stdout=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    ) as process:
        deadline = time.monotonic() + 120
        while len(list((out / "parts").glob("part-*"))) < 2 and process.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        time.sleep(random.uniform(0, 0.1))
        process.send_signal(signal.SIGKILL)
    assert 2 <= len(list((out / "parts").glob("part-*"))) < PARTS
    assert not (out / "results.json").exists()
    assert run(*words, out, "--resume") == run(*words, whole) == cli.DONE
    for part in (whole / "parts").iterdir():
        assert (out / "parts" / part.name).read_bytes() == part.read_bytes()
    both = [json.loads((folder / "results.json").read_text()) for folder in (out, whole)]
    assert all(results.pop("command") for results in both)
    assert both[0] == both[1]
