"""Case files: units, the file that another one extends, and one meaning for all commands."""

from __future__ import annotations

import json
import math
import re
import shutil
from pathlib import Path

import pytest
from campaign_cases import run
from case_texts import STEP, load
from hypothesis import given
from hypothesis import strategies as st

import grosmc_mj as gm
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file import schema, shipped
from grosmc_mj.experiments.file.parts import MACHINE_PARTS, TABLES
from grosmc_mj.experiments.file.reading import parse_case_file, read_case_file, resolved_text
from grosmc_mj.experiments.file.units import _KNOWN, _registry, number_in
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.physics.mujoco_plant import MujocoPlant

CASE = """
extends = "common.toml"
[run]
duration = "0.1 s"
[[controller]]
law = "grosmc"
"""
COMMON = """
title = "common"
# Of both.
[plant]
system = "arm"
[run]
start = { "joint angle" = "0.5 rad" }
duration = "2 s"
[laws.grosmc]
k = 7
"""
OTHERS = """
[laws.soft]
law = "grosmc"
k = 3
epsilon = 90
[laws."quite soft"]
law = "grosmc"
k = 5
epsilon = 90
[[requirement]]
sliding_below = "1e9 rad/s"
"""
MACHINE = {kind: TABLES[kind] for kind in MACHINE_PARTS}


def extended(folder: Path, case: str = CASE, common: str = COMMON) -> Path:
    (folder / "common.toml").write_text(common)
    (folder / "mine.toml").write_text(case)
    return folder / "mine.toml"


@pytest.mark.parametrize(
    ("value", "unit", "number"),
    [("10 deg", "rad", math.pi / 18), ("1 Hz", "rad/s", 2 * math.pi), ("5 cm", "m", 0.05),
     ("-.5e-1 N m", "N m", -0.05), ("3 rad/s³", "rad/s³", 3.0), (4, "1", 4.0)],
)  # fmt: skip
def test_units_are_converted(value, unit, number) -> None:
    # A conversion is one product or two, of factors that are rounded once.
    assert number_in(value, unit) == pytest.approx(number, rel=4e-16)


# Beyond, a factor leads out of all numbers.
@given(st.floats(-1e300, 1e300), st.sampled_from(sorted(_KNOWN)))
def test_known_factors_convert_as_pint_does(number: float, units: tuple[str, str]) -> None:
    text, unit = units
    converted = float(_registry().Quantity(number, text).to(unit).magnitude)
    assert number_in(f"{number!r} {text}", unit) == converted


@pytest.mark.parametrize(
    ("value", "words"),
    [(6, '6 has no unit: write "6 s"'), ("6", '"6" has no unit'), ("1e999 s", "finite"),
     ("6 parsnip", "'parsnip' is no unit"), ("soon", "is no number with a unit"),
     (True, "must be a number with a unit"), ("0.5 Nm", "cannot be converted to s"),
     ("1 s**2**9**9**9", "is no unit")],
)  # fmt: skip
def test_wrong_units_are_refused(value, words) -> None:
    with pytest.raises(ValueError, match=words):
        number_in(value, "s")
    with pytest.raises(ValueError, match="must be a number without a unit"):
        number_in("4", "1")


@pytest.mark.slow
def test_a_changed_gain_is_seen_by_run_and_validate(tmp_path: Path, monkeypatch) -> None:
    """In a copy of the package's cases, which the package takes for its own."""
    copied = Path(shutil.copytree(shipped.CASES, tmp_path / "cases"))
    monkeypatch.setattr(shipped, "CASES", copied)
    monkeypatch.chdir(tmp_path)
    for name, old, new in (("base", "k = 18", "k = 11"),
                           ("case1", 'law = "grosmc"', 'law = "grosmc"\nk = 12')):  # fmt: skip
        file = copied / "arm" / f"{name}.toml"
        file.write_text(file.read_text().replace(old, new))
    gains = {}
    for name, arguments in (("arm_case1", ("run", "arm/case1")),
                            ("validation", ("validate", "arm", "--no-claims"))):  # fmt: skip
        run(*arguments, "--no-figures", "--out", "out")
        rows = json.loads((Path("out") / f"{name}.json").read_text())["runs"]
        gains[name] = {row["case"]: row["gains"]["k"] for row in rows
                       if row["controller"] == "grosmc"}  # fmt: skip
    assert gains["arm_case1"] == {"case1": 12.0}
    assert gains["validation"] == {"nominal": 11.0, "case1": 12.0, "case2": 11.0}
    experiment = Experiment.load("arm/case1")
    theirs = Laboratory(Settings()).controller(experiment.varied(edits=()), "physics", "grosmc")
    assert experiment.laws["physics", "grosmc"] is theirs


