"""Folder of a campaign: the same bits from everybody, and one line about any that are not."""

from __future__ import annotations

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
from campaigns import (
    LOOP,
    MASS,
    begun,
    bits,
    campaign,
    kept,
    pair,
    part,
    refusal,
    uncertain,
)
from commands import Patch

from grosmc_mj.ground.executors import make_executor
from grosmc_mj.studies.campaign import manifest
from grosmc_mj.studies.campaign.batch import evaluate
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.findings import findings, run_campaign
from grosmc_mj.studies.campaign.folder import Folder
from grosmc_mj.studies.campaign.manifest import manifest_of, read_manifest
from grosmc_mj.studies.campaign.opening import open_campaign, read_campaign
from grosmc_mj.studies.campaign.parts import checksum
from grosmc_mj.studies.campaign.work import run_missing, run_part


def copied(folder: Path, to: Path) -> Folder:
    """A copy of a campaign's folder, to be broken."""
    return Folder(Path(shutil.copytree(folder, to / "copy")))


@pytest.fixture
def copy(pairs: Folder, tmp_path: Path) -> Folder:
    """Eight servos under two LQRs in two parts, to be broken."""
    return copied(pairs.path, tmp_path)


@pytest.fixture
def empty(tmp_path: Path) -> Folder:
    """The manifest of eight servos, of which none has been run."""
    return begun(campaign(pair()), tmp_path / "folder")


def run_pair(folder: Folder, index: int, threads: int = 0) -> Any:
    """Run a part of the campaign of eight servos."""
    bound_to = manifest_of(campaign(pair()))["hash"]
    return run_part(str(folder.path), campaign(pair()).specification, bound_to, index, threads)


# What a part holds.


@pytest.fixture(scope="module")
def rows(pairs: Folder) -> pa.Table:
    """The second part of eight servos."""
    return pq.read_table(pairs.part(1))


def test_a_part_has_a_row_for_each_run_under_each_controller(rows: pa.Table) -> None:
    assert rows["id"].to_pylist() == [4, 5, 6, 7] * 2
    assert rows["controller"].to_pylist() == ["lqr"] * 4 + ["stiff"] * 4


@pytest.mark.parametrize("law", ["lqr", "stiff"])
def test_a_part_has_the_columns_of_its_runs(law: str, rows: pa.Table, pairs: Folder) -> None:
    declared = campaign(pair())
    stored = pairs.columns(declared, rows.column_names, [1])[law]
    values = declared.values(range(4, 8))
    expected = {
        **evaluate(declared, law, values).columns,
        **dict(zip(declared.family.names, values.T, strict=True)),
        # No run of so few is screened.
        "judged_by": ["physics"] * 4,
        "screened": [np.nan] * 4,
        **dict.fromkeys(("overturned", "drawn", "band"), [0] * 4),
    }
    names = sorted(set(stored) - {"id", "controller"})
    np.testing.assert_equal([stored[name] for name in names], [expected[name] for name in names])


def test_columns_of_a_part_have_units(rows: pa.Table) -> None:
    units = {field.name: field.metadata[b"unit"] for field in rows.schema if field.metadata}
    assert units["deviation"] == units["margin deviation_below"] == b"rad"
    assert (units["max_input"], units["ended"]) == (b"A", b"s")


def test_notes_of_a_part_number_its_runs_and_do_not_tell_its_origin(rows: pa.Table) -> None:
    """Neither the time nor the machine."""
    notes = json.loads(rows.schema.metadata[b"grosmc_mj"])
    assert set(notes) == {"schema_version", "campaign", "part", "first", "count", "sha256"}
    assert (notes["part"], notes["first"], notes["count"]) == (1, 4, 4)


ENCODER = {"of": "rotor angle", "resolution": "0.1 mrad"}
NOISELESS = {**LOOP, "computing": {"delay": "1 ms"}, "sensor": ENCODER}
NOISE = uncertain("sensor.rotor angle.noise", "0 mrad", "0.3 mrad")


@pytest.mark.parametrize(
    ("number", "loop", "random"),
    [(MASS, {}, False), (MASS, NOISELESS, False), (MASS, LOOP, True), (NOISE, NOISELESS, True)],
)
def test_a_manifest_tells_whether_runs_draw_random_numbers(
    number: dict[str, Any], loop: dict[str, Any], random: bool
) -> None:
    assert manifest_of(campaign(part(number, **loop)))["random"] is random


# The same bits from everybody.


@pytest.mark.parametrize("name", ["batch", pytest.param("processes", marks=pytest.mark.slow)])
def test_bits_are_the_same_whoever_runs_them(name: str, empty: Folder, pairs: Folder) -> None:
    executor = make_executor(name)
    assert run_missing(campaign(pair()), empty, executor, print, lambda *_: None) == 0
    assert bits(empty) == bits(pairs)
    assert not list((empty.path / "parts").glob(".*"))


