"""The case file of one plant of a campaign: its run has the numbers that the campaign stored."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import cases
import mjcf
import numpy as np
import pytest
from campaigns import (
    BOTH,
    HUM,
    LOAD,
    LOOP,
    MACHINE,
    MASS,
    PAIR,
    begun,
    campaign,
    falling,
    kept,
    part,
    refusal,
    servo,
    specification,
    uncertain,
)

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


def scale_of(label: str) -> dict[str, Any]:
    """The uncertain amplitude of a disturbance, of which nominally there is nothing."""
    number = f"disturbance.{label}.scale"
    return uncertain(number, -1, 1, name=f"{label} amplitude", nominal=0)


def noisy_loop() -> str:
    """All that a predicting law would otherwise take from the drawn loop is uncertain."""
    return part(
        uncertain("sensor.rotor angle.noise", "0 mrad", "0.3 mrad"),
        uncertain("computing.delay", "1 ms", "4 ms"),
        uncertain("actuator.current.limit", "3 A", "4 A"),
        uncertain("actuator.current.lag", "1 ms", "2 ms"),
        **LOOP,
    )


def machine() -> str:
    return part(
        uncertain("lugre.shaft.coulomb", "0.05 N m", "0.06 N m"),
        uncertain("motor.current.resistance", "2 ohm", "3 ohm"),
        uncertain("transmission.shaft.backlash", "0 mrad", "1 mrad"),
        uncertain("wall.rotor.radius", "1 cm", "2 cm"),
        **MACHINE,
        requirement={"deviation_below": "10 mrad"},
    )


def two_links() -> str:
    """Sine, start and a point mass, on a plant with several inputs."""
    tip = {"body": "payload", "force": ["0 N", "0 N", "5 N"], "label": "tip"}
    return part(
        uncertain("edit.payload.added_mass", "0 kg", "1 kg", at=["1 cm", "0 m", "0 m"]),
        scale_of("tip"),
        uncertain("disturbance.tip.frequency", "0.5 Hz", "2 Hz"),
        uncertain("disturbance.tip.phase", "0 deg", "360 deg"),
        uncertain("run.start.shoulder angle", "0.5 rad", "0.7 rad"),
        system="two_link_arm",
        run={"start": {"shoulder angle": "0.6 rad", "elbow angle": "-1.2 rad"}},
        laws=[{"law": "pd"}],
        disturbance={**tip, "profile": "sine", "frequency": "1 Hz"},
        requirement={"stays_within": "3 cm", "after": "0.02 s", "on": ["physics"]},
    )


def edited_bodies() -> str:
    edits = [{"body": "rotor", "length_scale": 1.1}, {"joint": "shaft", "friction": 0.1}]
    return servo(*BOTH, uncertain("edit.shaft.damping", 0, 1), edit=edits)


def an_input_and_a_measured_state() -> str:
    ripple = {"input": "current", "amplitude": "0.2 A", "profile": "table", "label": "ripple"}
    table = {"values": [1, -1], "hold": "3 ms", "periodic": True}
    glitch = {"measured": "rotor angle", "amplitude": "2 mrad", "label": "glitch"}
    loads = [LOAD, HUM, {**ripple, **table}, glitch]
    return servo(scale_of("ripple"), scale_of("glitch"), disturbance=loads)


# The file repeats the row.


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
    assert_equal_to_the_bit(outcome, stored_row(declared, folder, plant.run, law))


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("text", "law"),
    [
        (edited_bodies(), "lqr"),
        (an_input_and_a_measured_state(), "lqr"),
        (noisy_loop(), "predicting"),
        pytest.param(edited_bodies(), "grosmc", marks=SLOW),
        pytest.param(two_links(), "pd", marks=SLOW),
        pytest.param(machine(), "lqr", marks=SLOW),
    ],
    ids=["bodies", "input", "loop", "bodies, grosmc", "two links", "machine"],
)
def test_the_run_of_a_plant_s_file_has_the_numbers_of_its_row(
    text: str, law: str, tmp_path: Path
) -> None:
    declared = campaign(text, seed=5, runs=4)
    folder = kept(declared, tmp_path / "out")
    assert_repeated(declared, folder, "3", law, tmp_path / "plant.toml")


def test_a_run_that_ended_early_ends_again_at_the_same_instant(tmp_path: Path) -> None:
    folder = kept(falling(), tmp_path / "out")
    status = folder.columns(falling(), ["status"], [0])["fl-lqr"]["status"]
    early = str(np.flatnonzero(status == "undefined_law")[0])
    assert_repeated(falling(), folder, early, "fl-lqr", tmp_path / "plant.toml")


@pytest.fixture(scope="module")
def screened(tmp_path_factory: pytest.TempPathFactory) -> tuple[Campaign, Folder]:
    """A campaign some of whose runs equations judged, and its folder."""
    limits = [{"deviation_below": "3 mrad", "on": ["physics"]}]
    declared = campaign(servo(laws=PAIR, limits=limits), runs=32, shard=32, screen="equations")
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
    declared = campaign(noisy_loop(), runs=4)
    folder = begun(declared, tmp_path_factory.mktemp("noisy"))
    plant = find_plant(declared, folder, "3", "predicting")
    last = Batch(declared, plant.values[None], [plant.run]).run("predicting")["last"]
    return case_text(declared, plant), last[0].tobytes()


@pytest.mark.parametrize(
    ("words", "changed"),
    [("run = 3", "run = 3"), ("run = 3", "run = 2"), ('"1 ms"\nmissed', '"4 ms"\nmissed')],
    ids=["as it is", "another run", "the law knows the drawn delay"],
)
def test_the_recorded_run_of_the_file_ends_in_the_same_state_in_the_same_loop_alone(
    words: str, changed: str, noisy: tuple[str, bytes], tmp_path: Path
) -> None:
    """Every bit of a noisy run is in its last state; the file is edited as a user would do it."""
    text, last = noisy
    before, after = text.split(words)
    path = tmp_path / "plant.toml"
    path.write_text(f"{before}{changed}{after}")
    end = Experiment.load(path).run().trajectory.state[-1].tobytes()
    assert (end == last) == (words == changed)


def test_a_number_that_is_nominal_again_is_written_too(tmp_path: Path) -> None:
    """A shrunk plant has nominal numbers: no load, which ends the transient all the same."""
    declared = campaign(servo(), seed=5)
    plant = ChosenPlant("shrunk", "lqr", declared.family.nominal, 0, "physics")
    outcome = again(written_file(declared, plant, tmp_path / "plant.toml"), "lqr", "physics")
    row = Batch(declared, plant.values[None], [0]).run("lqr")
    assert_equal_to_the_bit(outcome, {name: column[0] for name, column in row.columns.items()})


# Files beside that of the campaign.

OWN_PLANT = """
import sympy as sp
import grosmc_mj as gm
q, w = sp.symbols("q w")
pendulum = gm.affine_plant("own", states={"q": "rad", "w": "rad/s"}, inputs={"u": "N m"},
    f=[w, -sp.Symbol("m") * sp.sin(q)], g=[0, 1], h=[q], parameters={"m": 2.1})
