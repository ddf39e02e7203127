"""Case files: units, the file that another one extends, and one meaning for all commands."""

from __future__ import annotations

import json
import math
import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

import cases
import pytest
from cases import case
from commands import run

from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file import schema, shipped
from grosmc_mj.experiments.file.parts import MACHINE_PARTS, PART_KINDS
from grosmc_mj.experiments.file.reading import parse_case_file, read_case_file
from grosmc_mj.experiments.file.shipped import shipped_files, written_beside
from grosmc_mj.experiments.file.text import complete_text, text_of
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.errors import ArgumentError, GrosmcError
from grosmc_mj.ground.units import number_in
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant

# Units: all that there are in tests/ground/test_units.py


@pytest.mark.parametrize(
    ("value", "unit", "number"),
    [("10 deg", "rad", math.pi / 18), ("-.5e-1 N m", "N m", -0.05), (4, "1", 4.0)],
)
def test_numbers_with_units_are_converted(value, unit, number) -> None:
    # A conversion is one product or two, of factors that are rounded once.
    assert number_in(value, unit) == pytest.approx(number, rel=4e-16)


@pytest.mark.parametrize(
    ("value", "unit", "words"),
    [
        (6, "s", '6 has no unit: write "6 s"'),
        ("6", "s", '"6" has no unit'),
        ("1e999 s", "s", "finite"),
        ("soon", "s", "is no number with a unit"),
        (True, "s", "must be a number with a unit"),
        ("4", "1", "must be a number without a unit"),
    ],
)
def test_texts_without_a_number_or_a_unit_are_refused(value, unit, words) -> None:
    with pytest.raises(ValueError, match=words):
        number_in(value, unit)


# Numbers of the package's own cases


@pytest.fixture
def changed_gains(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A copy of the package's cases, which it takes for its own: k = 11, and 12 in case1."""
    copy = Path(shutil.copytree(shipped.CASES, tmp_path / "cases"))
    monkeypatch.setattr(shipped, "CASES", copy)
    base = copy / "arm" / "base.toml"
    base.write_text(base.read_text().replace("k = 18", "k = 11"))
    case1 = copy / "arm" / "case1.toml"
    case1.write_text(case1.read_text().replace('law = "grosmc"', 'law = "grosmc"\nk = 12'))


@pytest.mark.usefixtures("changed_gains")
def test_a_changed_gain_is_seen_by_all_cases_that_take_it() -> None:
    experiments = {experiment.name: experiment for experiment in find_experiments("arm")}
    gains = {
        name: experiments[name].law("physics", "grosmc").parameters.k
        for name in ("nominal", "case1", "case2")
    }
    assert gains == {"nominal": 11.0, "case1": 12.0, "case2": 11.0}


@pytest.mark.usefixtures("changed_gains")
def test_experiments_share_their_laws_with_claims() -> None:
    experiment = Experiment.load("arm/case1")
    without_edits = experiment.changed(edits=())
    law = RunCache(Settings()).controller(without_edits, "physics", "grosmc")
    assert experiment.laws["physics", "grosmc"] is law


def test_laws_of_a_machine_are_its_own() -> None:
    servo = {experiment.name: experiment for experiment in find_experiments("servo")}
    bench = servo["bench"].law("corrected", "implicit").parameters
    machine = servo["machine"].law("corrected", "implicit").parameters
    assert bench.plant.J == 0.0577
    assert 2.1e-3 < machine.plant.J < 2.2e-3


# A file that extends another one

COMMON: dict[str, Any] = {
    "title": "common",
    "plant": {"system": "arm"},
    "run": {"start": {"joint angle": "0.5 rad"}, "duration": "2 s"},
    "laws": {"grosmc": {"k": 7}},
}
MINE: dict[str, Any] = {
    "extends": "common.toml",
    "run": {"duration": "0.1 s"},
    "controller": [{"law": "grosmc"}],
}


def extended(
    folder: Path, mine: dict[str, Any] | None = None, common: dict[str, Any] | None = None
) -> Path:
    """A case file beside the file that it extends, with further values in both."""
    (folder / "common.toml").write_text(text_of(COMMON | (common or {})), encoding="utf-8")
    path = folder / "mine.toml"
    path.write_text(text_of(MINE | (mine or {})), encoding="utf-8")
    return path


def test_tables_are_merged_key_by_key_and_arrays_of_tables_are_the_files_own(tmp_path) -> None:
    """A base's own name is not that of the file."""
    edit = {"body": "link", "mass_scale": 2}
    file = read_case_file(
        extended(
            tmp_path,
            common={"name": "base", "controller": [{"law": "lqr"}], "edit": [edit]},
        )
    )
    assert (file.title, file.name, file.plant.system) == ("common", "mine", "arm")
    assert (file.run.duration, dict(file.run.start)) == (0.1, {"joint angle": "0.5 rad"})
    # The extended file's number, and those of the system's base.
    assert file.law("grosmc").numbers == {"k": 7, "epsilon": 6, "G": [[0, 1]]}
    assert [table.called for table in file.controller] == ["grosmc"]
    assert len(file.edit) == 1


def test_the_complete_text_of_a_file_is_its_whole_content(tmp_path: Path) -> None:
    path = extended(tmp_path)
    text = complete_text(path)
    assert "extends" not in text
    assert parse_case_file(text, path) == read_case_file(path)


@pytest.mark.parametrize("name", shipped_files())
def test_the_complete_text_of_a_shipped_file_is_its_whole_content(name: str) -> None:
    path = shipped_files()[name]
    text = complete_text(path)
    assert "extends" not in text
    assert parse_case_file(text, path) == read_case_file(path)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mine.toml", "mine.toml extends this file in turn"),
        ("other.toml", "common.toml: extends: there is no other.toml beside it"),
        ("../common.toml", "must be a file beside it"),
        ("servo/machin", "unknown case 'servo/machin': did you mean 'servo/machine'?"),
        ("servos", "unknown case 'servos': .*or a file beside it, whose name ends in .toml"),
        ("/etc/passwd", "unknown case '/etc/passwd'"),
        (3, "extends = 3 must be a file beside it"),
    ],
)
def test_a_wrong_base_is_refused(tmp_path: Path, name: str | int, words: str) -> None:
    path = extended(tmp_path, common={"extends": name})
    with pytest.raises(ArgumentError, match=words):
        Experiment.load(path)


