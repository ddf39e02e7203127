"""Repeating one run of a campaign to the last bit."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from campaign_cases import begun, campaign, falling, forged, kept, replaced, servo

from grosmc_mj.campaign.family.family import LARGEST_SCALE
from grosmc_mj.campaign.findings.worst import worst
from grosmc_mj.campaign.report.document import replay_document, worst_document
from grosmc_mj.campaign.runs.folder import Folder
from grosmc_mj.campaign.runs.replay import found_values, replay
from grosmc_mj.errors import GrosmcError
from grosmc_mj.experiments.metrics.running import METRICS
from grosmc_mj.results.document import json_text

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
        assert found.stored
        assert found.differences == ()
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
    assert replay(campaign(servo()), folder, "1", None, "native").outcome.controller == "grosmc"


@pytest.mark.slow
def test_a_run_that_ended_early_is_repeated_bit_for_bit(tmp_path: Path) -> None:
    asked = falling()
    folder = kept(asked, tmp_path)
    status = folder.columns(asked, ["status"], [0])["fl-lqr"]["status"]
    early = np.flatnonzero(status != "completed")
    assert len(early)
    for engine in ENGINES:
        found = replay(asked, folder, str(early[0]), None, engine)
        assert found.differences == ()
        assert found.result.ended
        assert found.outcome.status == ["undefined_law"]
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
    assert len(found.differences) == 1
    assert found.differences[0].startswith(f"{column}: {value} was stored, ")
    assert replay(campaign(servo()), copy, "2", "lqr", "native").differences == ()


def test_a_run_whose_part_is_missing_has_nothing_to_compare_with(tmp_path: Path) -> None:
    asked = campaign(servo())
    found = replay(asked, begun(asked, tmp_path), "3", "lqr", "native")
    assert not found.stored
    assert replay_document(asked, found, "native")["as_stored"] is None


def test_the_worst_plant_is_replayed_as_it_was_found(tmp_path: Path) -> None:
    asked = campaign(servo())
    folder = kept(asked, tmp_path)
    found = worst(asked, "lqr", list(range(8)), 128)
    (tmp_path / "worst.json").write_text(json_text(worst_document(asked, [found])))
    for which, relative in (("worst", found.relative), ("shrunk", found.shrunk_relative)):
        again = replay(asked, folder, which, "lqr", "native")
        assert again.outcome.relative[0] == relative
        assert not again.stored


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


PLANT = {"rotor mass scale": 2.0, "load amplitude": 0.5}


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("{", "cannot be read: Expecting property name"),
        ("[]", "cannot be read: it is no table"),
        ("[" * 3000, "cannot be read: "),
        ('{"controllers": []}', "it has no table of grosmc"),
        ('{"controllers": {}}', "no plant was found that fails under grosmc"),
        ('{"controllers": {"grosmc": {"worst": null}}}', "no plant was found that fails under"),
        ('{"controllers": {"grosmc": 3}}', "it has no table of grosmc"),
        ({"rotor mass scale": 2.0}, "must have the numbers rotor mass scale, load amplitude"),
        ({**PLANT, "motor": 1.0}, "must have the numbers rotor mass scale, load amplitude"),
        ({**PLANT, "load amplitude": True}, "load amplitude = True must be a number from -1 to 1"),
        ({**PLANT, "load amplitude": "0.5"}, "load amplitude = 0.5 must be a number from -1 to 1"),
        ({**PLANT, "load amplitude": None}, "load amplitude = None must be a number from -1"),
        ({**PLANT, "load amplitude": float("nan")}, "Out of range float values"),
        ({**PLANT, "load amplitude": 1.01}, "load amplitude = 1.01 must be a number from -1 to 1"),
        ({**PLANT, "rotor mass scale": 10**400}, "must be a number from 1 to 3"),
    ],
)
def test_a_plant_that_no_search_has_found_is_refused(
    folder: Folder, tmp_path: Path, content: Any, says: str
) -> None:
    if isinstance(content, dict):
        content = json.dumps({"controllers": {"grosmc": {"worst": content}}})
    (tmp_path / "worst.json").write_text(content)
    with pytest.raises(GrosmcError) as refused:
        found_values(campaign(servo()), tmp_path, "worst", "grosmc")
    assert str(refused.value).startswith(f"{tmp_path / 'worst.json'}: ")
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_plant_outside_may_be_as_far_out_as_the_radius_looks(tmp_path: Path) -> None:
    asked = campaign(servo())

    def outside(scale: float) -> list[float]:
        plant = dict(zip(PLANT, (1 + 2 * scale, -scale), strict=True))
        content = {"controllers": {"lqr": {"outside": plant}}}
        (tmp_path / "radius.json").write_text(json.dumps(content))
        return found_values(asked, tmp_path, "outside", "lqr").tolist()

    assert outside(LARGEST_SCALE) == [1 + 2 * LARGEST_SCALE, -LARGEST_SCALE]
    with pytest.raises(GrosmcError, match="rotor mass scale = "):
        outside(1.01 * LARGEST_SCALE)
