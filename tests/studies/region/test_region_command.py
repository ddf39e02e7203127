"""grosmc-mj study region: refusals, its answer, and results that outlive an interrupt."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import pytest
from commands import assert_one_line, run

from grosmc_mj import cli
from grosmc_mj.studies.region.region import RegionMap, RegionStudy


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("cart_pendulum --points 1", "points = 1 must be a whole number from 2 to 1000"),
        ("cart_pendulum --draws 0", "draws = 0 must be a whole number from 1 to 1000"),
        ("cart_pendulum --duration nan", "duration = nan must be above 0 to 1000 s"),
        ("arm --limits 5 inf", "limits.1 = inf must be finite and positive"),
        ("arm --axes q", "--axes q: give two, X and Y"),
        ("cart_pendulum/nominal", "take case1"),
        ("cart_pendulum/case2 --duration 8", "disturbed from 9 s on"),
        ("arm --axes q q", "two different states of arm: q, q_dot"),
        ("arm --axes q p", "unknown state of arm 'p': valid: q, q_dot"),
        ("arm --limits 115 10", "lie outside q < pi/2"),
        ("cart_pendulum --limits 115 10", "lie outside |theta| < pi/2"),
        ("arm/machine --limits 89 10", "beyond its stops at -1.5 and 1.5 rad"),
        ("arm --points 2 --out /dev/null/x", "/dev/null is a file, and a folder is needed"),
    ],
)
def test_a_question_without_sense_is_one_line(
    arguments: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("study", "region", *arguments.split()) == cli.WRONG
    error = capsys.readouterr().err
    assert words in error
    assert_one_line(error)


def test_a_law_that_converges_from_no_start_is_a_verdict(printed: Any) -> None:
    short = ("--points", "2", "--duration", "0.01", "--laws", "lqr")
    printed("study", "region", "arm", *short, "--no-figures", "--out", "results")


def read(folder: Path, name: str) -> dict[str, Any]:
    """A document of a study of regions."""
    return json.loads((folder / f"region_{name}.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_with_twice_the_payload_grosmc_holds_starts_and_lqr_loses_all(
    printed: Any, tmp_path: Path
) -> None:
    printed("study", "region", "arm", "--points", "5", "--duration", "6", "--out", "results")
    maps = {(x["case"], x["controller"]): x for x in read(tmp_path / "results", "arm")["maps"]}
    assert set(maps) == set(itertools.product(("nominal", "case2"), ("lqr", "grosmc")))
    counts = {key: "".join(x["grid"]).count("c") for key, x in maps.items()}
    assert counts == {key: x["counts"]["converged"] for key, x in maps.items()}
    assert counts["case2", "grosmc"] > 0 == counts["case2", "lqr"]
    assert {len(row) for x in maps.values() for row in x["grid"]} == {5}


def files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.is_file())


def test_an_interrupt_keeps_the_finished_maps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three of four: the second plant has fewer than the first."""
    law_map = RegionStudy.law_map
    count = itertools.count()

    def interrupted(study: RegionStudy, *arguments: Any) -> RegionMap:
        if next(count) == 3:
            raise KeyboardInterrupt
        return law_map(study, *arguments)

    monkeypatch.setattr(RegionStudy, "law_map", interrupted)
    options = ("study", "region", "servo", "--points", "2", "--duration", "0.1", "--out", tmp_path)
    assert run(*options) == cli.INTERRUPTED
    assert files(tmp_path) == [f"region_servo.{suffix}" for suffix in ("json", "png", "svg")]
    document = read(tmp_path, "servo")
    assert (document["complete"], len(document["maps"])) == (False, 3)
    assert document["answers"][0]["verdict"] == "not decided"

    # It goes on with the map at which it was stopped.
    assert run(*options, "--resume", "--no-figures") in (cli.DONE, cli.DIFFERS)
    resumed = read(tmp_path, "servo")
    assert (resumed["complete"], len(resumed["maps"])) == (True, 4)
    assert next(count) == 5


def test_an_interrupt_before_the_first_map_leaves_earlier_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    (tmp_path / "region_arm.json").write_text("earlier")
    monkeypatch.setattr(RegionStudy, "law_map", interrupted)
    assert run("study", "region", "arm", "--points", "2", "--out", tmp_path) == cli.INTERRUPTED
    assert files(tmp_path) == ["region_arm.json"]
    assert (tmp_path / "region_arm.json").read_text() == "earlier"
