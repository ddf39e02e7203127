"""The folder of a campaign: whole parts, the same bits from everybody, refusals in one line."""

from __future__ import annotations

import errno
import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from campaign_cases import begun, bits, campaign, forged, kept, pair

from grosmc_mj.errors import GrosmcError, SetupError
from grosmc_mj.executors import Executor, make_executor
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.findings import findings
from grosmc_mj.sweep.screening import evaluate
from grosmc_mj.sweep.store import (
    _HASHED,
    Folder,
    _hash,
    manifest_of,
    open_campaign,
    read_campaign,
    read_manifest,
    run_missing,
    run_shard,
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """Eight servos in two parts."""
    return kept(campaign(pair()), tmp_path_factory.mktemp("campaign"))


@pytest.fixture
def copy(finished: Folder, tmp_path: Path) -> Folder:
    """The same, to be broken."""
    return Folder(Path(shutil.copytree(finished.path, tmp_path / "copy")))


def told(of: Any, *arguments: Any, **more: Any) -> str:
    """The one line that somebody gets."""
    with pytest.raises(GrosmcError) as refused:
        of(*arguments, **more)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def changed(folder: Folder, **content: Any) -> dict[str, Any]:
    """Write other things into a manifest."""
    path = folder.path / "manifest.json"
    manifest = {**json.loads(path.read_text()), **content}
    path.write_text(json.dumps(manifest))
    return manifest


def rehashed(folder: Folder, **content: Any) -> None:
    """The same, with a hash that is right, in the manifest and in the parts."""
    manifest = changed(folder, **content)
    bound_to = _hash({key: manifest[key] for key in _HASHED})
    changed(folder, hash=bound_to)
    for file in (folder.path / "parts").iterdir():
        forged(file, pq.read_table(file), campaign=bound_to)


def run(folder: Folder, index: int, threads: int = 0) -> Any:
    """Run a part of the campaign that most tests are of."""
    bound_to = manifest_of(campaign(pair()))["hash"]
    return run_shard(str(folder.path), campaign(pair()).specification, bound_to, index, threads)


def test_a_part_has_a_row_for_each_run_and_controller(finished: Folder) -> None:
    asked = campaign(pair())
    table = pq.read_table(finished.part(1))
    assert table["id"].to_pylist() == [4, 5, 6, 7] * 2
    assert table["controller"].to_pylist() == ["lqr"] * 4 + ["stiff"] * 4
    for law in asked.laws:
        own = finished.columns(asked, table.column_names, [1])[law]
        found = evaluate(asked, law, asked.values(range(4, 8)))
        for name in set(own) - {"id", "controller", "status", "judged_by"}:
            assert own[name].tobytes() == found[name].tobytes(), name
        assert own["status"].tolist() == found["status"].tolist()
        assert own["ended"].tolist() == [0.05] * 4
    units = {
        field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in table.schema
    }
    assert units["deviation"] == units["margin deviation_below"] == "rad"
    assert units["max_input"] == "A"
    assert units["ended"] == "s"


def test_parts_are_the_same_in_any_order_and_with_any_threads(
    finished: Folder, tmp_path: Path
) -> None:
    folder = begun(campaign(pair()), tmp_path / "again")
    for index, threads in ((1, 1), (0, 3)):
        run(folder, index, threads)
    assert bits(folder) == bits(finished)
    assert not list((folder.path / "parts").glob(".*"))


def executors() -> list[Any]:
    return [
        "batch",
        pytest.param("processes", marks=pytest.mark.slow),
        pytest.param("dask", marks=[pytest.mark.slow, pytest.mark.apart]),
    ]


@pytest.mark.parametrize("name", executors())
def test_every_executor_writes_the_same_bits(name: str, finished: Folder, tmp_path: Path) -> None:
    if name == "dask":
        pytest.importorskip("distributed")
    asked, advances = campaign(pair()), []
    folder = begun(asked, tmp_path / "folder")
    executor: Executor = make_executor(name, workers=None if name == "batch" else 2)
    again = run_missing(asked, folder, executor, print, lambda *each: advances.append(each))
    assert again == 0
    assert bits(folder) == bits(finished)
    assert sum(runs for runs, _ in advances) == 16
    columns = finished.columns(asked, ["relative"], range(2))
    rates = {law: (own["relative"] >= 0).sum() / 8 for law, own in columns.items()}
    assert advances[-1][1] == rates


def test_only_what_is_missing_is_run(copy: Folder, finished: Folder) -> None:
    asked = campaign(pair())
    copy.part(0).unlink()
    (copy.path / "parts" / ".part-0000000.0123456789abcdef.part.parquet").write_bytes(b"half")
    (copy.path / "parts" / ".other.parquet").touch()
    untouched = copy.part(1).stat().st_mtime_ns
    copy.begin(asked, resume=True)
    assert [file.name for file in (copy.path / "parts").glob(".*")] == [".other.parquet"]
    assert copy.missing(asked) == [0]
    run_missing(asked, copy, make_executor("batch"), print, lambda *_: None)
    assert bits(copy) == bits(finished)
    assert copy.part(1).stat().st_mtime_ns == untouched


def test_a_campaign_without_its_short_last_part_is_not_complete(tmp_path: Path) -> None:
    asked = campaign(pair(), runs=9)
    folder = kept(asked, tmp_path / "campaign")
    whole = findings(asked, folder, 0.95)
    assert whole.sampled.words == "9 runs, random, seed 0"
    folder.part(2).unlink()
    assert folder.missing(asked) == [2]
    assert findings(asked, folder, 0.95).sampled.words == "8 of 9 runs, random, seed 0"
    rehashed(folder, versions={**read_manifest(folder.path)["versions"], "scipy": "0.1"})
    assert "is not complete" in told(folder.begin, asked, resume=True)


def test_a_full_disk_keeps_finished_parts(
    copy: Folder, finished: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    copy.part(1).unlink()
    monkeypatch.setattr(os, "fsync", full)
    assert told(run, copy, 1) == (
        f"cannot write {copy.part(1)}: No space left on device; free the disk or choose another "
        "place"
    )
    assert [file.name for file in (copy.path / "parts").iterdir()] == [copy.part(0).name]
    assert bits(copy) == bits(finished)[:1]


def test_a_file_in_the_way(tmp_path: Path) -> None:
    way = tmp_path / "file"
    way.touch()
    for path in (way, way / "below"):
        assert told(begun, campaign(pair()), path).startswith(f"cannot write {path}")


@pytest.mark.parametrize(
    ("asked", "difference"),
    [
        ({"seed": 1}, "seed: 0 there, 1 now"),
        ({"runs": 9}, "runs: 8 there, 9 now"),
        ({"sampler": "lhs"}, "sampler: random there, lhs now"),
        ({"duration": 0.06}, "duration: 0.05 there, 0.06 now"),
        ({"controllers": ("lqr",)}, "controllers 2: stiff there, nothing now"),
    ],
)
def test_another_campaign_in_the_folder_is_refused_with_the_difference(
    finished: Folder, asked: dict[str, Any], difference: str
) -> None:
    other = Campaign.of(replace(campaign(pair()).specification, **asked))
    for resume in (False, True):
        said = told(finished.begin, other, resume=resume)
        assert difference in said
        assert said.endswith("take another --out")


def test_the_same_campaign_needs_resume(finished: Folder) -> None:
    asked = campaign(pair())
    assert "--resume runs what is missing" in told(finished.begin, asked, resume=False)
    assert manifest_of(asked)["hash"] == read_manifest(finished.path)["hash"]


def test_parts_without_a_manifest_are_not_overwritten(copy: Folder) -> None:
    (copy.path / "manifest.json").unlink()
    said = told(copy.begin, campaign(pair()), resume=False)
    assert "has parts without a manifest.json" in said
    assert "is no campaign" in told(run, copy, 0)


@pytest.mark.parametrize(
    "content",
    [{"schema_version": 2, "hash": "0"}, {"model": "0"}, {"configuration": []}, {"sources": None},
     {"question": "servo"}],
)  # fmt: skip
def test_a_manifest_that_is_not_ours(copy: Folder, content: dict[str, Any]) -> None:
    changed(copy, **content)
    for of in (read_manifest, read_campaign):
        line = told(of, copy.path)
        assert line.startswith(f"{copy.path / 'manifest.json'} is damaged, or of another version")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({"text": 3}, "text = 3"),
        ({"name": "../up"}, "'../up' must be a name for files"),
        ({"runs": 8.0}, "runs = 8 must be a whole number"),
        ({"runs": 10**4000}, "must be a whole number from 1 to"),
        ({"controllers": [["lqr"]]}, "controllers.0"),
        ({"colour": "red"}, "there is no argument colour"),
    ],
)
def test_a_specification_that_is_none(copy: Folder, content: dict[str, Any], says: str) -> None:
    changed(copy, question={**read_manifest(copy.path)["question"], **content})
    assert says in told(read_campaign, copy.path)