def test_a_law_of_the_base_s_requirements_that_the_file_lacks_is_told_with_its_base(
    tmp_path: Path,
) -> None:
    mine = {"extends": "cart_pendulum/case1", "run": {"duration": "0.02 s"}}
    path = extended(tmp_path, mine | {"controller": [{"law": "lqr"}]})
    with pytest.raises(ArgumentError) as refused:
        Experiment.load(path)
    line = str(refused.value).removeprefix(f"{path}: ")
    assert line.startswith("requirement 1 of cart_pendulum/case1: unknown controller 'grosmc'")
    assert line.endswith("; tables of your own replace those of cart_pendulum/case1")


WRONG_LIMIT = {"requirement": [{"deviation_below": "1 m"}]}
WRONG_LOAD = {"disturbance": [{"input": "no", "amplitude": "1 N m"}]}


@pytest.mark.parametrize(
    ("mine", "common", "words"),
    [
        ({}, WRONG_LIMIT, "requirement 1 of common.toml: "),
        ({}, WRONG_LOAD, "disturbance 1 of common.toml: "),
        (WRONG_LIMIT, WRONG_LIMIT, "requirement 1: "),
    ],
)
def test_a_mistake_in_a_table_of_the_base_names_the_base(tmp_path, mine, common, words) -> None:
    path = extended(tmp_path, mine, common)
    with pytest.raises(GrosmcError, match=words):
        Experiment.load(path)


# A case of the package as a base


def of_case(folder: Path, base: str, **tables: Any) -> Experiment:
    """A file of one's own on a case of the package."""
    path = folder / "mine.toml"
    path.write_text(text_of({"extends": base, **tables}), encoding="utf-8")
    return Experiment.of_file(read_case_file(path), path)


def test_a_shipped_machine_runs_with_weights_of_ones_own(tmp_path: Path) -> None:
    """For the double integrator of eq. (7) a weight of a quarter doubles the angle's gain."""
    shipped_machine = Experiment.load("servo/machine")
    mine = of_case(tmp_path, "servo/machine", task={"R": 0.25})
    assert (mine.name, mine.edits, mine.loop) == (
        "mine",
        shipped_machine.edits,
        shipped_machine.loop,
    )
    gains = [e.law("physics", "lqr").designed.gains["K1"] for e in (mine, shipped_machine)]
    assert gains[0] / gains[1] == pytest.approx(2.0)


def test_a_chain_of_files_may_end_in_the_package(tmp_path: Path) -> None:
    of_case(tmp_path, "servo/case1", task={"R": 2.0})
    further = tmp_path / "further.toml"
    further.write_text('extends = "mine.toml"\n[run]\nduration = "0.02 s"\n', encoding="utf-8")
    experiment = Experiment.load(further)
    assert experiment.duration == 0.02
    assert experiment.file.task.R == 2.0
    assert experiment.disturbances == Experiment.load("servo/case1").disturbances


def test_a_system_is_the_file_that_its_cases_share(tmp_path: Path) -> None:
    tables = {"run": {"duration": "0.02 s"}, "controller": [{"law": "lqr"}]}
    assert of_case(tmp_path, "servo", **tables).checked().system == "servo"


@pytest.mark.parametrize("base", ["ball_beam/balance", "own_laws/pid"])
def test_files_that_a_shipped_case_names_are_found_beside_it(base: str, tmp_path: Path) -> None:
    mine = of_case(tmp_path, base)
    plant, law = mine.plant_names[0], mine.controllers[0]
    assert mine.law(plant, law).name == law
    assert mine.plant(plant).system.name == Experiment.load(base).nominal.system.name
    assert parse_case_file(complete_text(mine.path), mine.path) == read_case_file(mine.path)