"""
ROBOT = mjcf.ONE.format("", '<motor name="drive" joint="hinge"/>')
TASK = {"Q": [1, 1], "R": 1}


def own_case(folder: Path) -> Path:
    """A case on equations of one's own, with an edit and a load."""
    (folder / "own_plant.py").write_text(OWN_PLANT)
    return cases.write(
        folder,
        "own_plant:pendulum",
        run={"start": {"q": "10 deg"}, "duration": "0.2 s"},
        task=TASK,
        edit={"parameter": "m", "scale": 1.3},
        disturbance={"input": "u", "amplitude": "0.7 N m", "label": "load"},
        requirement={"stays_within": "1 rad"},
        uncertain=[uncertain("edit.m.scale", 0.5, 2), scale_of("load")],
    )


def robot_case(folder: Path) -> Path:
    """A case on a robot."""
    (folder / "one.xml").write_text(ROBOT)
    return cases.write(
        folder,
        "one.xml",
        run={"start": {"hinge": "0.1 rad"}, "duration": "0.2 s"},
        task=TASK,
        requirement={"input_below": "100 N m"},
        uncertain=uncertain("edit.link.mass_scale", 1, 2),
    )


def voltage_case(folder: Path) -> Path:
    """A case on a robot whose law gives a voltage, and knows the motor of the file."""
    (folder / "one.xml").write_text(ROBOT)
    motor = {"input": "drive", "constant": "0.1 N m/A", "resistance": "2 ohm"}
    return cases.write(
        folder,
        "one.xml",
        run={"start": {"hinge": "0.1 rad"}, "duration": "0.2 s"},
        task=TASK,
        motor={**motor, "law_input": "voltage"},
        requirement={"input_below": "100 V"},
        uncertain=uncertain("motor.drive.constant", "0.05 N m/A", "0.09 N m/A"),
    )