@pytest.mark.parametrize("threads", [1, 3])
def test_bits_are_the_same_in_any_order_with_any_number_of_threads(
    threads: int, empty: Folder, pairs: Folder
) -> None:
    run_pair(empty, 1, threads)
    assert bits(empty) == bits(pairs)[1:]
    run_pair(empty, 0, threads)
    assert bits(empty) == bits(pairs)


def test_progress_counts_runs_and_tells_the_share_that_keeps_everything(
    empty: Folder, pairs: Folder
) -> None:
    steps: list[tuple[int, dict[str, float]]] = []
    executor = make_executor("batch")
    run_missing(campaign(pair()), empty, executor, print, lambda *step: steps.append(step))
    columns = pairs.columns(campaign(pair()), ["relative"], range(2))
    assert sum(runs for runs, _ in steps) == 16
    _, shares = steps[-1]
    assert shares == {law: (rows["relative"] >= 0).mean() for law, rows in columns.items()}


# Going on.


def test_only_missing_parts_are_run(copy: Folder, pairs: Folder) -> None:
    copy.part(0).unlink()
    untouched = copy.part(1).stat().st_mtime_ns
    run_campaign(campaign(pair()), copy.path, resume=True)
    assert bits(copy) == bits(pairs)
    assert copy.part(1).stat().st_mtime_ns == untouched


def test_files_of_unfinished_parts_are_removed(copy: Folder) -> None:
    parts = copy.path / "parts"
    (parts / ".part-0000000.0123456789abcdef.part.parquet").write_bytes(b"half")
    (parts / ".other.parquet").touch()
    run_campaign(campaign(pair()), copy.path, resume=True)
    assert [file.name for file in parts.glob(".*")] == [".other.parquet"]


def test_a_full_disk_keeps_finished_parts(copy: Folder, pairs: Folder, monkeypatch: Patch) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    copy.part(1).unlink()
    monkeypatch.setattr(os, "fsync", full)
    line = refusal(run_pair, copy, 1)
    assert line.startswith(f"cannot write {copy.part(1)}: No space left on device")
    assert [file.name for file in (copy.path / "parts").glob("*part*")] == [copy.part(0).name]
    assert bits(copy) == bits(pairs)[:1]


# Other versions.


def five() -> Campaign:
    """Five servos under two LQRs: the last part is short."""
    return campaign(pair(), runs=5)


