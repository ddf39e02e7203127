"""Case files: units, the file that another one extends, and one meaning for all commands."""

from __future__ import annotations

import json
import math
import re
import shutil
import tomllib
from pathlib import Path

import pytest
from campaign_cases import run
from case_texts import STEP, load
from hypothesis import given
from hypothesis import strategies as st

import grosmc_mj as gm
from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file import schema, shipped
from grosmc_mj.experiments.file.parts import MACHINE_PARTS, PART_KINDS
from grosmc_mj.experiments.file.reading import parse_case_file, read_case_file
from grosmc_mj.experiments.file.text import complete_text, text_of
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.errors import ArgumentError, GrosmcError
from grosmc_mj.ground.units import number_in
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant

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
MACHINE = {kind: PART_KINDS[kind].keys for kind in MACHINE_PARTS}


def extended(folder: Path, case: str = CASE, common: str = COMMON) -> Path:
    """A case file beside the file that it extends."""
    (folder / "common.toml").write_text(common)
    (folder / "mine.toml").write_text(case)
    return folder / "mine.toml"


@pytest.mark.parametrize(
    ("value", "unit", "number"),
    [
        ("10 deg", "rad", math.pi / 18),
        ("1 Hz", "rad/s", 2 * math.pi),
        ("5 cm", "m", 0.05),
        ("-.5e-1 N m", "N m", -0.05),
        ("3 rad/s³", "rad/s³", 3.0),
        (4, "1", 4.0),
    ],
)
def test_units_are_converted(value, unit, number) -> None:
    # A conversion is one product or two, of factors that are rounded once.
    assert number_in(value, unit) == pytest.approx(number, rel=4e-16)


# Products of common units, with the unit that is wanted and the factor.
PRODUCTS = {
    "cm/s": ("m/s", 0.01),
    "mrad/s": ("rad/s", 0.001),
    "deg/s": ("rad/s", math.pi / 180),
    "mN m": ("N m", 0.001),
    "kN/m": ("N/m", 1000.0),
    "kN m/rad": ("N m/rad", 1000.0),
    "mV s/rad": ("V s/rad", 0.001),
    "kg*m^2": ("kg m^2", 1.0),
}


# Beyond, a factor leads out of the numbers that are read.
@given(st.floats(-1e90, 1e90), st.sampled_from(sorted(PRODUCTS)))
def test_a_product_of_units_has_the_product_of_their_factors(number: float, text: str) -> None:
    unit, factor = PRODUCTS[text]
    assert number_in(f"{number!r} {text}", unit) == pytest.approx(number * factor, rel=1e-15)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (6, '6 has no unit: write "6 s"'),
        ("6", '"6" has no unit'),
        ("1e999 s", "finite"),
        ("6 parsnip", "'parsnip' is no unit"),
        ("soon", "is no number with a unit"),
        (True, "must be a number with a unit"),
        ("0.5 Nm", "cannot be converted to s"),
        ("1 s**2**9**9**9", "is no unit"),
    ],
)
def test_wrong_units_are_refused(value, words) -> None:
    with pytest.raises(ValueError, match=words):
        number_in(value, "s")


def test_a_pure_number_has_no_unit() -> None:
    with pytest.raises(ValueError, match="must be a number without a unit"):
        number_in("4", "1")


def gains_in(path: Path) -> dict[str, float]:
    """The gain k of GROSMC in each case of a result."""
    runs = json.loads(path.read_text())["runs"]
    return {run["case"]: run["gains"]["k"] for run in runs if run["controller"] == "grosmc"}


