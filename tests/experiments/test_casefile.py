"""Case files: units, the file that another one extends, and one meaning for all commands."""

from __future__ import annotations

import json
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from campaign_cases import run
from case_texts import ARM
from hypothesis import given
from hypothesis import strategies as st
from shipped import PENDULUM_DISTURBANCE, cases, find_case

import grosmc_mj as gm
from grosmc_mj.assumptions.audit import run_audit
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.catalogue import find_experiment, find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file import schema, shipped
from grosmc_mj.experiments.file.parts import MACHINE_PARTS, TABLES
from grosmc_mj.experiments.file.reading import parse_case_file, read_case_file, resolved_text
from grosmc_mj.experiments.file.shipped import starter
from grosmc_mj.experiments.file.units import _KNOWN, _registry, number_in
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.physics.files import load_model
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants.cart_pendulum import CartPendulumParameters, pole_torque

CASE = """
extends = "common.toml"

[run]
duration = "0.1 s"

[[controller]]
law = "grosmc"
"""
COMMON = """
title = "common"

# What they share.
[plant]
system = "arm"

[run]
start = { "joint angle" = "0.5 rad" }
duration = "2 s"

[laws.grosmc]
k = 7
"""


@pytest.mark.parametrize(
    ("value", "unit", "number"),
    [
        ("10 deg", "rad", math.pi / 18),
        ("180 deg/s", "rad/s", math.pi),
        ("1 Hz", "rad/s", 2 * math.pi),
        ("5 cm", "m", 0.05),
        ("-.5e-1 N m", "N m", -0.05),
        ("2 ms", "s", 0.002),
        ("3 rad/s³", "rad/s³", 3.0),
        (4, "1", 4.0),
    ],
)
def test_units_are_converted(value: object, unit: str, number: float):
    # A conversion is one product or two, of factors that are rounded once.
    assert number_in(value, unit) == pytest.approx(number, rel=4e-16)


# Beyond, a factor leads out of all numbers.
@given(st.floats(-1e300, 1e300), st.sampled_from(sorted(_KNOWN)))
def test_known_factors_convert_as_pint_does(number: float, units: tuple[str, str]) -> None:
    written, unit = units
    converted = float(_registry().Quantity(number, written).to(unit).magnitude)
    assert number_in(f"{number!r} {written}", unit) == converted


@pytest.mark.parametrize(
    ("value", "unit", "said"),
    [
        (6, "s", '6 has no unit: write "6 s"'),
        ("6", "s", '"6" has no unit: write "6 s"'),
        ("6 m", "s", '"6 m" cannot be converted to s'),
        ("6 parsnip", "s", "'parsnip' is no unit"),
        ("soon", "s", "is no number with a unit"),
        (True, "s", "must be a number with a unit"),
        ("1e999 s", "s", "must be finite"),
        ("4", "1", "must be a number without a unit"),
        ("0.5 Nm", "N m", "cannot be converted to N m"),
    ],
)
def test_wrong_units_are_refused(value: object, unit: str, said: str):
    with pytest.raises(ValueError, match=said.replace("(", r"\(")):
        number_in(value, unit)


def test_a_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(ARM)
    file = read_case_file(tmp_path / "mine.toml")
    assert (file.name, file.run.duration, file.run.control_period) == ("mine", 1.0, None)
    assert file.disturbance[0].torque == [0.0, 0.1, 0.0]
    assert file.controller[0].numbers == {"k": 18}


@pytest.fixture
def copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the package's cases, which the package takes for its own."""
    cases = tmp_path / "cases"
    shutil.copytree(shipped.CASES, cases)
    monkeypatch.setattr(shipped, "CASES", cases)
    monkeypatch.chdir(tmp_path)
    return cases


def extended(folder: Path, case: str = CASE, common: str = COMMON) -> Path:
    (folder / "common.toml").write_text(common)
    (folder / "mine.toml").write_text(case)
    return folder / "mine.toml"


def gain(content: dict) -> dict[str, float]:
    """k of GROSMC in each case of a document."""
    runs = [each for each in content["runs"] if each["controller"] == "grosmc"]
    return {each["case"]: each["gains"]["k"] for each in runs}


