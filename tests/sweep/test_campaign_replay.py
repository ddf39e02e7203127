"""Repeating one run of a campaign to the last bit."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from campaign_cases import begun, campaign, falling, forged, kept, replaced, servo

from grosmc_mj.errors import GrosmcError
from grosmc_mj.experiments.metrics import METRICS
from grosmc_mj.results.document import json_text
from grosmc_mj.sweep.replay import replay, replay_document, searched_values
from grosmc_mj.sweep.store import Folder
from grosmc_mj.sweep.worst import worst, worst_document

ENGINES: list[Any] = ["native", "python"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """Eight servos in two parts."""
    return kept(campaign(servo()), tmp_path_factory.mktemp("campaign"))


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("law", ["lqr", "grosmc"])
def test_a_run_is_repeated_bit_for_bit(folder: Folder, law: str, engine: Any) -> None:
    for number in ("0", "5"):
        found = replay(campaign(servo()), folder, number, law, engine)
        assert found.differences == []
        assert found.result.trajectory.time[-1] == 0.05
        document = replay_document(campaign(servo()), found, engine)
        assert document["as_stored"] is True
        assert document["status"] == "completed"
        json_text(document)
        # What is shown is what was compared.
        shown = {name: each.value for name, each in found.judged.metrics.items()}
        for name in METRICS.keys() & shown.keys():
            if shown[name] is not None:
                assert shown[name] == document["metrics"][name], name


def test_the_last_controller_is_the_default(folder: Folder) -> None:
    outcome = replay(campaign(servo()), folder, "1", None, "native").outcome
    assert outcome["controller"].tolist() == ["grosmc"]


@pytest.mark.slow
def test_a_run_that_ended_early_is_repeated_bit_for_bit(tmp_path: Path) -> None:
    asked = falling()
    folder = kept(asked, tmp_path)
    status = folder.columns(asked, ["status"], [0])["fl-lqr"]["status"]
    early = np.flatnonzero(status != "completed")
    assert len(early)
    for engine in ENGINES:
        found = replay(asked, folder, str(early[0]), None, engine)
        assert found.differences == []
        assert found.result.ended
        assert found.outcome["status"].tolist() == ["undefined_law"]
        json_text(replay_document(asked, found, engine))


@pytest.mark.parametrize(
    ("column", "value"),
    [("max_input", 0.0), ("margin deviation_below", 1.0), ("status", "diverged"), ("ended", 0.04)],
)
def test_a_tampered_row_is_named(folder: Folder, tmp_path: Path, column: str, value: Any) -> None:
    copy = Folder(Path(shutil.copytree(folder.path, tmp_path / "copy")))
    table = pq.read_table(copy.part(0))
    row = table["controller"].to_pylist().index("grosmc") + 2
    forged(copy.part(0), replaced(table, column, row, value))
    found = replay(campaign(servo()), copy, "2", "grosmc", "native")
    assert found.differences is not None
    (line,) = found.differences
    assert line.startswith(f"{column}: {value} was stored, ")
    assert replay(campaign(servo()), copy, "2", "lqr", "native").differences == []


def test_a_run_whose_part_is_missing_has_nothing_to_compare_with(tmp_path: Path) -> None:
    asked = campaign(servo())
    found = replay(asked, begun(asked, tmp_path), "3", "lqr", "native")
    assert found.differences is None
    assert replay_document(asked, found, "native")["as_stored"] is None


def test_the_worst_plant_is_replayed_as_it_was_found(tmp_path: Path) -> None:
    asked = campaign(servo())
    folder = kept(asked, tmp_path)
    found = worst(asked, "lqr", list(range(8)), 128)
    (tmp_path / "worst.json").write_text(json_text(worst_document(asked, [found])))
    for which, relative in (("worst", found.relative), ("shrunk", found.shrunk_relative)):
        again = replay(asked, folder, which, "lqr", "native")
        assert again.outcome["relative"][0] == relative
        assert again.differences is None


@pytest.mark.parametrize(
    ("which", "controller", "says"),
    [
        ("8", None, "run '8': there are 0 to 7, worst, shrunk, outside"),
        ("-1", None, "run '-1': there are 0 to 7"),
        ("first", None, "run 'first'"),
        ("²", None, "run '²'"),
        ("0", "grosm", "unknown controller 'grosm': did you mean 'grosmc'?"),
        ("worst", None, "has no worst.json: run the campaign with --worst"),
        ("outside", None, "has no radius.json: run the campaign with --radius"),
    ],
)
def test_what_cannot_be_replayed(
    folder: Folder, which: str, controller: str | None, says: str
) -> None:
    with pytest.raises(GrosmcError) as refused:
        replay(campaign(servo()), folder, which, controller, "native")
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "content",
    [
        "{",
        "[" * 3000,
        '{"controllers": []}',
        '{"controllers": {}}',
        '{"controllers": {"grosmc": {"worst": {"rotor mass scale": 2.0}}}}',
        '{"controllers": {"grosmc": {"worst": {"rotor mass scale": [], "load amplitude": 1}}}}',
    ],
)
def test_a_plant_that_cannot_be_read_is_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "worst.json").write_text(content)
    with pytest.raises(GrosmcError) as refused:
        searched_values(campaign(servo()), tmp_path, "worst", "grosmc")
    path = tmp_path / "worst.json"
    assert str(refused.value) == f"{path} cannot be read: run the campaign with --worst again"