def test_tables_are_merged_and_the_resolved_text_says_the_same_alone(tmp_path: Path) -> None:
    file = read_case_file(extended(tmp_path))
    assert (file.name, file.title, file.plant.system) == ("mine", "common", "arm")
    assert (file.run.duration, dict(file.run.start)) == (0.1, {"joint angle": "0.5 rad"})
    # The file's own, the extended file's, and the numbers of the system's base.
    assert file.law("grosmc").numbers == {"k": 7, "epsilon": 6, "G": [[0, 1]]}
    assert [table.called for table in file.controller] == ["grosmc"]
    for path in (tmp_path / "mine.toml", *shipped.shipped_files().values()):
        text = resolved_text(path)
        assert "extends" not in text
        assert parse_case_file(text, path) == read_case_file(path)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ('"mine.toml"', "mine.toml extends this file in turn"),
        ('"other.toml"', "other.toml: cannot be read: No such file"),
        ('"../common.toml"', "must be a file beside it"),
        ("3", "extends = 3 must be a file beside it"),
    ],
)
def test_a_wrong_base_is_refused(tmp_path: Path, name: str, words: str) -> None:
    path = extended(tmp_path, common=f"extends = {name}\n{COMMON}")
    with pytest.raises(ArgumentError, match=words):
        Experiment.load(path)


def test_settings_of_a_call_count_instead_of_the_files(tmp_path: Path) -> None:
    case = CASE + 'switching = "implicit"\nsurface = "discrete"\n'
    experiment = Experiment.load(extended(tmp_path, case))
    other = experiment.with_settings(switching="boundary-layer", control_period=2e-3, engine=None)
    for one, numbers in ((experiment, ("implicit", 1e-3)), (other, ("boundary-layer", 2e-3))):
        law = one.law("physics", "grosmc").designed
        assert (law.switching, law.control_period) == numbers
    with pytest.raises(ArgumentError, match="unknown setting 'period'"):
        experiment.with_settings(period=1.0)


def test_a_run_has_its_metrics_and_its_requirements() -> None:
    experiment = gm.Experiment.load("servo/nominal").varied(duration=0.5)
    result = experiment.run(plant="corrected", law="grosmc")
    assert result.trajectory.time[-1] == 0.5
    assert result.metrics["deviation"].unit == "rad"
    # Requirements are of physics.
    assert result.requirements == []
    kinds = {"deviation_below", "no_reaching_phase"}
    assert {one.limit.kind for one in experiment.run().requirements} == kinds
    # Half a second does not tell of 5 s.
    assert ["settles within 5 s" in line for line in experiment.not_judged] == [True]
    assert gm.Experiment.load("servo/nominal").not_judged == []


def test_laws_of_a_machine_are_its_own_and_an_assumed_number_is_the_same(tmp_path: Path) -> None:
    servo = {one.case.name: one for one in find_experiments("servo")}
    bench = servo["bench"].law("corrected", "implicit").parameters
    machine = servo["machine"].law("corrected", "implicit").parameters
    assert bench.plant.J == 0.0577
    assert 2.1e-3 < machine.plant.J < 2.2e-3
    delay = STEP + 'input_below = "1 A"\n[computing]\ndelay = "1 ms"\n'
    loops = [load(tmp_path, delay + mark).case.loop for mark in ("", 'assumed = ["delay"]')]
    assert loops[0] == loops[1] is not None


def test_laws_of_the_file_are_run_on_request(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    experiment = Experiment.load(extended(tmp_path, CASE + OTHERS))
    assert [one.controller for one in gm.judge(experiment)] == ["grosmc"]
    chosen = experiment.with_laws(["quite soft"])
    assert [one.controller for one in gm.judge(chosen)] == ["quite soft"]
    assert chosen.run().controller.parameters.k == 5
    with pytest.raises(ArgumentError, match=r"unknown law 'stiff': .*'soft', 'quite soft'"):
        experiment.with_laws(["stiff"])
    run("run", "mine.toml", "--laws", "soft", "grosmc", "--no-figures")
    content = json.loads(Path("renders/mine.json").read_text())
    assert {one["controller"] for one in content["runs"]} == {"soft", "grosmc"}


def test_the_starter_explains_every_key_and_its_machine_is_one(tmp_path: Path) -> None:
    """Without its comment signs, and without the words behind them."""
    starter = shipped.starter()
    tables = schema.RunTable, schema.ClaimTable, schema.DisturbanceTable, schema.EditTable
    for table in (*tables, *MACHINE.values()):
        for key in table.model_fields:
            assert re.search(rf"\b{key}\b", starter.lower()), f"{table.__name__}.{key}"
    for name, table in MACHINE.items():
        (part,) = re.findall(rf"# \[\[{name}\]\](.*?)\n(?:# \[\[|\n)", starter, re.DOTALL)
        for key in table.model_fields.keys() - {"assumed"}:
            assert re.search(rf"\b{key}\b", part), f"[[{name}]] without {key}"
    before, machine, after = re.split(
        r"(# ---- The machine.*?)(?=# ---- The laws)", starter, flags=re.DOTALL
    )
    lines = [line[2:] for line in machine.splitlines() if re.match(r"# (\[\[|\w+ = )", line)]
    plant = load(tmp_path, "\n".join([before, *lines, "", after])).plant("physics")
    assert isinstance(plant, MujocoPlant)
    assert [part.kind for part in plant.parts] == [name.replace("_", " ") for name in MACHINE]
    assert {state.kind for state in plant.hidden_states} == {"twist", "load", "bristle"}