@pytest.mark.slow
def test_a_changed_gain_is_seen_by_run_validate_and_the_claims(copied: Path) -> None:
    base = copied / "arm" / "base.toml"
    base.write_text(base.read_text().replace("k = 18", "k = 11"))
    own = copied / "arm" / "case1.toml"
    own.write_text(own.read_text().replace('law = "grosmc"', 'law = "grosmc"\nk = 12'))
    run("run", "arm/case1", "--no-figures", "--out", "out")
    run("run", "arm/case2", "--no-figures", "--out", "out")
    run("validate", "arm", "--no-figures", "--no-claims", "--out", "out")
    read = [json.loads((Path("out") / f"{name}.json").read_text()) for name in (
        "arm_case1", "arm_case2", "validation"
    )]  # fmt: skip
    assert gain(read[0]) == {"case1": 12.0}
    assert gain(read[1]) == {"case2": 11.0}
    assert gain(read[2]) == {"nominal": 11.0, "case1": 12.0, "case2": 11.0}
    lab = Laboratory(Settings())
    assert lab.case("arm", "case1", "physics", "grosmc").controller.designed.gains["k"] == 12.0


def test_a_changed_gain_reaches_the_laboratory_and_derived_experiments(copied: Path) -> None:
    base = copied / "servo" / "base.toml"
    base.write_text(base.read_text().replace("reaching_rate = 0.2", "reaching_rate = 0.4"))
    experiment = find_experiment("servo", "case1")
    theirs = Laboratory(Settings()).controller(experiment.varied(edits=()), "physics", "grosmc")
    # eta = J/J_hat times the reaching rate, with J up to three times J_hat.
    assert theirs.designed.gains["eta"] == pytest.approx(1.2, rel=1e-12)
    assert gm.Experiment.load("servo/case1").laws["physics", "grosmc"] is theirs


def test_tables_are_merged_and_arrays_are_the_files_own(tmp_path: Path) -> None:
    file = read_case_file(extended(tmp_path))
    assert (file.name, file.title, file.plant.system) == ("mine", "common", "arm")
    assert (file.run.duration, dict(file.run.start)) == (0.1, {"joint angle": "0.5 rad"})
    # The file's own, the extended file's, and what the system's base says.
    law = file.law("grosmc")
    assert law.numbers == {"k": 7, "epsilon": 6, "G": [[0, 1]]}
    assert [table.called for table in file.controller] == ["grosmc"]


def test_the_resolved_text_says_the_same_alone(tmp_path: Path) -> None:
    for path in (extended(tmp_path), *shipped.shipped_files().values()):
        text = resolved_text(path)
        assert "extends" not in text
        assert parse_case_file(text, path) == read_case_file(path)
    assert "# d(t) acts against the torque, eq. (57)" in resolved_text(
        shipped.shipped_files()["arm/case1"]
    )


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ('"mine.toml"', "mine.toml extends this file in turn"),
        ('"other.toml"', "other.toml: cannot be read: No such file"),
        ('"../common.toml"', "must be a file beside it"),
        ("3", "extends = 3 must be a file beside it"),
    ],
)
def test_a_wrong_base_is_told_in_one_line(tmp_path: Path, name: str, said: str) -> None:
    path = extended(tmp_path, common=f"extends = {name}\n{COMMON}")
    with pytest.raises(ArgumentError) as refused:
        Experiment.load(path)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_bases_are_no_cases() -> None:
    assert [each.case.name for each in find_experiments("arm")] == [
        "nominal",
        "case1",
        "case2",
        "bench",
        "machine",
    ]
    with pytest.raises(ArgumentError, match="unknown case 'arm/base'"):
        find_experiments("arm/base")


def test_settings_that_are_asked_for_count_instead_of_the_files(tmp_path: Path) -> None:
    case = CASE + 'switching = "implicit"\nsurface = "discrete"\n'
    experiment = Experiment.load(extended(tmp_path, case))
    law = experiment.law("physics", "grosmc")
    assert (law.designed.switching, law.designed.control_period) == ("implicit", 1e-3)
    other = experiment.with_settings(switching="boundary-layer", control_period=2e-3, engine=None)
    law = other.law("physics", "grosmc")
    assert (law.designed.switching, law.designed.control_period) == ("boundary-layer", 2e-3)
    with pytest.raises(ArgumentError, match="unknown setting 'period'"):
        experiment.with_settings(period=1.0)


def test_a_run_has_its_metrics_and_what_is_required_of_it() -> None:
    experiment = gm.Experiment.load("servo/nominal").varied(duration=0.5)
    result = experiment.run(plant="corrected", law="grosmc")
    assert result.trajectory.time[-1] == 0.5
    assert result.metrics["deviation"].unit == "rad"
    # Requirements are of physics.
    assert result.requirements == []
    kinds = {"deviation_below", "no_reaching_phase"}
    assert {each.limit.kind for each in experiment.run().requirements} == kinds
    # Half a second does not tell of 5 s.
    assert ["settles within 5 s" in line for line in experiment.not_judged] == [True]
    assert gm.Experiment.load("servo/nominal").not_judged == []


