"""The case file of one plant of a campaign: its run has the numbers that the campaign stored."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaign_cases import (
    BOTH,
    LOOP,
    MACHINE,
    PAIR,
    begun,
    campaign,
    falling,
    kept,
    of,
    refusal,
    servo,
    standing,
)
from case_texts import LEG_MODEL

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.number import written
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements.metrics import DEFINITIONS
from grosmc_mj.ground.units import number_in
from grosmc_mj.studies.campaign.batch import Batch
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.folder import Folder
from grosmc_mj.studies.campaign.plant_file import ChosenPlant, case_text, find_plant, searched_plant
from grosmc_mj.studies.campaign.screening import screening_of
from grosmc_mj.studies.campaign.work import part_runner
from grosmc_mj.studies.sweep.runs import MARGIN, Outcomes, Row, run_rows

STORED = [name for name, definition in DEFINITIONS.items() if definition.stored]
DAMPING = of("joint", "shaft", "damping = [0, 1]")
# All that a predicting law would otherwise take from the drawn loop.
DELAYS = """
[[uncertain]]
number = "sensor.rotor angle.noise"
values = ["0 mrad", "0.3 mrad"]
[[uncertain]]
number = "computing.delay"
values = ["1 ms", "4 ms"]
[[uncertain]]
number = "actuator.current.limit"
values = ["3 A", "4 A"]
[[uncertain]]
number = "actuator.current.lag"
values = ["1 ms", "2 ms"]
"""
PARTS = """
[[uncertain]]
number = "lugre.shaft.coulomb"
values = ["0.05 N m", "0.06 N m"]
[[uncertain]]
number = "motor.current.resistance"
values = ["2 ohm", "3 ohm"]
[[uncertain]]
number = "transmission.shaft.backlash"
values = ["0 mrad", "1 mrad"]
[[uncertain]]
number = "wall.rotor.radius"
values = ["1 cm", "2 cm"]
"""
# Sine, start, length and a point mass, on a plant with several inputs.
TWO_LINKS = """
[plant]
system = "two_link_arm"
[run]
duration = "0.05 s"
control_period = "1 ms"
start = { "shoulder angle" = "0.6 rad", "elbow angle" = "-1.2 rad" }
[[disturbance]]
body = "payload"
force = ["0 N", "0 N", "5 N"]
profile = "sine"
frequency = "1 Hz"
label = "tip"
[[uncertain]]
number = "edit.payload.added_mass"
values = ["0 kg", "1 kg"]
at = ["1 cm", "0 m", "0 m"]
[[uncertain]]
number = "disturbance.tip.scale"
name = "tip amplitude"
values = [0, 1]
nominal = 0
[[uncertain]]
number = "disturbance.tip.frequency"
values = ["0.5 Hz", "2 Hz"]
[[uncertain]]
number = "disturbance.tip.phase"
values = ["0 deg", "360 deg"]
[[uncertain]]
number = "run.start.shoulder angle"
values = ["0.5 rad", "0.7 rad"]
[[controller]]
law = "pd"
[[requirement]]
stays_within = "3 cm"
after = "0.02 s"
on = ["physics"]
"""
EDITED = """
[[edit]]
body = "rotor"
length_scale = 1.1
[[edit]]
joint = "shaft"
friction = 0.1
"""

ELSEWHERE = """
[[disturbance]]
input = "current"
amplitude = "0.2 A"
profile = "table"
values = [1, -1]
hold = "3 ms"
periodic = true
label = "ripple"
[[disturbance]]
measured = "rotor angle"
amplitude = "2 mrad"
label = "glitch"
[[uncertain]]
number = "disturbance.ripple.scale"
name = "ripple amplitude"
values = [0, 1]
nominal = 0
[[uncertain]]
number = "disturbance.glitch.scale"
name = "glitch amplitude"
values = [-1, 1]
nominal = 0
"""

CAMPAIGNS = {
    "an input and a measured state": servo("") + ELSEWHERE,
    "bodies, joints and a pulse": servo(BOTH + DAMPING) + EDITED,
    "two links": TWO_LINKS,
    "a loop with noise": standing(DELAYS, LOOP),
    "a machine": standing(PARTS, MACHINE),
}


def written_file(declared: Campaign, plant: ChosenPlant, path: Path) -> Path:
    """The case file of a plant, complete."""
    path.write_text(case_text(declared, plant))
    return path


def again(file: Path, law: str, kind: PlantName) -> Outcomes:
    """The one run of a case file, measured as campaigns do."""
    return run_rows(Experiment.load(file), [Row(law)], plant=kind)


def assert_equal_to_the_bit(outcome: Outcomes, stored: dict[str, Any]) -> None:
    """The first run of an outcome has the stored numbers."""
    margins = [MARGIN + limit.name for limit in outcome.limits]
    for name in (*STORED, *margins, "relative", "ended"):
        assert outcome[name][0].tobytes() == np.asarray(stored[name]).tobytes(), name
    assert outcome["status"][0] == stored["status"]


def stored_row(declared: Campaign, folder: Folder, number: int, law: str) -> dict[str, Any]:
    """The row of a run by column."""
    margins = [MARGIN + limit.name for limit in declared.requirements]
    names = [*STORED, *margins, "relative", "ended", "status"]
    part, place = divmod(number, declared.specification.shard)
    columns = folder.columns(declared, names, [part])[law]
    return {name: columns[name][place] for name in names}


def assert_repeated(declared: Campaign, folder: Folder, which: str, law: str, path: Path) -> None:
    """The run of a plant's case file has the numbers of its row."""
    plant = find_plant(declared, folder, which, law)
    outcome = again(written_file(declared, plant, path), law, plant.kind)
    row = stored_row(declared, folder, plant.run, law)
    assert_equal_to_the_bit(outcome, row)


