"""The folder of a campaign: the same bits from everybody, and one line about any that are not."""

import errno
import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from campaign_cases import begun, bits, campaign, forged, kept, pair, refusal, replaced
from commands import Patch

from grosmc_mj.executors import make_executor
from grosmc_mj.sweep import store
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.findings import findings, run_campaign
from grosmc_mj.sweep.screening import evaluate
from grosmc_mj.sweep.store import Folder, manifest_of, read_campaign, read_manifest, run_shard


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
def test_bits_are_the_same_whoever_runs_them(name: str, pairs: Folder, tmp_path: Path) -> None:
    declared, advances = campaign(pair()), []
    folder, again = (begun(declared, tmp_path / name) for name in ("folder", "again"))
    executor, advance = make_executor(name), lambda *now: advances.append(now)
    assert store.run_missing(declared, folder, executor, print, advance) == 0
    assert sum(runs for runs, _ in advances) == 16
    columns = pairs.columns(declared, ["relative"], range(2))
    assert advances[-1][1] == {law: (own["relative"] >= 0).mean() for law, own in columns.items()}
    for index, threads in ((1, 1), (0, 3)):
        pair_shard(again, index, threads)
    assert bits(again) == bits(folder) == bits(pairs)
    assert not list((again.path / "parts").glob(".*"))


def test_only_missing_parts_are_run(copy: Folder, pairs: Folder, monkeypatch: Patch) -> None:
    copy.part(0).unlink()
    (copy.path / "parts" / ".part-0000000.0123456789abcdef.part.parquet").write_bytes(b"half")
    (copy.path / "parts" / ".other.parquet").touch()
    untouched = copy.part(1).stat().st_mtime_ns
    run_campaign(campaign(pair()), copy.path, resume=True)
    assert [file.name for file in (copy.path / "parts").glob(".*")] == [".other.parquet"]
    assert bits(copy) == bits(pairs)
    assert copy.part(1).stat().st_mtime_ns == untouched

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    # A full disk keeps finished parts.
    copy.part(1).unlink()
    monkeypatch.setattr(os, "fsync", full)
    line = refusal(pair_shard, copy, 1)
    assert line.startswith(f"cannot write {copy.part(1)}: No space left on device")
    assert [file.name for file in (copy.path / "parts").glob("*part*")] == [copy.part(0).name]
    assert bits(copy) == bits(pairs)[:1]


def test_other_versions_read_but_add_nothing(tmp_path: Path, monkeypatch: Patch) -> None:
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
    # A worker, which has not opened the campaign yet.
    other, bound_to = shutil.copytree(folder.path, tmp_path / "b"), read_manifest(folder.path)
    adds = refusal(run_shard, str(other), declared.specification, bound_to["hash"], 1)
    assert "was begun with other versions: versions.scipy: " in adds