@pytest.fixture
def changed_gains(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A copy of the package's cases, which it takes for its own: k = 11, and 12 in case1."""
    cases = Path(shutil.copytree(shipped.CASES, tmp_path / "cases"))
    monkeypatch.setattr(shipped, "CASES", cases)
    monkeypatch.chdir(tmp_path)
    base = cases / "arm" / "base.toml"
    base.write_text(base.read_text().replace("k = 18", "k = 11"))
    case1 = cases / "arm" / "case1.toml"
    case1.write_text(case1.read_text().replace('law = "grosmc"', 'law = "grosmc"\nk = 12'))


@pytest.mark.slow
@pytest.mark.usefixtures("changed_gains")
def test_a_changed_gain_is_seen_by_run() -> None:
    run("run", "arm/case1", "--no-figures", "--out", "out")
    assert gains_in(Path("out/arm_case1.json")) == {"case1": 12.0}


@pytest.mark.slow
@pytest.mark.usefixtures("changed_gains")
def test_a_changed_gain_is_seen_by_validate() -> None:
    run("validate", "arm", "--no-claims", "--no-figures", "--out", "out")
    gains = gains_in(Path("out/validation.json"))
    assert gains == {"nominal": 11.0, "case1": 12.0, "case2": 11.0}


@pytest.mark.usefixtures("changed_gains")
def test_experiments_share_their_laws_with_claims() -> None:
    experiment = Experiment.load("arm/case1")
    without_edits = experiment.changed(edits=())
    law = RunCache(Settings()).controller(without_edits, "physics", "grosmc")
    assert experiment.laws["physics", "grosmc"] is law


def test_tables_are_merged_key_by_key(tmp_path: Path) -> None:
    file = read_case_file(extended(tmp_path))
    assert file.title == "common"
    assert file.plant.system == "arm"
    assert file.run.duration == 0.1
    assert dict(file.run.start) == {"joint angle": "0.5 rad"}
    # The extended file's number, and those of the system's base.
    assert file.law("grosmc").numbers == {"k": 7, "epsilon": 6, "G": [[0, 1]]}


def test_the_name_is_the_files_own(tmp_path: Path) -> None:
    assert read_case_file(extended(tmp_path)).name == "mine"


def test_a_base_does_not_give_its_name_to_the_files_that_extend_it(tmp_path: Path) -> None:
    path = extended(tmp_path, common=f'name = "base"\n{COMMON}')
    assert read_case_file(path).name == "mine"


def test_arrays_of_tables_are_the_files_own(tmp_path: Path) -> None:
    file = read_case_file(extended(tmp_path))
    assert [table.called for table in file.controller] == ["grosmc"]


def test_the_complete_text_of_a_file_is_its_whole_content(tmp_path: Path) -> None:
    path = extended(tmp_path)
    text = complete_text(path)
    assert "extends" not in text
    assert parse_case_file(text, path) == read_case_file(path)


@pytest.mark.parametrize("name", shipped.shipped_files())
def test_the_complete_text_of_a_shipped_file_is_its_whole_content(name: str) -> None:
    path = shipped.shipped_files()[name]
    text = complete_text(path)
    assert "extends" not in text
    assert parse_case_file(text, path) == read_case_file(path)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ('"mine.toml"', "mine.toml extends this file in turn"),
        ('"other.toml"', "common.toml: extends: there is no other.toml beside it"),
        ('"../common.toml"', "must be a file beside it"),
        ('"servo/machin"', "unknown case 'servo/machin': did you mean 'servo/machine'?"),
        ('"servos"', "unknown case 'servos': .*or a file beside it, whose name ends in .toml"),
        ('"/etc/passwd"', "unknown case '/etc/passwd'"),
        ("3", "extends = 3 must be a file beside it"),
    ],
)
def test_a_wrong_base_is_refused(tmp_path: Path, name: str, words: str) -> None:
    path = extended(tmp_path, common=f"extends = {name}\n{COMMON}")
    with pytest.raises(ArgumentError, match=words):
        Experiment.load(path)


IMPLICIT = """
extends = "common.toml"
[run]
duration = "0.1 s"
[[controller]]
law = "grosmc"
switching = "implicit"
surface = "discrete"
"""


def test_settings_of_a_file_count_without_a_call(tmp_path: Path) -> None:
    law = Experiment.load(extended(tmp_path, IMPLICIT)).law("physics", "grosmc").designed
    assert law.switching == "implicit"
    assert law.control_period == 1e-3


def test_settings_of_a_call_count_instead_of_the_files(tmp_path: Path) -> None:
    experiment = Experiment.load(extended(tmp_path, IMPLICIT))
    changed = experiment.changed(switching="boundary-layer", control_period=2e-3, engine=None)
    law = changed.law("physics", "grosmc").designed
    assert law.switching == "boundary-layer"
    assert law.control_period == 2e-3


def test_an_unknown_setting_is_refused(tmp_path: Path) -> None:
    experiment = Experiment.load(extended(tmp_path))
    with pytest.raises(ArgumentError, match="unknown attribute or setting 'period'"):
        experiment.changed(period=1.0)


@pytest.fixture(scope="module")
def short_servo() -> gm.Experiment:
    return gm.Experiment.load("servo/nominal").changed(duration=0.5)