@pytest.mark.slow
@pytest.mark.parametrize("text", CAMPAIGNS.values(), ids=list(CAMPAIGNS))
def test_the_run_of_a_plant_s_file_has_the_numbers_of_its_row(text: str, tmp_path: Path) -> None:
    declared = campaign(text, seed=5, runs=4)
    folder = kept(declared, tmp_path / "out")
    for law in declared.laws:
        assert_repeated(declared, folder, "3", law, tmp_path / "plant.toml")


def test_a_run_that_ended_early_ends_again_at_the_same_instant(tmp_path: Path) -> None:
    folder = kept(falling(), tmp_path / "out")
    status = folder.columns(falling(), ["status"], [0])["fl-lqr"]["status"]
    early = str(np.flatnonzero(status == "undefined_law")[0])
    assert_repeated(falling(), folder, early, "fl-lqr", tmp_path / "plant.toml")


ON_PHYSICS = """
[[requirement]]
on = ["physics"]
deviation_below = "3 mrad"
"""


@pytest.fixture(scope="module")
def screened(tmp_path_factory: pytest.TempPathFactory) -> tuple[Campaign, Folder]:
    """A campaign some of whose runs equations judged, and its folder."""
    text = servo(laws=PAIR, limits=ON_PHYSICS)
    declared = campaign(text, runs=32, shard=32, screen="equations")
    folder = begun(declared, tmp_path_factory.mktemp("screened"))
    run_part = part_runner(declared, folder, 0, screening_of(declared))
    run_part(0)
    return declared, folder


@pytest.mark.parametrize(("judge", "kind"), [("equations", "corrected"), ("physics", "physics")])
def test_a_run_is_judged_by_its_judge_again(
    judge: str, kind: str, screened: tuple[Campaign, Folder], tmp_path: Path
) -> None:
    declared, folder = screened
    judges = folder.columns(declared, ["judged_by"], [0])["stiff"]["judged_by"]
    number = str(np.flatnonzero(judges == judge)[0])
    plant = find_plant(declared, folder, number)
    assert (plant.law, plant.kind) == ("stiff", kind)
    path = tmp_path / "plant.toml"
    assert_repeated(declared, folder, number, "stiff", path)
    # Its requirements are those of this plant, whatever they were on.
    (result,) = [run for run in Experiment.load(path).runs() if run.controller.name == "stiff"]
    assert (result.plant, len(result.requirements)) == (kind, 1)


@pytest.fixture(scope="module")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, bytes]:
    """The case file of a noisy run, and its last state in the campaign."""
    declared = campaign(standing(DELAYS, LOOP), runs=4)
    folder = begun(declared, tmp_path_factory.mktemp("noisy"))
    plant = find_plant(declared, folder, "3", "predicting")
    last = Batch(declared, plant.values[None], [plant.run]).run("predicting")["last"]
    return case_text(declared, plant), last[0].tobytes()


def last_state(text: str, path: Path) -> bytes:
    """The last state of the recorded run of a case file."""
    path.write_text(text)
    return Experiment.load(path).run().trajectory.state[-1].tobytes()


def test_the_recorded_run_of_the_file_ends_in_the_same_state(
    noisy: tuple[str, bytes], tmp_path: Path
) -> None:
    """Every bit of a noisy run is in its last state."""
    text, last = noisy
    assert last_state(text, tmp_path / "plant.toml") == last


