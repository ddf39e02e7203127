"""The folder of a campaign: whole parts, the same bits from everybody, refusals in one line."""

from __future__ import annotations

import errno
import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from campaign_cases import begun, campaign, kept, pair

from grosmc_mj.campaign.campaign import Campaign
from grosmc_mj.campaign.executors import Executor, make_executor
from grosmc_mj.campaign.findings import ALL, findings
from grosmc_mj.campaign.folder import Folder
from grosmc_mj.campaign.manifest import manifest_of, read_manifest
from grosmc_mj.campaign.question import Question
from grosmc_mj.campaign.running import missing, run_missing
from grosmc_mj.campaign.shard import evaluate
from grosmc_mj.campaign.work import open_campaign, read_campaign, run_shard
from grosmc_mj.errors import ArgumentError, GrosmcError, SetupError

FROZEN = Path(__file__).parent / "data" / "campaign_v1"


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """Eight servos in two parts."""
    return kept(campaign(pair()), tmp_path_factory.mktemp("campaign"))


@pytest.fixture
def copy(finished: Folder, tmp_path: Path) -> Folder:
    """The same, to be broken."""
    return Folder(Path(shutil.copytree(finished.path, tmp_path / "copy")))


def bits(folder: Folder) -> list[bytes]:
    """The parts."""
    return [file.read_bytes() for file in folder.files(range(2))]


def told(of: Any, *arguments: Any, **more: Any) -> str:
    """The one line that somebody gets."""
    with pytest.raises(GrosmcError) as refused:
        of(*arguments, **more)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def changed(folder: Folder, **content: Any) -> None:
    """Write other things into a manifest."""
    path = folder.path / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **content}))


def test_a_part_has_a_row_for_each_run_and_controller(finished: Folder) -> None:
    asked = campaign(pair())
    table = pq.read_table(finished.part(1))
    assert table["id"].to_pylist() == [4, 5, 6, 7] * 2
    assert table["controller"].to_pylist() == ["lqr"] * 4 + ["stiff"] * 4
    for law in asked.laws:
        own = finished.columns([*table.column_names], law, [1])
        found = evaluate(asked, law, asked.values(range(4, 8)))
        assert np.array_equal(own["rotor mass scale"], found.values[:, 0])
        assert np.array_equal(own["load amplitude"], found.values[:, 1])
        for name, values in found.metrics.items():
            assert own[name].tobytes() == values.tobytes()
        for key, values in found.margins.items():
            assert own[f"margin {key}"].tobytes() == values.tobytes()
        assert own["relative"].tobytes() == found.relative.tobytes()
        assert own["status"].tolist() == found.status
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
        report = run_shard(str(folder.path), index, threads)
        assert (report.index, report.first, report.runs) == (index, 4 * index, 4)
    assert bits(folder) == bits(finished)
    assert not list(folder.parts.glob(".*"))