@pytest.fixture(scope="module")
def fives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of five servos."""
    return kept(five(), tmp_path_factory.mktemp("five") / "campaign").path


@pytest.fixture
def other_scipy(fives: Path, tmp_path: Path, monkeypatch: Patch) -> Folder:
    """The folder of five servos, read with another version of SciPy."""
    versions = manifest.versions
    monkeypatch.setattr(manifest, "versions", lambda names: {**versions(names), "scipy": "0.1"})
    return copied(fives, tmp_path)


def test_other_versions_are_told_and_read_all_runs(other_scipy: Folder) -> None:
    (line,) = other_scipy.begin(five(), resume=True)
    assert "versions.scipy: " in line
    _, (line,) = read_campaign(other_scipy.path)
    assert line.endswith("there, 0.1 now: bits may differ")
    assert findings(five(), other_scipy).sampled.words == "5 runs, random, seed 0"


def test_other_versions_add_nothing(other_scipy: Folder) -> None:
    other_scipy.part(1).unlink()
    assert findings(five(), other_scipy).sampled.words == "4 of 5 runs, random, seed 0"
    assert "install those to go on" in refusal(other_scipy.begin, five(), resume=True)
    # A worker, which has not opened the campaign yet.
    bound_to = read_manifest(other_scipy.path)["hash"]
    line = refusal(run_part, str(other_scipy.path), five().specification, bound_to, 1)
    assert "was begun with other versions: versions.scipy: " in line


# Other campaigns, and folders that are none.


@pytest.mark.parametrize("resume", [False, True])
@pytest.mark.parametrize(
    ("changed", "difference"),
    [
        ({"runs": 9}, "runs: 8 there, 9 now"),
        (
            {"sampler": "corners", "runs": 4, "seed": 1},
            "runs: 8 there, 4 now; seed: 0 there, 1 now; sampler: random there, corners now",
        ),
        ({"controllers": ("lqr",)}, "controllers 2: stiff there, nothing now"),
    ],
)
def test_another_campaign_in_the_folder_is_refused(
    changed: dict[str, Any], difference: str, resume: bool, copy: Folder
) -> None:
    other = Campaign.of(replace(campaign(pair()).specification, **changed))
    line = refusal(copy.begin, other, resume=resume)
    assert difference in line
    assert line.endswith("take another --out")


@pytest.mark.parametrize(
    ("seed", "more", "words"),
    [
        (1, "", "was begun with something else: seed: 0 there, 1 now"),
        (0, "0", "has another campaign than the one"),
    ],
)
def test_a_worker_refuses_another_specification_or_manifest(
    seed: int, more: str, words: str, pairs: Folder
) -> None:
    bound_to = read_manifest(pairs.path)["hash"] + more
    specification = campaign(pair(), seed=seed).specification
    assert words in refusal(open_campaign, str(pairs.path), specification, bound_to)


def test_a_campaign_that_is_there_must_be_resumed(pairs: Folder) -> None:
    line = refusal(pairs.begin, campaign(pair()), resume=False)
    assert "--resume runs what is missing" in line


def test_parts_without_a_manifest_are_refused(copy: Folder) -> None:
    (copy.path / "manifest.json").unlink()
    line = refusal(copy.begin, campaign(pair()), resume=False)
    assert "parts without a manifest.json" in line
    assert "is no campaign" in refusal(run_pair, copy, 0)


def test_a_folder_without_runs_has_no_findings(empty: Folder) -> None:
    assert "has no runs yet" in refusal(findings, campaign(pair()), empty)


@pytest.mark.parametrize("name", ["file", "file/below"])
def test_a_file_is_no_folder(name: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    path = tmp_path / name
    assert refusal(begun, campaign(pair()), path).startswith(f"cannot write {path}")


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
    path = copy.path / "manifest.json"
    manifest = read_manifest(copy.path)
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content.keys() & manifest:
        path.write_text(json.dumps(manifest | content))
    else:
        manifest["question"] |= content
        path.write_text(json.dumps(manifest))
    assert words in refusal(read_campaign, copy.path)


# Damaged parts: each function damages the second one.


def forged(file: Path, table: pa.Table, **changed: Any) -> None:
    """Write other rows as a part, with a checksum that is theirs."""
    notes = json.loads(pq.read_schema(file).metadata[b"grosmc_mj"]) | changed
    del notes["sha256"]
    notes["sha256"] = checksum(table, notes)
    pq.write_table(table.replace_schema_metadata({b"grosmc_mj": json.dumps(notes)}), file)


def put_another_part_there(copy: Folder) -> None:
    """With a checksum that is its own."""
    shutil.copy(copy.part(0), copy.part(1))
    forged(copy.part(1), pq.read_table(copy.part(0)), part=1)


def put_a_folder_there(copy: Folder) -> None:
    copy.part(1).unlink()
    copy.part(1).mkdir()


def swap_two_runs(copy: Folder) -> None:
    table = pq.read_table(copy.part(1))
    swapped = table.take([1, 0, *range(2, 8)])
    pq.write_table(swapped.set_column(0, table.field("id"), table["id"]), copy.part(1))


def change_a_bit(copy: Folder) -> None:
    """The lowest one of a margin."""
    table = pq.read_table(copy.part(1))
    margins = table["relative"].to_numpy().copy()
    margins[3] = np.nextafter(margins[3], 9)
    place = table.column_names.index("relative")
    changed = table.set_column(place, table.field("relative"), pa.array(margins))
    pq.write_table(changed, copy.part(1))


def change_a_unit(copy: Folder) -> None:
    table = pq.read_table(copy.part(1))
    degrees = pa.field("deviation", pa.float64(), metadata={"unit": "deg"})
    place = table.column_names.index("deviation")
    pq.write_table(table.set_column(place, degrees, table["deviation"]), copy.part(1))


def drop_notes(copy: Folder) -> None:
    table = pq.read_table(copy.part(1))
    pq.write_table(table.replace_schema_metadata({}), copy.part(1))


def change_the_campaign(copy: Folder) -> None:
    forged(copy.part(1), pq.read_table(copy.part(1)), campaign="0" * 64)


def cut_off_the_end(copy: Folder) -> None:
    copy.part(1).write_bytes(copy.part(0).read_bytes()[:-20])


@pytest.mark.parametrize(
    "damage",
    [
        put_another_part_there,
        put_a_folder_there,
        swap_two_runs,
        change_a_bit,
        change_a_unit,
        drop_notes,
        change_the_campaign,
        cut_off_the_end,
    ],
)
def test_a_part_that_was_not_written_so_is_refused(
    copy: Folder, damage: Callable[[Folder], None]
) -> None:
    damage(copy)
    line = (
        f"{copy.part(1)} is damaged, or is not part 1 of this campaign: remove it, "
        "and --resume runs it again"
    )
    assert refusal(copy.begin, campaign(pair()), resume=True) == line
    assert refusal(findings, campaign(pair()), copy) == line


ANY_NUMBERS = pa.table({"x": [0.0, -0.0, float("nan"), float("inf"), 5e-324], "y": list("aßb\n ")})


def test_a_checksum_survives_another_compression(tmp_path: Path) -> None:
    pq.write_table(ANY_NUMBERS, tmp_path / "x", compression="gzip", row_group_size=2)
    assert checksum(pq.read_table(tmp_path / "x"), {}) == checksum(ANY_NUMBERS, {})


def test_a_checksum_tells_signed_zeros_apart() -> None:
    changed = ANY_NUMBERS.take([1, 1, 2, 3, 4])
    assert checksum(changed, {}) != checksum(ANY_NUMBERS, {})
