"""Folder of a campaign: the same bits from everybody, and one line about any that are not."""

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
from campaign_cases import (
    INERTIA,
    LOOP,
    LQR,
    begun,
    bits,
    campaign,
    forged,
    kept,
    of,
    pair,
    refusal,
    replaced,
    standing,
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


@pytest.fixture
def copy(pairs: Folder, tmp_path: Path) -> Folder:
    """Eight servos under two LQRs in two parts, to be broken."""
    return Folder(Path(shutil.copytree(pairs.path, tmp_path / "copy")))


def pair_shard(folder: Folder, index: int, threads: int = 0) -> Any:
    """Run a part of the campaign of eight servos."""
    bound_to = manifest_of(campaign(pair()))["hash"]
    return run_part(str(folder.path), campaign(pair()).specification, bound_to, index, threads)


@pytest.fixture(scope="module")
def part(pairs: Folder) -> pa.Table:
    """The second part of eight servos."""
    return pq.read_table(pairs.part(1))


def test_a_part_has_a_row_for_each_run_under_each_controller(part: pa.Table) -> None:
    assert part["id"].to_pylist() == [4, 5, 6, 7] * 2
    assert part["controller"].to_pylist() == ["lqr"] * 4 + ["stiff"] * 4


@pytest.mark.parametrize("law", ["lqr", "stiff"])
def test_a_part_has_the_columns_of_its_runs(law: str, part: pa.Table, pairs: Folder) -> None:
    declared = campaign(pair())
    stored = pairs.columns(declared, part.column_names, [1])[law]
    values = declared.values(range(4, 8))
    rows = {
        **evaluate(declared, law, values).columns,
        **dict(zip(declared.family.names, values.T, strict=True)),
        # No run of so few is screened.
        "judged_by": ["physics"] * 4,
        "screened": [np.nan] * 4,
        "overturned": [0] * 4,
        "drawn": [0] * 4,
        "band": [0.0] * 4,
    }
    for name in set(stored) - {"id", "controller"}:
        np.testing.assert_array_equal(stored[name], rows[name], err_msg=name)


def test_columns_of_a_part_have_units(part: pa.Table) -> None:
    units = {field.name: field.metadata[b"unit"] for field in part.schema if field.metadata}
    assert units["deviation"] == units["margin deviation_below"] == b"rad"
    assert (units["max_input"], units["ended"]) == (b"A", b"s")


@pytest.fixture
def notes(part: pa.Table) -> dict[str, Any]:
    """The notes of the second part of eight servos."""
    return json.loads(part.schema.metadata[b"grosmc_mj"])


def test_notes_of_a_part_do_not_tell_its_origin(notes: dict[str, Any]) -> None:
    """Neither the time nor the machine."""
    assert set(notes) == {"schema_version", "campaign", "part", "first", "count", "sha256"}


NOISELESS = LOOP.replace('noise = "0.1 mrad"\n', "").replace("missed = 0.05\n", "")
SOME_NOISE = of("sensor", "rotor angle", 'noise = ["0 mrad", "0.3 mrad"]')


@pytest.mark.parametrize(
    ("tables", "loop", "random"),
    [
        (INERTIA, LQR, False),
        (INERTIA, NOISELESS, False),
        (INERTIA, LOOP, True),
        (SOME_NOISE, NOISELESS, True),
    ],
)
def test_a_manifest_tells_whether_runs_draw_random_numbers(
    tables: str, loop: str, random: bool
) -> None:
    manifest = manifest_of(campaign(standing(tables, loop)))
    assert manifest["random"] is random


def test_notes_of_a_part_number_its_runs(notes: dict[str, Any]) -> None:
    assert (notes["part"], notes["first"], notes["count"]) == (1, 4, 4)


@pytest.mark.parametrize("name", ["batch", pytest.param("processes", marks=pytest.mark.slow)])
def test_bits_are_the_same_whoever_runs_them(name: str, pairs: Folder, tmp_path: Path) -> None:
    folder = begun(campaign(pair()), tmp_path / "folder")
    executor = make_executor(name)
    assert run_missing(campaign(pair()), folder, executor, print, lambda *_: None) == 0
    assert bits(folder) == bits(pairs)
    assert not list((folder.path / "parts").glob(".*"))


def test_bits_are_the_same_in_any_order(pairs: Folder, tmp_path: Path) -> None:
    folder = begun(campaign(pair()), tmp_path / "folder")
    pair_shard(folder, 1)
    pair_shard(folder, 0)
    assert bits(folder) == bits(pairs)


@pytest.mark.parametrize(("index", "threads"), [(1, 1), (0, 3)])
def test_bits_are_the_same_with_any_number_of_threads(
    index: int, threads: int, pairs: Folder, tmp_path: Path
) -> None:
    folder = begun(campaign(pair()), tmp_path / "folder")
    pair_shard(folder, index, threads=threads)
    assert bits(folder) == [bits(pairs)[index]]
    assert not list((folder.path / "parts").glob(".*"))


Steps = list[tuple[int, dict[str, float]]]


@pytest.fixture(scope="module")
def steps(tmp_path_factory: pytest.TempPathFactory) -> Steps:
    """The progress of eight servos under two LQRs: runs and shares."""
    declared = campaign(pair())
    folder = begun(declared, tmp_path_factory.mktemp("progress") / "folder")
    steps: Steps = []
    executor = make_executor("batch")
    run_missing(declared, folder, executor, print, lambda *step: steps.append(step))
    return steps


def test_progress_counts_runs(steps: Steps) -> None:
    assert sum(runs for runs, _ in steps) == 16


def test_progress_tells_the_share_that_keeps_everything(steps: Steps, pairs: Folder) -> None:
    columns = pairs.columns(campaign(pair()), ["relative"], range(2))
    _, shares = steps[-1]
    assert shares == {law: (rows["relative"] >= 0).mean() for law, rows in columns.items()}


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
    line = refusal(pair_shard, copy, 1)
    assert line.startswith(f"cannot write {copy.part(1)}: No space left on device")
    assert [file.name for file in (copy.path / "parts").glob("*part*")] == [copy.part(0).name]
    assert bits(copy) == bits(pairs)[:1]


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
    return Folder(Path(shutil.copytree(fives, tmp_path / "copy")))


def test_other_versions_are_told(other_scipy: Folder) -> None:
    (line,) = other_scipy.begin(five(), resume=True)
    assert "versions.scipy: " in line
    _, (line,) = read_campaign(other_scipy.path)
    assert line.endswith("there, 0.1 now: bits may differ")


def test_other_versions_read_all_runs(other_scipy: Folder) -> None:
    assert findings(five(), other_scipy).sampled.words == "5 runs, random, seed 0"
    other_scipy.part(1).unlink()
    assert findings(five(), other_scipy).sampled.words == "4 of 5 runs, random, seed 0"


def test_other_versions_add_nothing(other_scipy: Folder) -> None:
    other_scipy.part(1).unlink()
    assert "install those to go on" in refusal(other_scipy.begin, five(), resume=True)
    # A worker, which has not opened the campaign yet.
    bound_to = read_manifest(other_scipy.path)["hash"]
    line = refusal(run_part, str(other_scipy.path), five().specification, bound_to, 1)
    assert "was begun with other versions: versions.scipy: " in line


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


def test_a_worker_refuses_another_specification(copy: Folder) -> None:
    bound_to = read_manifest(copy.path)["hash"]
    other = campaign(pair(), seed=1).specification
    line = refusal(open_campaign, str(copy.path), other, bound_to)
    assert "was begun with something else: seed: 0 there, 1 now" in line


def test_a_worker_refuses_another_manifest(copy: Folder) -> None:
    bound_to = read_manifest(copy.path)["hash"]
    specification = campaign(pair()).specification
    line = refusal(open_campaign, str(copy.path), specification, f"{bound_to}0")
    assert "has another campaign than the one" in line


def test_a_campaign_that_is_there_must_be_resumed(copy: Folder) -> None:
    line = refusal(copy.begin, campaign(pair()), resume=False)
    assert "--resume runs what is missing" in line


def test_parts_without_a_manifest_are_refused(copy: Folder) -> None:
    (copy.path / "manifest.json").unlink()
    line = refusal(copy.begin, campaign(pair()), resume=False)
    assert "parts without a manifest.json" in line
    assert "is no campaign" in refusal(pair_shard, copy, 0)


def test_a_folder_without_runs_has_no_findings(tmp_path: Path) -> None:
    declared = campaign(pair())
    assert "has no runs yet" in refusal(findings, declared, begun(declared, tmp_path / "empty"))


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


def rewrite(copy: Folder, table: pa.Table) -> None:
    """Write other rows, with the notes of the right ones."""
    pq.write_table(table, copy.part(1))


def rows_of(copy: Folder) -> pa.Table:
    """The rows of the second part."""
    return pq.read_table(copy.part(1))


def move_part(copy: Folder) -> None:
    """Put the first part under the second one's number, with a checksum that is its own."""
    shutil.copy(copy.part(0), copy.part(1))
    forged(copy.part(1), pq.read_table(copy.part(0)), part=1)


def make_folder(copy: Folder) -> None:
    """Put a folder in the place of the part."""
    copy.part(1).unlink()
    copy.part(1).mkdir()


def swap_runs(copy: Folder) -> None:
    """Put two runs under each other's number."""
    table = rows_of(copy)
    swapped = table.take([1, 0, *range(2, 8)])
    rewrite(copy, swapped.set_column(0, table.field("id"), table["id"]))


def change_bit(copy: Folder) -> None:
    """Change the lowest bit of one margin."""
    table = rows_of(copy)
    margin = table["relative"][3].as_py()
    rewrite(copy, replaced(table, "relative", 3, np.nextafter(margin, 9)))


def change_unit(copy: Folder) -> None:
    """Write another unit."""
    table = rows_of(copy)
    degrees = pa.field("deviation", pa.float64(), metadata={"unit": "deg"})
    place = table.column_names.index("deviation")
    rewrite(copy, table.set_column(place, degrees, table["deviation"]))


def drop_notes(copy: Folder) -> None:
    """Write the rows without notes."""
    rewrite(copy, rows_of(copy).replace_schema_metadata({}))


def change_campaign(copy: Folder) -> None:
    """Write another campaign's hash."""
    forged(copy.part(1), rows_of(copy), campaign="0" * 64)


def cut_off(copy: Folder) -> None:
    """Write a file without its end."""
    copy.part(1).write_bytes(copy.part(0).read_bytes()[:-20])


@pytest.mark.parametrize(
    "damage",
    [
        move_part,
        make_folder,
        swap_runs,
        change_bit,
        change_unit,
        drop_notes,
        change_campaign,
        cut_off,
    ],
)
def test_a_part_that_was_not_written_so(copy: Folder, damage: Callable[[Folder], None]) -> None:
    declared = campaign(pair())
    damage(copy)
    line = (
        f"{copy.part(1)} is damaged, or is not part 1 of this campaign: remove it, "
        "and --resume runs it again"
    )
    assert refusal(copy.begin, declared, resume=True) == line
    assert refusal(findings, declared, copy) == line


ANY_NUMBERS = pa.table({"x": [0.0, -0.0, float("nan"), float("inf"), 5e-324], "y": list("aßb\n ")})


def test_a_checksum_survives_another_compression(copy: Folder) -> None:
    pq.write_table(ANY_NUMBERS, copy.part(0), compression="gzip", row_group_size=2)
    table = pq.read_table(copy.part(0))
    assert checksum(table, {}) == checksum(ANY_NUMBERS, {})


def test_a_checksum_tells_signed_zeros_apart() -> None:
    changed = ANY_NUMBERS.take([1, 1, 2, 3, 4])
    assert checksum(changed, {}) != checksum(ANY_NUMBERS, {})