@pytest.mark.parametrize("written_case", [own_case, robot_case, voltage_case])
def test_a_file_beside_the_campaign_s_own_extends_it(written_case: Any, tmp_path: Path) -> None:
    base = written_case(tmp_path)
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
    assert_equal_to_the_bit(again(path, "lqr", plant.kind), stored_row(declared, folder, 2, "lqr"))


def test_a_model_beside_the_case_file_needs_that_file(tmp_path: Path) -> None:
    declared = Campaign.load(str(robot_case(tmp_path)), runs=1)
    plant = find_plant(declared, begun(declared, tmp_path / "out"), "0")
    line = refusal(case_text, declared, plant)
    assert "mine names one.xml, which lies beside it: give that case file by --case-file" in line


def test_a_plant_s_file_has_the_laws_and_settings_of_the_campaign(tmp_path: Path) -> None:
    """Which has others than its case file: a law of [laws] that no [[controller]] runs."""
    softer = {"law": "lqr", "Q": [1, 4]}
    declared = Campaign.of(
        specification(
            cases.text(
                run={"duration": "50 ms", "control_period": "1 ms"},
                controller=PAIR,
                laws={"softer": softer},
                uncertain=MASS,
            ),
            controllers=("lqr", "softer"),
            duration=0.04,
            control_period=0.002,
            integrator="implicitfast",
        )
    )
    plant = find_plant(declared, begun(declared, tmp_path / "out"), "0")
    assert plant.law == "softer"
    experiment = Experiment.load(written_file(declared, plant, tmp_path / "plant.toml"))
    assert experiment.controllers == ["lqr", "stiff", "softer"]
    assert experiment.settings == declared.experiment.settings
    assert (experiment.duration, experiment.plant_names) == (0.04, ["physics"])


@pytest.mark.parametrize("unit", ["rad", "N m s/rad", "kg m^2", "rad/s^2", "ohm", "", "1"])
@pytest.mark.parametrize("value", [0.1 + 0.2, -1 / 3 * 1e-7, 5e22 / 3, -0.0, 5e-324])
def test_a_number_keeps_all_its_digits(unit: str, value: float) -> None:
    number = number_in(written(value, unit), unit)
    assert np.float64(number).tobytes() == np.float64(value).tobytes()


# Refusals.


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
    which: str, law: str | None, words: str, tmp_path: Path
) -> None:
    declared = campaign(servo(), seed=5)
    assert words in refusal(find_plant, declared, begun(declared, tmp_path / "out"), which, law)


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
    line = refusal(searched_plant, campaign(servo(), seed=5), tmp_path, "worst", "grosmc")
    assert line == f"{path} cannot be read: run the campaign with --worst again"