def test_a_run_has_its_metrics(short_servo: gm.Experiment) -> None:
    result = short_servo.run(plant="corrected", law="grosmc")
    assert result.trajectory.time[-1] == 0.5
    assert result.metrics["deviation"].unit == "rad"


def test_requirements_are_of_physics(short_servo: gm.Experiment) -> None:
    assert short_servo.run(plant="corrected", law="grosmc").requirements == []
    kinds = {judgement.requirement.key for judgement in short_servo.run().requirements}
    assert kinds == {"deviation_below", "no_reaching_phase"}


def test_a_short_run_does_not_judge_a_long_settling_time(short_servo: gm.Experiment) -> None:
    (line,) = short_servo.not_judged
    assert "settles within 5 s" in line
    assert gm.Experiment.load("servo/nominal").not_judged == []


def test_laws_of_a_machine_are_its_own() -> None:
    servo = {experiment.name: experiment for experiment in find_experiments("servo")}
    bench = servo["bench"].law("corrected", "implicit").parameters
    machine = servo["machine"].law("corrected", "implicit").parameters
    assert bench.plant.J == 0.0577
    assert 2.1e-3 < machine.plant.J < 2.2e-3


DELAY = STEP + 'input_below = "1 A"\n[computing]\ndelay = "1 ms"\n'


def test_an_assumed_number_is_a_number(tmp_path: Path) -> None:
    loop = load(tmp_path, DELAY).loop
    assert loop is not None
    assert load(tmp_path, DELAY + 'assumed = ["delay"]').loop == loop


def test_all_controllers_of_a_file_are_run(tmp_path: Path) -> None:
    experiment = Experiment.load(extended(tmp_path, CASE + OTHERS))
    assert [judgement.controller for judgement in gm.judge(experiment)] == ["grosmc"]


def test_laws_of_the_file_are_run_on_request(tmp_path: Path) -> None:
    experiment = Experiment.load(extended(tmp_path, CASE + OTHERS)).changed(laws=["quite soft"])
    assert [judgement.controller for judgement in gm.judge(experiment)] == ["quite soft"]
    assert experiment.run().controller.parameters.k == 5


def test_a_law_that_the_file_does_not_have_is_refused(tmp_path: Path) -> None:
    experiment = Experiment.load(extended(tmp_path, CASE + OTHERS))
    with pytest.raises(ArgumentError, match=r"unknown law 'stiff': .*'soft', 'quite soft'"):
        experiment.changed(laws=["stiff"])