def executors() -> list[Any]:
    return [
        "batch",
        pytest.param("processes", marks=pytest.mark.slow),
        pytest.param("dask", marks=pytest.mark.slow),
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
    counts = finished.counts(range(2))
    assert advances[-1][1] == {law: each["everything"] / 8 for law, each in counts.items()}


def test_only_what_is_missing_is_run(copy: Folder, finished: Folder) -> None:
    asked = campaign(pair())
    copy.part(0).unlink()
    (copy.parts / ".part-0000000.parquet.elsewhere-1.part").write_bytes(b"half")
    untouched = copy.part(1).stat().st_mtime_ns
    copy.begin(manifest_of(asked), resume=True)
    assert not list(copy.parts.glob(".*"))
    assert missing(asked, copy) == [0]
    run_missing(asked, copy, make_executor("batch"), print, lambda *_: None)
    assert bits(copy) == bits(finished)
    assert copy.part(1).stat().st_mtime_ns == untouched


def test_a_full_disk_keeps_finished_parts(
    copy: Folder, finished: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    copy.part(1).unlink()
    monkeypatch.setattr(os, "fsync", full)
    assert told(run_shard, str(copy.path), 1) == (
        f"cannot write {copy.part(1)}: No space left on device; free the disk or choose another "
        "place"
    )
    assert [file.name for file in copy.parts.iterdir()] == [copy.part(0).name]
    assert bits(copy) == bits(finished)[:1]


def test_a_file_in_the_way(tmp_path: Path) -> None:
    way = tmp_path / "file"
    way.touch()
    for path in (way, way / "below"):
        assert told(begun, campaign(pair()), path).startswith(f"cannot write {path}")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "parts").touch()
    said = told(begun, campaign(pair()), tmp_path / "folder")
    assert "parts: File exists" in said


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    assert "Permission denied" in told(begun, campaign(pair()), tmp_path / "campaign")


@pytest.mark.parametrize(
    ("asked", "difference"),
    [
        ({"seed": 1}, "seed: 0 there, 1 now"),
        ({"runs": 9}, "runs: 8 there, 9 now"),
        ({"sampler": "lhs"}, "sampler: sobol there, lhs now"),
        ({"duration": 0.06}, "duration: 0.05 there, 0.06 now"),
        ({"controllers": ("lqr",)}, "controllers 2: stiff there, nothing now"),
    ],
)
def test_another_campaign_in_the_folder_is_refused_with_the_difference(
    finished: Folder, asked: dict[str, Any], difference: str
) -> None:
    other = manifest_of(Campaign.of(Question(**{**vars(campaign(pair()).question), **asked})))
    for resume in (False, True):
        said = told(finished.begin, other, resume=resume)
        assert difference in said
        assert said.endswith("take another --out")


def test_a_changed_file_is_refused_with_what_is_changed(finished: Folder) -> None:
    wider = manifest_of(campaign(pair().replace("[1, 3]", "[1, 4]")))
    said = told(finished.begin, wider, resume=True)
    assert "uncertain.rotor mass scale: uniform: least 1, most 3; nominal 1; unit  there" in said


def test_the_same_campaign_needs_resume(finished: Folder) -> None:
    manifest = manifest_of(campaign(pair()))
    assert "--resume runs what is missing" in told(finished.begin, manifest, resume=False)
    assert manifest["hash"] == read_manifest(finished.path)["hash"]


def test_parts_without_a_manifest_are_not_overwritten(copy: Folder) -> None:
    (copy.path / "manifest.json").unlink()
    assert "has parts without a manifest.json" in told(
        copy.begin, manifest_of(campaign(pair())), resume=False
    )
    assert "is no campaign" in told(run_shard, str(copy.path), 0)


@pytest.mark.parametrize("cut", [0, 100, -20])
def test_a_broken_part_is_named(copy: Folder, cut: int) -> None:
    copy.part(1).write_bytes(copy.part(1).read_bytes()[:cut])
    said = told(findings, campaign(pair()), copy, 0.95)
    assert said.startswith(f"{copy.part(1)}: cannot be read (ArrowInvalid): remove it")


@pytest.mark.parametrize(
    "tampered",
    [
        lambda table: table.slice(0, 5),
        lambda table: table.drop_columns(["relative"]),
        lambda table: table.replace_schema_metadata({b"grosmc_mj": b"[]"}),
        lambda table: table.replace_schema_metadata({b"grosmc_mj": b'{"counts": 3}'}),
    ],
)
def test_a_part_that_lacks_something_is_named(copy: Folder, tampered: Any) -> None:
    pq.write_table(tampered(pq.read_table(copy.part(1))), copy.part(1))
    assert str(copy.part(1)) in told(findings, campaign(pair()), copy, 0.95)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({"schema_version": 2}, "is of schema 2; this grosmc_mj reads up to 1: update it"),
        ({"schema_version": None}, "manifest.json: cannot be read: int() argument"),
        ({"question": {"text": ""}, "hash": "new"}, "question of this campaign cannot be read"),
        ({"versions": {"numpy": "1.0"}, "hash": "old"}, "versions.numpy: 1.0 there, "),
        ({"model": "0", "hash": "other"}, "model: 0 there, "),
    ],
)
def test_a_manifest_that_is_not_ours(copy: Folder, content: dict[str, Any], says: str) -> None:
    changed(copy, **content)
    assert says in told(run_shard, str(copy.path), 0)


def test_a_manifest_that_is_no_json(copy: Folder) -> None:
    (copy.path / "manifest.json").write_text("{")
    assert "manifest.json: cannot be read" in told(run_shard, str(copy.path), 0)
    (copy.path / "manifest.json").write_text('{"schema_version": 1}')
    assert "it has no hash and no question" in told(run_shard, str(copy.path), 0)


def test_another_campaign_under_the_same_name_is_not_taken_for_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "campaign"
    kept(campaign(pair(), runs=2), path)
    shutil.rmtree(path)
    asked = campaign(pair(), runs=2, seed=1)
    folder = kept(asked, path)
    assert open_campaign(str(path)).question.seed == 1
    own = folder.columns(["rotor mass scale"], "lqr", [0])["rotor mass scale"]
    assert np.array_equal(own, asked.values(range(2))[:, 0])


def test_a_folder_of_the_first_schema_stays_readable() -> None:
    manifest = read_manifest(FROZEN)
    assert manifest["schema_version"] == 1
    asked = Campaign.of(Question.of_document(manifest["question"]))
    before = sorted(file.name for file in FROZEN.rglob("*"))
    found = findings(asked, Folder(FROZEN), 0.95)
    assert sorted(file.name for file in FROZEN.rglob("*")) == before
    assert (found.rates[ALL, "lqr"].kept, found.rates[ALL, "grosmc"].kept) == (3, 8)
    assert found.worst["lqr"][:3] == [2, 0, 6]
    assert found.margins["deviation below 3 mrad", "lqr"].min() == pytest.approx(-0.00392, abs=1e-5)


def test_findings_of_nothing(tmp_path: Path) -> None:
    folder = begun(campaign(pair()), tmp_path / "empty")
    with pytest.raises(SetupError, match="has no runs yet: --resume"):
        findings(campaign(pair()), folder, 0.95)
    with pytest.raises(ArgumentError):
        findings(campaign(pair()), kept(campaign(pair(), runs=1), tmp_path / "one"), 1.0)


def test_other_versions_read_a_complete_campaign_and_add_nothing_to_another(copy: Folder) -> None:
    versions = {**read_manifest(copy.path)["versions"], "scipy": "0.1"}
    changed(copy, versions=versions)
    manifest = manifest_of(campaign(pair()))
    (line,) = copy.begin(manifest, resume=True)
    assert line.startswith("versions.scipy: 0.1 there, ")
    assert line in told(run_shard, str(copy.path), 0)
    _, others = read_campaign(str(copy.path))
    assert others == (line,)
    copy.part(1).unlink()
    assert "install those to go on" in told(copy.begin, manifest, resume=True)