def test_another_campaign_in_the_folder_is_refused(copy: Folder, tmp_path: Path) -> None:
    declared = campaign(pair())
    for changed, difference in (
        ({"runs": 9}, "runs: 8 there, 9 now"),
        (
            {"sampler": "corners", "runs": 4, "seed": 1},
            "runs: 8 there, 4 now; seed: 0 there, 1 now; sampler: random there, corners now",
        ),
        ({"controllers": ("lqr",)}, "controllers 2: stiff there, nothing now"),
    ):
        other = Campaign.of(replace(declared.specification, **changed))
        for resume in (False, True):
            line = refusal(copy.begin, other, resume=resume)
            assert difference in line
            assert line.endswith("take another --out")
    path, bound_to = str(copy.path), read_manifest(copy.path)["hash"]
    other = campaign(pair(), seed=1).specification
    line = refusal(store.open_campaign, path, other, bound_to)
    assert "was begun with something else: seed: 0 there, 1 now" in line
    line = refusal(store.open_campaign, path, declared.specification, f"{bound_to}0")
    assert "has another campaign than the one" in line
    assert "--resume runs what is missing" in refusal(copy.begin, declared, resume=False)
    (copy.path / "manifest.json").unlink()
    assert "parts without a manifest.json" in refusal(copy.begin, declared, resume=False)
    assert "is no campaign" in refusal(pair_shard, copy, 0)
    assert "has no runs yet" in refusal(findings, declared, begun(declared, tmp_path / "empty"))
    file = tmp_path / "file"
    file.touch()
    for path in (file, file / "below"):
        assert refusal(begun, declared, path).startswith(f"cannot write {path}")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"[" * 3000, "is damaged, or of another version"),
        (b"\xff", "is damaged, or of another version"),
        ({"schema_version": 2, "hash": "0"}, "is damaged, or of another version"),
        ({"sources": None}, "is damaged, or of another version"),
        ({"text": 3}, "text = 3"),
        ({"name": "../up"}, "'../up' must be a name for files"),
        ({"runs": 10**4000}, "must be a whole number from 1 to"),
        ({"controllers": [["lqr"]]}, "controllers.0"),
        ({"colour": "red"}, "there is no argument colour"),
        ({"sampler": "sobol"}, "copy: unknown sampler 'sobol': valid: random, corners; run the"),
    ],
)
def test_a_manifest_of_others(copy: Folder, content: bytes | dict[str, Any], words: str) -> None:
    path, manifest = copy.path / "manifest.json", read_manifest(copy.path)
    if isinstance(content, dict):
        question = {**manifest["question"], **content}
        own = content if content.keys() & manifest else {"question": question}
        content = json.dumps({**manifest, **own}).encode()
    path.write_bytes(content)
    assert words in refusal(read_campaign, copy.path)


def written(change: Callable[[pa.Table], pa.Table]) -> Callable[[Folder], None]:
    """Other rows, with the notes of the right ones."""
    return lambda copy: pq.write_table(change(pq.read_table(copy.part(1))), copy.part(1))


def forged_place(copy: Folder) -> None:
    """The first part under the second one's number, with a checksum that is its own."""
    shutil.copy(copy.part(0), copy.part(1))
    forged(copy.part(1), pq.read_table(copy.part(0)), part=1)


def no_file(copy: Folder) -> None:
    copy.part(1).unlink()
    copy.part(1).mkdir()


DEGREES = pa.field("deviation", pa.float64(), metadata={"unit": "deg"})


@pytest.mark.parametrize(
    "damage",
    [
        forged_place, no_file,
        # Two runs under each other's number, the lowest bit of one margin, another unit.
        written(lambda t: t.take([1, 0, *range(2, 8)]).set_column(0, t.field("id"), t["id"])),
        written(lambda t: replaced(t, "relative", 3, np.nextafter(t["relative"][3].as_py(), 9))),
        written(lambda t: t.set_column(t.column_names.index("deviation"), DEGREES, t["deviation"])),
        written(lambda table: table.replace_schema_metadata({})),
        lambda copy: forged(copy.part(1), pq.read_table(copy.part(1)), campaign="0" * 64),
        lambda copy: copy.part(1).write_bytes(copy.part(0).read_bytes()[:-20]),
    ],
)  # fmt: skip
def test_a_part_that_was_not_written_so(copy: Folder, damage: Callable[[Folder], object]) -> None:
    declared = campaign(pair())
    damage(copy)
    for use in (lambda: copy.begin(declared, resume=True), lambda: findings(declared, copy)):
        assert refusal(use) == (
            f"{copy.part(1)} is damaged, or is not part 1 of this campaign: remove it, "
            "and --resume runs it again"
        )


def test_a_checksum_survives_another_compression_whatever_the_numbers(copy: Folder) -> None:
    table = pa.table({"x": [0.0, -0.0, float("nan"), float("inf"), 5e-324], "y": list("aßb\n ")})
    pq.write_table(table, copy.part(0), compression="gzip", row_group_size=2)
    assert store.checksum(pq.read_table(copy.part(0)), {}) == store.checksum(table, {})
    assert store.checksum(table.take([1, 1, 2, 3, 4]), {}) != store.checksum(table, {})