@pytest.mark.parametrize(
    ("words", "changed"),
    [("run = 3", "run = 2"), ('"1 ms"\nmissed', '"4 ms"\nmissed')],
    ids=["another run", "the law knows the drawn delay"],
)
def test_a_file_with_another_loop_ends_in_another_state(
    words: str, changed: str, noisy: tuple[str, bytes], tmp_path: Path
) -> None:
    text, last = noisy
    # The written file is edited, as a user would edit it.
    before, after = text.split(words)
    assert last_state(f"{before}{changed}{after}", tmp_path / "plant.toml") != last


def test_a_number_that_is_nominal_again_is_written_too(tmp_path: Path) -> None:
    """A shrunk plant has nominal numbers: no load, which ends the transient all the same."""
    declared = campaign(servo(BOTH), seed=5)
    plant = ChosenPlant("shrunk", "lqr", declared.family.nominal, 0, "physics")
    outcome = again(written_file(declared, plant, tmp_path / "plant.toml"), "lqr", "physics")
    row = Batch(declared, plant.values[None], [0]).run("lqr")
    stored = {name: column[0] for name, column in row.columns.items()}
    assert_equal_to_the_bit(outcome, stored)


OWN_PLANT = """
import sympy as sp
import grosmc_mj as gm
q, w = sp.symbols("q w")
pendulum = gm.affine_plant("own", states={"q": "rad", "w": "rad/s"}, inputs={"u": "N m"},
    f=[w, -sp.Symbol("m") * sp.sin(q)], g=[0, 1], h=[q], parameters={"m": 2.1})
"""
OWN_CASE = """
plant = { plant = "own_plant:pendulum" }
run = { start = { q = "10 deg" }, duration = "0.2 s" }
task = { Q = [1, 1], R = 1 }
[[edit]]
parameter = "m"
scale = 1.3
[[disturbance]]
input = "u"
amplitude = "0.7 N m"
label = "load"
[[controller]]
law = "lqr"
[[requirement]]
stays_within = "1 rad"
[[uncertain]]
number = "edit.m.scale"
values = [0.5, 2]
[[uncertain]]
number = "disturbance.load.scale"
name = "load amplitude"
values = [-1, 1]
nominal = 0
"""
ROBOT_CASE = """
plant = { model = "leg.xml" }
run = { duration = "0.05 s", start = { hip = "0.1 rad" } }
task = { Q = [1, 1, 1, 1], R = 1 }
[[controller]]
law = "lqr"
[[requirement]]
input_below = "100 N m"
[[uncertain]]
number = "edit.thigh.mass_scale"
values = [1, 2]
"""


@pytest.mark.parametrize(
    ("case", "beside"),
    [(OWN_CASE, {"own_plant.py": OWN_PLANT}), (ROBOT_CASE, {"leg.xml": LEG_MODEL})],
    ids=["equations of one's own", "a robot"],
)
def test_a_file_beside_the_campaign_s_own_extends_it(
    case: str, beside: dict[str, str], tmp_path: Path
) -> None:
    for name, content in beside.items():
        (tmp_path / name).write_text(content)
    base = tmp_path / "mine.toml"
    base.write_text(case)
    declared = Campaign.load(str(base), runs=4, duration=0.04)
    folder = kept(declared, tmp_path / "out")
    plant = find_plant(declared, folder, "2")
    path = tmp_path / plant.file_name("mine")
    assert path.name == "mine_2_lqr.toml"

    path.write_text(case_text(declared, plant, base))
    content = tomllib.loads(path.read_text())
    # The file leaves out tables of the base; the uncertainty is taken away.
    assert content["extends"] == "mine.toml"
    assert content["uncertain"] == []
    assert content["run"] == {"duration": "0.04 s"}
    assert not content.keys() & {"task", "controller", "requirement"}
    outcome = again(path, "lqr", plant.kind)
    row = stored_row(declared, folder, 2, "lqr")
    assert_equal_to_the_bit(outcome, row)


SOFTER = """
[laws.softer]
law = "lqr"
Q = [1, 4]
"""


@pytest.fixture(scope="module")
def softer_campaign() -> Campaign:
    """A campaign with other laws and settings than its case file."""
    options: Any = {
        "controllers": ("lqr", "softer"),
        "duration": 0.04,
        "control_period": 0.002,
        "integrator": "implicitfast",
    }
    return campaign(servo(BOTH, laws=PAIR, limits="") + SOFTER, **options)


