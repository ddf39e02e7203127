"""Designs are tuned on random plants, and with an estimator of the case."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tune_cases import write_block

from grosmc_mj import Experiment
from grosmc_mj.experiments.file.text import text_of
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.studies.study import CellRunner
from grosmc_mj.studies.tune.case_text import case_text
from grosmc_mj.studies.tune.conditions import PLANTS
from grosmc_mj.studies.tune.row import TunedLaw
from grosmc_mj.studies.tune.tune import tune_study

NUMBERS = ("laws.mine.frequency=0.2..20", "laws.mine.damping=0.2..2")
UNCERTAIN = {"number": "edit.m.scale", "values": [0.5, 2.0]}


def test_random_plants_are_a_condition_and_others_judge(tmp_path: Path):
    path = write_block(tmp_path, uncertain=UNCERTAIN)
    study = tune_study(str(path), ["mine"], NUMBERS, runs=60, plants=4, held_out=10)
    plants = study.conditions[-1]
    assert plants.name == PLANTS
    assert plants.draws == 4
    scales = [plants.case(number).nominal.scales for number in (0, 1, 2, 3, 1000)]
    assert len(set(scales)) == 5

    row = next(study.rows(study.cells(), CellRunner(tmp_path / "pieces", TunedLaw, False)))
    on_plants = next(verdict for verdict in row.after if verdict.condition == PLANTS)
    assert on_plants.draws == 10
    assert on_plants.draw >= 1000


def test_plants_need_something_uncertain(tmp_path: Path):
    with pytest.raises(ArgumentError, match="--plants 4: nothing is uncertain"):
        tune_study(str(write_block(tmp_path)), ["mine"], NUMBERS, plants=4)


def estimated(folder: Path, **tables: Any) -> Path:
    """The block with a measured position, whose rate is estimated."""
    return write_block(
        folder,
        sensor={"of": "x", "resolution": "1 mm"},
        estimator={"of": "v", "law": "eso", "bandwidth": "50 rad/s"},
        **tables,
    )


def test_the_estimator_is_tuned_with_a_law_and_written(tmp_path: Path):
    path = estimated(tmp_path)
    numbers = ["laws.mine.frequency=0.2..20", "estimator.v.bandwidth=10..200"]
    study = tune_study(str(path), ["mine"], numbers, runs=40, draws=2, held_out=2)
    row = next(study.rows(study.cells(), CellRunner(tmp_path / "pieces", TunedLaw, False)))
    bandwidth = row.values["estimator.v.bandwidth"]
    assert bandwidth != pytest.approx(50)

    written = tmp_path / "tuned.toml"
    text = case_text(study.case, study.laws, {row.law: row.values}, ["found"])
    written.write_text(text, encoding="utf-8")
    loop = Experiment.load(written).loop
    assert loop is not None
    (estimator,) = loop.estimators
    assert estimator.bandwidth == pytest.approx(bandwidth, rel=1e-5)


def test_a_random_plant_that_cannot_be_made_is_refused_before_any_run(tmp_path: Path):
    """The inertia in front of the servo's gear is more than a fifth of all."""
    light = {"number": "edit.rotor.mass_scale", "values": [0.2, 0.4]}
    path = tmp_path / "light.toml"
    path.write_text(text_of({"extends": "servo/machine", "uncertain": [light]}), encoding="utf-8")
    with pytest.raises(ArgumentError, match=r"random plant 0 of \[\[uncertain\]\]: .*inertia"):
        tune_study(str(path), ["lqr"], plants=2)


def test_an_estimator_is_one_for_all_laws(tmp_path: Path):
    path = estimated(tmp_path, laws={"other": {"law": "fl-lqr"}})
    with pytest.raises(ArgumentError, match="is one for all laws: tune one --law with it"):
        tune_study(str(path), ["mine", "other"], ["estimator.v.bandwidth=10..200"])