@pytest.mark.slow
def test_a_written_reference_that_moves_is_audited_as_it_moves(tmp_path: Path) -> None:
    """y_r = sin(3 t) asks more of the gain than y_r = 0 for all t, as at t = 0 they are alike."""
    required = []
    for formula in ("sin(3*t)", "0*t"):
        task = f'\n[task]\nreference = ["{formula}"]\nregion = [0.1, 0.1]\n'
        task += '\n[[edit]]\nbody = "link"\nmass_scale = 2\n\n[[controller]]'
        path = extended(tmp_path, CASE.replace("\n[[controller]]", task))
        found = run_audit(Experiment.load(path).run())
        gain = next(each for each in found.premises if each.name == "epsilon")
        assert gain.region is not None
        required.append(-gain.region.margin)
        moved = formula != "0*t"
        assert (gain.region.worst.t > 0) is moved
    assert not np.isclose(*required)


def test_laws_of_a_machine_are_its_own_whatever_was_designed_before() -> None:
    servo = {each.case.name: each for each in find_experiments("servo")}
    bench = servo["bench"].law("corrected", "implicit").parameters
    machine = servo["machine"].law("corrected", "implicit").parameters
    assert bench.plant.J == 0.0577
    assert 2.1e-3 < machine.plant.J < 2.2e-3


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


def test_laws_of_the_file_are_run_on_request(tmp_path: Path) -> None:
    experiment = Experiment.load(extended(tmp_path, CASE + OTHERS))
    assert [one.controller for one in gm.judge(experiment)] == ["grosmc"]
    chosen = experiment.with_laws(["quite soft"])
    assert [one.controller for one in gm.judge(chosen)] == ["quite soft"]
    assert chosen.run().controller.parameters.k == 5
    with pytest.raises(ArgumentError, match=r"unknown law 'stiff': .*'soft', 'quite soft'"):
        experiment.with_laws(["stiff"])


def test_run_and_campaign_take_laws_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    uncertain = '[[uncertain]]\nbody = "link"\nmass_scale = [0.9, 1.1]\n'
    extended(tmp_path, CASE + OTHERS + uncertain)
    run("run", "mine.toml", "--laws", "soft", "grosmc", "--no-figures")
    content = json.loads(Path("renders/mine.json").read_text())
    assert {one["controller"] for one in content["runs"]} == {"soft", "grosmc"}
    run("campaign", "mine.toml", "--laws", "soft", "--runs", "2", "--no-figures", "--out", "c")
    manifest = json.loads(Path("c/manifest.json").read_text())
    assert json.loads(Path("c/results.json").read_text())
    assert "soft" in json.dumps(manifest)


MACHINE = {kind: TABLES[kind] for kind in MACHINE_PARTS}


def test_the_starter_explains_every_key():
    text = starter().lower()
    # What the starter leaves out is for a robot or another kind of profile, and is in its comments.
    tables = (
        schema.RunTable, schema.ClaimTable, schema.DisturbanceTable, schema.EditTable
    )  # fmt: skip
    for table in (*tables, *MACHINE.values()):
        for key in table.model_fields:
            assert re.search(rf"\b{key}\b", text), f"{table.__name__}.{key}"
    for name, table in MACHINE.items():
        (part,) = re.findall(rf"# \[\[{name}\]\](.*?)\n(?:# \[\[|\n)", text, re.DOTALL)
        for key in table.model_fields.keys() - {"assumed"}:
            assert re.search(rf"\b{key}\b", part), f"[[{name}]] without {key}"


def test_the_starters_machine_is_one(tmp_path):
    """Without its comment signs, and with what stands behind them left out."""
    before, machine, after = re.split(
        r"(# ---- The machine.*?)(?=# ---- The laws)", starter(), flags=re.DOTALL
    )
    lines = [line for line in machine.splitlines() if re.match(r"# (\[\[|\w+ = )", line)]
    file = tmp_path / "mine.toml"
    file.write_text("\n".join([before, *(line[2:] for line in lines), "", after]))
    plant = Experiment.load(file).plant("physics")
    assert isinstance(plant, MujocoPlant)
    assert [part.kind for part in plant.parts] == [name.replace("_", " ") for name in MACHINE]
    assert {each.kind for each in plant.hidden_states} == {"twist", "load", "bristle"}


def test_shipped_cases_are_those_of_the_chapter():
    assert [case.name for case in cases("servo")] == [
        "nominal",
        "case1",
        "case2",
        "bench",
        "machine",
    ]
    nominal = CartPendulumParameters.from_model(load_model("cart_pendulum"), "corrected")
    push = find_case("cart_pendulum", "case2").disturbances[0]
    assert push.wrench[4] == -pole_torque(PENDULUM_DISTURBANCE, nominal)
    assert find_case("arm", "case1").x0 == (0.5, math.pi)