def test_a_folder_called_like_a_system_is_not_looked_into(tmp_path: Path) -> None:
    (tmp_path / "servo").mkdir()
    (tmp_path / "servo" / "machine.toml").write_text("[run]\nduration = 1.0\n", encoding="utf-8")
    assert of_case(tmp_path, "servo/machine").parts


# Settings, laws and requirements


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, ("implicit", 1e-3)),
        (
            {"switching": "boundary-layer", "control_period": 2e-3, "engine": None},
            ("boundary-layer", 2e-3),
        ),
    ],
)
def test_settings_of_a_call_count_instead_of_the_files(changes, expected) -> None:
    law = {"law": "grosmc", "switching": "implicit", "surface": "discrete"}
    experiment = case("arm", controller=law).changed(**changes)
    designed = experiment.law("physics", "grosmc").designed
    assert (designed.switching, designed.control_period) == expected


def test_requirements_are_of_physics_and_as_long_as_the_run() -> None:
    """The servo's nominal case asks for a settling time of 5 s."""
    nominal = Experiment.load("servo/nominal")
    short = nominal.changed(duration=0.02)
    assert short.run(plant="corrected", law="grosmc").requirements == []
    judged = {judgement.requirement.key for judgement in short.run().requirements}
    assert judged == {"deviation_below", "no_reaching_phase"}
    assert nominal.not_judged == []
    (line,) = short.not_judged
    assert "settles within 5 s" in line


def test_an_assumed_number_is_a_number() -> None:
    loops = [
        case("servo", computing={"delay": "1 ms"} | more).loop
        for more in ({}, {"assumed": ["delay"]})
    ]
    assert loops[0] is not None
    assert loops[0] == loops[1]


SEVERAL: dict[str, Any] = {
    "controller": [{"law": "grosmc"}],
    "laws": {
        "soft": {"law": "grosmc", "k": 3, "epsilon": 90},
        "quite soft": {"law": "grosmc", "k": 5, "epsilon": 90},
    },
    "requirement": [{"sliding_below": "1e9 rad/s"}],
}


def test_laws_of_the_file_are_run_on_request() -> None:
    experiment = case("arm", **SEVERAL)
    assert experiment.controllers == ["grosmc"]
    requested = experiment.changed(laws=["quite soft"])
    assert [item.controller for item in requested.run().requirements] == ["quite soft"]
    assert requested.run().controller.parameters.k == 5
    with pytest.raises(ArgumentError, match=r"unknown law 'stiff': .*'soft', 'quite soft'"):
        experiment.changed(laws=["stiff"])


def test_the_command_runs_laws_on_request(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    cases.write(tmp_path, "arm", **SEVERAL)
    run("run", "mine.toml", "--laws", "soft", "grosmc", "--no-figures")
    content = json.loads(Path("renders/mine.json").read_text())
    assert {run["controller"] for run in content["runs"]} == {"soft", "grosmc"}


# The starter

STARTER = shipped.starter()
MACHINE = {kind: PART_KINDS[kind].keys for kind in MACHINE_PARTS}


@pytest.mark.parametrize(
    "keys",
    [
        schema.RunTable.model_fields,
        schema.ClaimTable.model_fields,
        *[kind.keys for kind in PART_KINDS.values()],
    ],
)
def test_the_starter_explains_every_key(keys) -> None:
    words = set(re.findall(r"\w+", STARTER.lower()))
    assert set(keys) <= words


@pytest.mark.parametrize(("name", "keys"), MACHINE.items())
def test_the_starter_explains_every_key_of_a_part_at_its_table(name: str, keys) -> None:
    (part,) = re.findall(rf"# \[\[{name}\]\](.*?)\n(?:# \[\[|\n)", STARTER, re.DOTALL)
    assert set(keys) - {"assumed"} <= set(re.findall(r"\w+", part))


def test_the_machine_of_the_starter_is_one(tmp_path: Path) -> None:
    """Without its comment signs, and without the words behind them."""
    before, machine, after = re.split(
        r"(# ---- The machine.*?)(?=# ---- The laws)", STARTER, flags=re.DOTALL
    )
    lines = [line[2:] for line in machine.splitlines() if re.match(r"# (\[\[|\w+ = )", line)]
    path = tmp_path / "mine.toml"
    file = parse_case_file("\n".join([before, *lines, "", after]), path)
    plant = Experiment.of_file(file, path).plant("physics")
    assert isinstance(plant, MujocoPlant)
    assert [part.kind for part in plant.parts] == [name.replace("_", " ") for name in MACHINE]
    assert {state.kind for state in plant.hidden_states} == {"twist", "bristle"}


# Files that commands write


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


@pytest.mark.parametrize(
    ("made_of", "place"),
    [
        (Path("folder/mine.toml"), Path("folder/new.toml")),
        # Nothing is written beside a case of the package.
        (shipped_files()["servo/bench"], Path("renders/new.toml")),
        (shipped_files()["logs/arm"], Path("renders/new.toml")),
    ],
)
def test_a_case_is_written_beside_the_one_it_is_made_of(made_of: Path, place: Path) -> None:
    assert written_beside(made_of, Path("renders"), "new.toml") == place