@pytest.fixture(scope="module")
def softer_plant(
    softer_campaign: Campaign, tmp_path_factory: pytest.TempPathFactory
) -> ChosenPlant:
    """The first plant of that campaign."""
    folder = begun(softer_campaign, tmp_path_factory.mktemp("softer") / "out")
    return find_plant(softer_campaign, folder, "0")


@pytest.fixture(scope="module")
def softer_experiment(
    softer_campaign: Campaign,
    softer_plant: ChosenPlant,
    tmp_path_factory: pytest.TempPathFactory,
) -> Experiment:
    """The experiment of that plant's file."""
    path = tmp_path_factory.mktemp("softer") / "plant.toml"
    return Experiment.load(written_file(softer_campaign, softer_plant, path))


def test_a_plant_is_that_of_the_campaign_s_last_law(softer_plant: ChosenPlant) -> None:
    assert softer_plant.law == "softer"


def test_laws_of_a_plant_s_file_include_the_campaign_s(softer_experiment: Experiment) -> None:
    assert softer_experiment.controllers == ["lqr", "stiff", "softer"]


def test_settings_of_a_plant_s_file_are_the_campaign_s(
    softer_campaign: Campaign, softer_experiment: Experiment
) -> None:
    assert softer_experiment.duration == 0.04
    assert softer_experiment.settings == softer_campaign.experiment.settings


def test_a_plant_s_file_is_run_in_physics(softer_experiment: Experiment) -> None:
    assert softer_experiment.plant_names == ["physics"]


@pytest.mark.parametrize("unit", ["rad", "N m s/rad", "kg m^2", "rad/s^2", "ohm", "", "1"])
@pytest.mark.parametrize("value", [0.1 + 0.2, -1 / 3 * 1e-7, 5e22 / 3, -0.0, 5e-324])
def test_a_number_keeps_all_its_digits(unit: str, value: float) -> None:
    number = number_in(written(value, unit), unit)
    assert np.float64(number).tobytes() == np.float64(value).tobytes()


@pytest.fixture
def empty_folder(tmp_path: Path) -> Folder:
    """A folder of a campaign that has not run."""
    return begun(campaign(servo(BOTH), seed=5), tmp_path / "out")


@pytest.mark.parametrize(
    ("which", "law", "words"),
    [
        ("8", None, "run '8': there are 0 to 7, worst, shrunk, outside"),
        ("-1", None, "run '-1': there are 0 to 7"),
        ("²", None, "run '²'"),
        ("0", "grosm", "unknown law 'grosm': did you mean 'grosmc'?"),
        ("worst", None, "has no worst.json: run the campaign with --worst"),
        ("outside", None, "has no radius.json: run the campaign with --radius"),
    ],
)
def test_a_run_or_plant_that_is_not_there_is_refused(
    which: str, law: str | None, words: str, empty_folder: Folder
) -> None:
    declared = campaign(servo(BOTH), seed=5)
    assert words in refusal(find_plant, declared, empty_folder, which, law)


@pytest.mark.parametrize(
    "content",
    [
        "{",
        '{"controllers": []}',
        '{"controllers": {"grosmc": {"worst": {"rotor mass scale": 2.0}}}}',
        '{"controllers": {"grosmc": {"worst": {"rotor mass scale": [], "load amplitude": 1}}}}',
        '{"controllers": {"grosmc": {"worst": {"rotor mass scale": 1, "load amplitude": NaN}}}}',
        f'{{"controllers": {{"grosmc": {{"worst": {{"rotor mass scale": {10**400}}}}}}}}}',
    ],
)
def test_a_damaged_search_is_refused(content: str, tmp_path: Path) -> None:
    path = tmp_path / "worst.json"
    path.write_text(content)
    declared = campaign(servo(BOTH), seed=5)
    line = refusal(searched_plant, declared, tmp_path, "worst", "grosmc")
    assert line == f"{path} cannot be read: run the campaign with --worst again"


def test_a_model_beside_the_case_file_needs_that_file(tmp_path: Path) -> None:
    (tmp_path / "leg.xml").write_text(LEG_MODEL)
    (tmp_path / "mine.toml").write_text(ROBOT_CASE)
    declared = Campaign.load(str(tmp_path / "mine.toml"), runs=1)
    plant = find_plant(declared, begun(declared, tmp_path / "out"), "0")
    line = refusal(case_text, declared, plant)
    assert "mine names leg.xml, which lies beside it: give that case file by --case-file" in line