def test_the_command_runs_laws_on_request(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    extended(tmp_path, CASE + OTHERS)
    run("run", "mine.toml", "--laws", "soft", "grosmc", "--no-figures")
    content = json.loads(Path("renders/mine.json").read_text())
    assert {run["controller"] for run in content["runs"]} == {"soft", "grosmc"}


STARTER = shipped.starter()


@pytest.mark.parametrize(
    "keys",
    [
        schema.RunTable.model_fields,
        schema.ClaimTable.model_fields,
        *[kind.keys for kind in PART_KINDS.values()],
    ],
)
def test_the_starter_explains_every_key(keys) -> None:
    for key in keys:
        assert re.search(rf"\b{key}\b", STARTER.lower()), key


@pytest.mark.parametrize(("name", "keys"), MACHINE.items())
def test_the_starter_explains_every_key_of_a_part_at_its_table(name: str, keys) -> None:
    (part,) = re.findall(rf"# \[\[{name}\]\](.*?)\n(?:# \[\[|\n)", STARTER, re.DOTALL)
    for key in set(keys) - {"assumed"}:
        assert re.search(rf"\b{key}\b", part), key


def test_the_machine_of_the_starter_is_one(tmp_path: Path) -> None:
    """Without its comment signs, and without the words behind them."""
    before, machine, after = re.split(
        r"(# ---- The machine.*?)(?=# ---- The laws)", STARTER, flags=re.DOTALL
    )
    lines = [line[2:] for line in machine.splitlines() if re.match(r"# (\[\[|\w+ = )", line)]
    plant = load(tmp_path, "\n".join([before, *lines, "", after])).plant("physics")
    assert isinstance(plant, MujocoPlant)
    assert [part.kind for part in plant.parts] == [name.replace("_", " ") for name in MACHINE]
    assert {state.kind for state in plant.hidden_states} == {"twist", "bristle"}


# A case of the package as a base.

OWN_WEIGHTS = """
extends = "{case}"
[task]
R = {R}
"""


def of_case(folder: Path, case: str, **numbers: object) -> Experiment:
    path = folder / "mine.toml"
    path.write_text(OWN_WEIGHTS.format(case=case, R=numbers.get("R", 2.0)), encoding="utf-8")
    return Experiment.load(path)


def test_a_shipped_machine_runs_with_weights_of_ones_own(tmp_path: Path) -> None:
    shipped_machine = Experiment.load("servo/machine")
    mine = of_case(tmp_path, "servo/machine", R=0.25)
    assert mine.name == "mine"
    assert mine.edits == shipped_machine.edits
    assert mine.loop == shipped_machine.loop
    # For the double integrator of eq. (7) a weight of a quarter doubles the gain of the angle.
    gains = [e.law("physics", "lqr").designed.gains["K1"] for e in (mine, shipped_machine)]
    assert gains[0] / gains[1] == pytest.approx(2.0)


def test_a_chain_of_files_may_end_in_the_package(tmp_path: Path) -> None:
    of_case(tmp_path, "servo/case1")
    further = tmp_path / "further.toml"
    further.write_text('extends = "mine.toml"\n[run]\nduration = "0.02 s"\n', encoding="utf-8")
    experiment = Experiment.load(further)
    assert experiment.duration == 0.02
    assert experiment.file.task.R == 2.0
    assert experiment.disturbances == Experiment.load("servo/case1").disturbances


def test_a_system_is_the_file_that_its_cases_share(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    run = '[run]\nduration = "0.02 s"\n'
    path.write_text(f'extends = "servo"\n{run}[[controller]]\nlaw = "lqr"\n', encoding="utf-8")
    assert Experiment.load(path).system == "servo"


@pytest.mark.parametrize("case", ["ball_beam/balance", "maglev/warm", "own_laws/pid"])
def test_files_that_a_shipped_case_names_are_found_beside_it(case: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'extends = "{case}"\n', encoding="utf-8")
    mine = Experiment.load(path)
    theirs = Experiment.load(case)
    assert mine.controllers == theirs.controllers
    assert mine.nominal.system.name == theirs.nominal.system.name
    assert parse_case_file(complete_text(path), path) == read_case_file(path)


def test_a_folder_called_like_a_system_is_not_looked_into(tmp_path: Path) -> None:
    (tmp_path / "servo").mkdir()
    (tmp_path / "servo" / "machine.toml").write_text("[run]\nduration = 1.0\n", encoding="utf-8")
    assert of_case(tmp_path, "servo/machine").parts


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ([1, 2.5], "k = [1, 2.5]"),
        (["0 N m", "a, b"], 'k = ["0 N m", "a, b"]'),
        ([[1, 2], [3]], "k = [\n    [\n        1,\n        2,\n    ],"),
        (["x" * 60, "y" * 60], f'k = [\n    "{"x" * 60}",\n    "{"y" * 60}",\n]'),
    ],
    ids=["numbers", "texts", "lists of lists", "long"],
)
def test_short_lists_are_written_in_one_line(value: list[object], text: str):
    written = text_of({"k": value})
    assert written.startswith(text)
    assert tomllib.loads(written) == {"k": value}


# Requirements that a base has for its own laws.

OWN_LAWS = (
    'extends = "cart_pendulum/case1"\n[run]\nduration = "0.02 s"\n[[controller]]\nlaw = "{}"\n'
)


def test_a_law_of_the_base_s_requirements_that_the_file_lacks_is_told_with_its_base(
    tmp_path: Path,
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(OWN_LAWS.format("lqr"), encoding="utf-8")
    with pytest.raises(ArgumentError) as refused:
        Experiment.load(path)
    line = str(refused.value).removeprefix(f"{path}: ")
    assert line.startswith("requirement 1 of cart_pendulum/case1: unknown controller 'grosmc'")
    assert line.endswith("; tables of your own replace those of cart_pendulum/case1")


@pytest.mark.parametrize(
    ("table", "mistake"),
    [
        ('[[requirement]]\ndeviation_below = "1 m"', "requirement 1 of common.toml: "),
        ('[[disturbance]]\ninput = "no"\namplitude = "1 N m"', "disturbance 1 of common.toml: "),
    ],
)
def test_a_mistake_in_a_table_of_the_base_names_the_base(
    table: str, mistake: str, tmp_path: Path
) -> None:
    path = extended(tmp_path, common=f"{COMMON}\n{table}\n")
    with pytest.raises(GrosmcError, match=mistake):
        Experiment.load(path)
