"""Repeating one run of a campaign to the last bit."""

import shutil
from pathlib import Path
from typing import Any

import campaign_cases as small
import numpy as np
import pyarrow.parquet as pq
import pytest
from campaign_cases import begun, campaign, falling, forged, kept, refusal, servo

from grosmc_mj.experiments.metrics import METRICS
from grosmc_mj.results.document import json_text
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.replay import replay, replay_document, searched_values
from grosmc_mj.sweep.store import Folder

ENGINES: list[Any] = ["native", "python"]


def servos_of() -> Campaign:
    return campaign(servo(), seed=5)


def assert_repeated(declared: Campaign, folder: Folder, number: str, law: str) -> None:
    for engine in ENGINES:
        run = replay(declared, folder, number, law, engine)
        document = replay_document(declared, run, engine)
        assert (run.differences, document["as_stored"]) == ([], True)
        assert document["status"] == run.outcome["status"][0]
        json_text(document)
        # The metrics that are shown are those that were compared.
        for name in METRICS.keys() & run.judged.metrics.keys():
            shown = run.judged.metrics[name].value
            if shown is not None and not run.result.ended:
                assert shown == document["metrics"][name], name


def test_a_run_is_repeated_bit_for_bit_in_both_engines(servos: Folder, tmp_path: Path) -> None:
    for number, law in (("0", "lqr"), ("5", "grosmc")):
        assert_repeated(servos_of(), servos, number, law)
    # The last controller is the default.
    outcome = replay(servos_of(), servos, "1", None, "native").outcome
    assert outcome["controller"].tolist() == ["grosmc"]
    # A run whose part is missing has nothing to compare with.
    run = replay(servos_of(), begun(servos_of(), tmp_path), "3", "lqr", "native")
    assert run.differences is None
    assert replay_document(servos_of(), run, "native")["as_stored"] is None


def test_a_run_that_ended_early_is_repeated(tmp_path: Path) -> None:
    folder = kept(falling(), tmp_path)
    status = folder.columns(falling(), ["status"], [0])["fl-lqr"]["status"]
    early = str(np.flatnonzero(status == "undefined_law")[0])
    assert_repeated(falling(), folder, early, "fl-lqr")
    assert replay(falling(), folder, early, None, "native").result.ended


@pytest.mark.slow
def test_a_run_of_a_loop_with_chance_is_repeated(tmp_path: Path) -> None:
    tables = small.of("sensor", "rotor angle", 'noise = ["0 mrad", "0.3 mrad"]')
    declared = campaign(small.standing(tables, small.LOOP), runs=4)
    assert_repeated(declared, kept(declared, tmp_path), "3", "predicting")


def test_a_tampered_row_is_named(servos: Folder, tmp_path: Path) -> None:
    copy = Folder(Path(shutil.copytree(servos.path, tmp_path / "copy")))
    table = pq.read_table(copy.part(0))
    row = table["controller"].to_pylist().index("grosmc") + 2
    for column, value in (("max_input", 0.0), ("margin deviation_below", 1.0),
                          ("status", "diverged")):  # fmt: skip
        forged(copy.part(0), small.replaced(table, column, row, value))
        lines = replay(servos_of(), copy, "2", "grosmc", "native").differences or []
        assert [line.split(",")[0] for line in lines] == [f"{column}: {value} was stored"]
    assert replay(servos_of(), copy, "2", "lqr", "native").differences == []


def test_a_run_or_plant_that_is_not_there_is_refused(servos: Folder, tmp_path: Path) -> None:
    for which, controller, words in (
        ("8", None, "run '8': there are 0 to 7, worst, shrunk, outside"),
        ("-1", None, "run '-1': there are 0 to 7"),
        ("²", None, "run '²'"),
        ("0", "grosm", "unknown controller 'grosm': did you mean 'grosmc'?"),
        ("worst", None, "has no worst.json: run the campaign with --worst"),
        ("outside", None, "has no radius.json: run the campaign with --radius"),
    ):
        assert words in refusal(replay, servos_of(), servos, which, controller, "native")
    path = tmp_path / "worst.json"
    for content in (
        "{",
        '{"controllers": []}',
        '{"controllers": {"grosmc": {"worst": {"rotor mass scale": 2.0}}}}',
        '{"controllers": {"grosmc": {"worst": {"rotor mass scale": [], "load amplitude": 1}}}}',
    ):
        path.write_text(content)
        line = refusal(searched_values, servos_of(), tmp_path, "worst", "grosmc")
        assert line == f"{path} cannot be read: run the campaign with --worst again"