@pytest.mark.parametrize("content", [b"{", b"[1]", b"[" * 3000, b"1" * 5000, b"\xff"])
def test_a_manifest_that_is_no_json(copy: Folder, content: bytes) -> None:
    (copy.path / "manifest.json").write_bytes(content)
    assert "manifest.json is damaged" in told(read_campaign, copy.path)


@pytest.mark.parametrize(
    ("content", "says"),
    [({"versions": {"numpy": "1.0"}}, "versions.numpy: 1.0 there, "), ({"model": "0"}, "model: 0")],
)
def test_what_would_be_computed_differently_is_refused(
    copy: Folder, content: dict[str, Any], says: str
) -> None:
    rehashed(copy, **content)
    asked = campaign(pair())
    bound_to = read_manifest(copy.path)["hash"]
    assert says in told(run_shard, str(copy.path), asked.specification, bound_to, 0)
    assert "has another campaign than the one" in told(run, copy, 0)


def test_another_campaign_under_the_same_name_is_not_taken_for_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "campaign"
    kept(campaign(pair(), runs=2), path)
    shutil.rmtree(path)
    asked = campaign(pair(), runs=2, seed=1)
    folder = kept(asked, path)
    bound_to = read_manifest(path)["hash"]
    assert open_campaign(str(path), asked.specification, bound_to).specification.seed == 1
    before = campaign(pair(), runs=2).specification
    assert "was begun with something else: seed: 1 there, 0 now" in told(
        open_campaign, str(path), before, bound_to
    )
    own = folder.columns(asked, ["rotor mass scale"], [0])["lqr"]["rotor mass scale"]
    assert np.array_equal(own, asked.values(range(2))[:, 0])


def test_findings_of_nothing(tmp_path: Path) -> None:
    folder = begun(campaign(pair()), tmp_path / "empty")
    with pytest.raises(SetupError, match="has no runs yet: --resume"):
        findings(campaign(pair()), folder, 0.95)


def test_other_versions_read_a_complete_campaign_and_add_nothing_to_another(copy: Folder) -> None:
    asked = campaign(pair())
    rehashed(copy, versions={**read_manifest(copy.path)["versions"], "scipy": "0.1"})
    (line,) = copy.begin(asked, resume=True)
    assert line.startswith("versions.scipy: 0.1 there, ")
    _, (said,) = read_campaign(copy.path)
    assert said.startswith("versions.scipy: 0.1 there, ")
    assert said.endswith("bits may differ")
    copy.part(1).unlink()
    assert "install those to go on" in told(copy.begin, asked, resume=True)
