"""From equations to a machine: the rungs, measurements on them, the answer, the command."""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import math
import shutil
import signal
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from commands import assert_one_line, run

import grosmc_mj
from grosmc_mj import cli
from grosmc_mj.chapter.claims.ledger import cited_claims
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.mechanics.machine import Transmission
from grosmc_mj.mechanics.physics.edits import BodyEdit
from grosmc_mj.output.results.document import json_text
from grosmc_mj.output.results.verdicts import Verdict, described, first_failed, verdict_of
from grosmc_mj.simulation.loop import Computing, Loop, Sensor
from grosmc_mj.simulation.loop.sensors import quantized
from grosmc_mj.studies import study as cells
from grosmc_mj.studies.ladder import answer, pages, shown
from grosmc_mj.studies.ladder import ladder as study
from grosmc_mj.studies.ladder.climb import ALONE, UP_TO, fallen
from grosmc_mj.studies.ladder.ladder import ladder, run_rung
from grosmc_mj.studies.ladder.rungs import Rung, rungs_of
from grosmc_mj.studies.study import CellRunner, StudyCell

TIME: Array = 1e-3 * np.arange(10_000)
SERVO = """
plant = { system = "servo" }
run = { duration = "20 ms" }
controller = [{ law = "lqr" }]
"""
FRICTION = f"""{SERVO}
lugre = [{{ joint = "shaft", coulomb = "0.05 N m" }}]
requirement = [{{ deviation_below = "1 rad" }}]
"""
CLAIM = """
[[claim]]
id = "servo-before-load"
deviation_below = "1 urad"
"""
CLAIMED = FRICTION + CLAIM
# A load of the file's own.
DISTURBED = f"""{FRICTION}
[[disturbance]]
body = "rotor"
torque = ["0 N m", "1 N m", "0 N m"]
profile = "constant"
{CLAIM}
"""
OWN_LAW = """
plant = { system = "servo" }
run = { duration = "20 ms" }
controller = [{ law = "mine:law" }]
lugre = [{ joint = "shaft", coulomb = "0.05 N m" }]
requirement = [{ deviation_below = "1 rad" }]
"""
# Walls of one body do not take each other's place.
WALLED = f"""{SERVO}
stop = [{{ joint = "shaft", low = "-1 rad", high = "1 rad" }}]
wall = [
  {{ body = "rotor", radius = "1 cm", point = ["0 m", "0 m", "-1 m"] }},
  {{ body = "rotor", radius = "2 cm", point = ["0 m", "0 m", "-2 m"] }},
]
transmission = [{{ joint = "shaft", inertia = "0.01 kg m^2", stiffness = "100 N m/rad" }}]
"""


def sine(frequency: float) -> Array:
    return np.sin(2 * math.pi * frequency * TIME)


def written(folder: Path, text: str = CLAIMED) -> Path:
    file = folder / "mine.toml"
    file.write_text(text, encoding="utf-8")
    return file


over_swings = pytest.mark.parametrize(
    ("error", "amplitude", "frequency"),
    [
        (0.5 + 0.2 * sine(7.3), 0.2, 7.3),
        # Only the end of a run counts, and a ripple on a swing is no swing of its own.
        (np.where(TIME < 8, 5 * np.sin(50 * TIME), 0.1 * sine(5)), 0.1, 5.0),
        (sine(3) + 0.05 * sine(211), 1.05, 3.0),
    ],
)


@over_swings
def test_a_swing_has_its_amplitude(error: Array, amplitude: float, frequency: float) -> None:
    swing, _ = shown.oscillation(TIME, error)
    assert swing == pytest.approx(amplitude, rel=0.01)


@over_swings
def test_a_swing_has_its_frequency(error: Array, amplitude: float, frequency: float) -> None:
    """The end is 2 s long, in which a crossing more or less is a quarter of a hertz."""
    _, cycle = shown.oscillation(TIME, error)
    assert cycle == pytest.approx(frequency, abs=0.25)


@pytest.mark.parametrize(
    ("error", "amplitude"),
    [(np.full(10_000, 0.3), 0.0), (0.1 * TIME, 0.1), (sine(1), 1.0)],
    ids=["rests", "creeps half of the way in 2 s", "swings twice"],
)
def test_an_error_without_three_swings_has_no_cycle(error: Array, amplitude: float) -> None:
    swing, cycle = shown.oscillation(TIME, error)
    assert swing == pytest.approx(amplitude, rel=0.01)
    assert cycle is None


def machine(system: str) -> Experiment:
    return find_experiment(system, "machine")


def kinds(rung: Rung) -> str:
    return " ".join(part.kind for part in rung.parts)


ADDED = [
    "sensors",
    "delay",
    "jitter",
    "missed samples",
    "actuator",
    "motor",
    "friction",
    "backlash",
    "flexibility",
    "stops",
]


def test_the_rungs_of_a_servo_add_one_part_at_a_time() -> None:
    climbing, alone = rungs_of(machine("servo"))
    assert [rung.name for rung in climbing] == ["corrected", "physics", "sampled", *ADDED]
    assert [rung.name for rung in alone] == ADDED
    assert [rung.sampled for rung in climbing[:3]] == [False, False, True]
    assert [rung.plant for rung in climbing] == ["corrected", *["physics"] * 12]


def test_parts_of_the_servo_s_machine_come_after_its_loop() -> None:
    climbing, alone = rungs_of(machine("servo"))
    assert not any(rung.looped or rung.parts for rung in climbing[:3])
    gear = "motor lugre transmission"
    on_top = ["", "motor", "motor lugre", gear, gear, f"{gear} stop"]
    assert [kinds(rung) for rung in climbing[7:]] == on_top
    single = ["motor", "lugre", "transmission", "transmission", "stop"]
    assert [kinds(rung) for rung in alone[5:]] == single
    assert [rung.looped for rung in alone[:6]] == [*[True] * 5, False]


def test_a_rung_alone_has_its_part_of_the_loop_alone() -> None:
    climbing, alone = rungs_of(machine("servo"))
    loop = machine("servo").loop
    assert loop is not None
    bare = Loop(seed=loop.seed)
    computing = loop.computing
    assert [rung.loop for rung in alone[:5]] == [
        replace(bare, sensors=loop.sensors, estimators=loop.estimators),
        replace(bare, computing=Computing(delay=computing.delay)),
        replace(bare, computing=Computing(jitter=computing.jitter)),
        replace(bare, computing=Computing(missed=computing.missed)),
        replace(bare, actuators=loop.actuators),
    ]
    # Missed samples come on top of the delay.
    assert climbing[6].loop.computing == computing


def test_rungs_name_the_numbers_that_nobody_has_published() -> None:
    _, alone = rungs_of(machine("servo"))
    assumed = {rung.name: rung.assumed for rung in alone}
    assert assumed["jitter"] == ("computing: jitter",)
    assert assumed["friction"] == ("shaft: static, stiffness, damping, stribeck",)
    assert assumed["backlash"] == ("shaft: backlash, restitution, duration",)
    assert assumed["flexibility"] == ("shaft: stiffness, damping",)
    assert assumed["sensors"] == ()
    assert assumed["motor"] == ()
    assert [alone[2].title, alone[5].title] == ["jitter*", "motor"]


SYSTEMS = ["servo", "cart_pendulum", "arm", "two_link_arm"]


@pytest.mark.parametrize("system", SYSTEMS)
def test_the_top_is_the_machine_with_all_its_parts(system: str) -> None:
    case = machine(system)
    climbing, _ = rungs_of(machine(system))
    assert sorted(map(repr, climbing[-1].parts)) == sorted(map(repr, case.parts))
    assert climbing[-1].loop == case.loop
    assert ("wall" in kinds(climbing[-1])) == (system == "two_link_arm")


@pytest.mark.parametrize("system", SYSTEMS)
def test_teeth_come_before_the_shaft_gives_way(system: str) -> None:
    """And make room for it."""
    parts = machine(system).parts
    gears = {part for part in parts if isinstance(part, Transmission)}
    rigid = {replace(gear, stiffness=math.inf) for gear in gears}
    climbing, alone = rungs_of(machine(system))
    for rung in (*climbing, *alone):
        transmissions = {part for part in rung.parts if isinstance(part, Transmission)}
        assert transmissions <= (rigid if rung.name == "backlash" else gears)


def test_misprinted_equations_are_the_first_rung() -> None:
    climbing, _ = rungs_of(machine("cart_pendulum"))
    assert climbing[0].name == "printed"


def test_loads_of_one_body_stand_beside_each_other(tmp_path: Path) -> None:
    climbing, alone = rungs_of(Experiment.load(written(tmp_path, WALLED)))
    assert [rung.name for rung in alone] == ["flexibility", "stops"]
    assert kinds(climbing[-1]) == "transmission stop wall wall"


# The answer.


def row(rung: str, used: float, law: str = "lqr", **changes: Any) -> Verdict:
    """A verdict on a rung."""
    fields = {"law": law, "step": rung, "group": UP_TO, "condition": "nominal", **changes}
    return described(verdict_of({"settles_within": used}).changed(**fields))


RUNGS = ("printed", "physics", "sampled", "delay", "friction", "stops")
# The book's misprints are no rung to fall from.
SHARES = (9, 0.3, 1.0, 1.2, 0.9, math.inf)
WAY = [row(name, share) for name, share in zip(RUNGS, SHARES, strict=True)]


@cache
def made_up(*names: str) -> study.Ladder:
    """A ladder of these rungs; those of ``RUNGS`` by default."""
    own = tuple(Rung(name, "physics") for name in names or RUNGS)
    return replace(ladder("servo", ["lqr", "fl-pid"]), climbing=own)


FOUR_LAWS = [
    *WAY,
    *(row(name, 0.5, "stands") for name in RUNGS[1:]),
    row("delay", 3.0, "recovers"),
    row("stops", 0.9, "recovers"),
    row("physics", 0.5, "interrupted"),
    # Alone and under load are not on this way.
    row("physics", 9.0, "stands", group=ALONE),
    row("physics", 9.0, "stands", condition="case1"),
]


def test_the_verdict_counts_laws_on_every_rung_apart_from_those_on_the_machine() -> None:
    assert answer.verdict(made_up(), FOUR_LAWS, "nominal") == (
        "1 of 4 laws passes every rung, 2 the complete machine; delay breaks 2."
    )


def test_the_answer_has_a_column_for_every_rung_beside_that_of_the_machine() -> None:
    first_screen = answer.answer_table(made_up(), FOUR_LAWS, made_up().conditions[0])
    assert [cells[:4] for cells in first_screen.rows] == [
        ["stands", "yes", "yes (0.5)", ""],
        ["lqr", "no", "no (never)", "delay: settles within: 1.2 times"],
        ["interrupted", "", "", ""],
        ["recovers", "no", "yes (0.9)", "delay: settles within: 3 times"],
    ]


@pytest.mark.parametrize(
    ("shares", "verdict"),
    [((0.5, 0.9), "not decided"), ((0.5, 1.2), "not kept"), ((1.2, 0.9), "not decided")],
)
def test_one_law_that_fails_on_the_complete_machine_decides_an_interrupted_ladder(
    shares: tuple[float, float], verdict: str
) -> None:
    """A law that fails below may pass the complete machine."""
    climbs = [row(name, share) for name, share in zip(("delay", "stops"), shares, strict=True)]
    rows = [*climbs, row("delay", 0.5, "fl-pid")]
    (shown,) = answer._answers(made_up(), rows, complete=False)
    assert shown.verdict == verdict


NOISY = """
plant = { system = "servo" }
run = { duration = "0.2 s" }
controller = [{ law = "lqr" }]
computing = { seed = 0, run = 0 }
sensor = [{ of = "rotor angle", noise = "30 mrad" }]
requirement = [{ final_error_below = "0.89 rad" }]
"""


def test_draws_are_the_runs_of_a_seed(tmp_path: Path) -> None:
    file = written(tmp_path, NOISY)
    case = Experiment.load(file)
    runs = [case.changed({"computing.run": number}).run() for number in range(10)]
    kept = sum(run.requirements[0].kept for run in runs)
    assert 0 < kept < 10

    ten = ladder(str(file), ["lqr"], draws=10)
    judged = run_rung(ten, ten.laws[0], ten.climbing[-1], ten.conditions[0], together=True)
    assert (judged.draws, judged.kept_draws) == (10, kept)
    assert not judged.kept


ENCODER = Loop(sensors=(Sensor("rotor angle", resolution=0.1),))


def test_a_draw_moves_the_steps_of_an_encoder() -> None:
    phases = [ENCODER.draw(number).sensors[0].phase for number in range(100)]
    assert phases[0] == 0
    assert -0.5 <= min(phases) < -0.4
    assert 0.4 < max(phases) <= 0.5


@pytest.mark.parametrize("phase", [-0.5, -0.2, 0.0, 0.3, 0.5])
def test_an_encoder_of_any_phase_is_wrong_by_half_a_step_at_most(phase: float) -> None:
    angles = np.linspace(-0.3, 0.3, 1001)
    middle = phase * 0.1
    readings = np.array([quantized(angle - middle, 0.1) + middle for angle in angles])
    assert np.max(np.abs(readings - angles)) <= 0.05 * (1 + 1e-9)
    assert np.min(np.abs(readings - middle)) < 1e-9


def test_a_rung_without_a_draw_runs_once() -> None:
    ten = ladder("servo", ["lqr"], draws=10)
    sampled = next(rung for rung in ten.climbing if rung.name == "sampled")
    judged = run_rung(ten, ten.laws[0], sampled, ten.conditions[0], together=True)
    assert (judged.draws, judged.kept_draws) == (1, 1)


def test_rivals_climb_on_request() -> None:
    names = {law.name for law in ladder("servo").laws}
    assert {"lqr", "pv", "implicit, predicted"} <= names
    assert names.isdisjoint({"lqi", "fl-pid", "adrc", "adaptive, quick"})
    assert len(ladder("servo", rivals=True).laws) == 19


def test_any_law_of_the_file_climbs_by_its_name() -> None:
    assert [law.name for law in ladder("servo", ["grosmc", "lqr"]).laws] == ["grosmc", "lqr"]


def test_laws_climb_nominally() -> None:
    assert [x.name for x in ladder("servo").conditions] == ["nominal"]


def test_laws_climb_under_the_system_s_loads_on_request() -> None:
    loaded = ladder("servo", loaded=True)
    assert [x.name for x in loaded.conditions] == ["nominal", "case1", "case2"]


def test_the_file_s_own_loads_act(tmp_path: Path) -> None:
    mine = str(written(tmp_path, DISTURBED))
    assert [x.name for x in ladder(mine).conditions] == ["under load"]
    loaded = ladder(mine, loaded=True)
    assert [x.name for x in loaded.conditions] == ["under load", "nominal"]


# The chapter's claims.


def test_a_claim_falls_on_the_first_rung_that_breaks_it() -> None:
    rows = [
        row("printed", 0.5, claims={"quick": 7.0}),
        row("physics", 0.5, claims={"quick": 0.2, "same": 1.0, "well": 0.1}),
        row("delay", 0.5, claims={"quick": 1.01, "same": 0.9}),
        row("friction", 0.5, claims={"quick": 2.0, "same": math.inf}),
        row("physics", 0.5, "fl-pid"),
    ]
    table = answer.claims_table(made_up(), rows, "nominal")
    assert table is not None
    assert [column.header for column in table.columns] == ["law", "`quick`", "`same`", "`well`"]
    assert table.rows == [["lqr", "delay", "friction", "stands"]]
    assert answer.claims_table(made_up(), WAY, "nominal") is None


@pytest.mark.parametrize("system", SYSTEMS)
def test_claims_of_machines_are_in_the_ledger_with_its_limits(system: str) -> None:
    """The same and well are 2 %: of the step, of the start, or of the amplitude of 1 rad."""
    made = machine(system)
    cited = cited_claims(made)
    law = made.law("physics", "lqr")
    x0 = np.array(made.x0)
    error = law.designed.error
    z = np.array(error.error_state(0.0, x0, law.parameters))
    start = float(np.linalg.norm(z[list(error.output_rows)]))
    for table, limit in zip(made.file.claim, made.claimed, strict=True):
        claim = cited[table.id]
        share = claim.threshold / 100
        expected: Any = pytest.approx(share * start, rel=2e-3)
        if claim.id == "arm-tracking":
            expected = share * 1.0
        elif limit.key == "settles_within":
            expected = 2 * (1 + share)
        assert claim.system == system
        assert limit.number == expected


TWO_CONDITIONS = [
    row("physics", 0.5, numbers={"deviation": 0.0123}, claims={"quick": 0.5}),
    row("physics", 0.5, "fl-pid"),
    row("physics", 3.25, condition="case1"),
    row("physics", 3.25, "fl-pid", condition="case1"),
]


@cache
def loaded_ladder() -> study.Ladder:
    """A ladder of one rung, nominally and under load."""
    loaded = ladder("servo", ["lqr", "fl-pid"], loaded=True)
    rung = Rung("physics", "physics", assumed=("computing: jitter",))
    return replace(
        loaded,
        climbing=[rung],
        conditions=loaded.conditions[:2],
        statements={"quick": "It is so"},
    )


@cache
def loaded_document() -> dict[str, Any]:
    content = answer.ladder_result(loaded_ladder(), TWO_CONDITIONS, complete=True)
    return json.loads(json_text(content))


@cache
def page_parts() -> list[str]:
    """The paragraphs of the page of a ladder."""
    return pages.ladders_text([loaded_document()]).split("\n\n")


def table_under(title: str) -> list[str]:
    """The rows of the page's table with this title."""
    tables = dict(itertools.pairwise(page_parts()))
    return tables[title].splitlines()[2:]


def test_a_law_has_a_second_row_with_tuned_numbers() -> None:
    def document(case: str, share: float) -> dict[str, Any]:
        climb = row("friction", share)
        conditions = [{"name": climb.condition}]
        verdicts = [climb.model_dump()]
        return {"target": f"servo/{case}", "conditions": conditions, "verdicts": verdicts}

    written = [document("machine", 2.0), document("tuned", 0.5)]
    assert pages.few_failures_text(written).splitlines()[2:] == [
        "| LQR | friction |",
        "| LQR, tuned | kept |",
    ]


def test_the_document_has_every_row() -> None:
    climbs = loaded_document()["verdicts"]
    assert [Verdict.model_validate(climb) for climb in climbs] == TWO_CONDITIONS


@pytest.mark.parametrize(
    ("title", "rows"),
    [
        ("Rungs added one by one:", ["| lqr | 0.5 |", "| fl-pid | 0.5 |"]),
        (
            "Largest distance from the nominal optimum [mrad], of the laws that follow it:",
            ["| lqr | 12.3 |"],
        ),
        ("Rung on which each claim fails:", ["| lqr | stands |"]),
    ],
    ids=["rungs", "distances", "claims"],
)
def test_the_page_has_a_table_of_the_nominal_climb(title: str, rows: list[str]) -> None:
    assert table_under(title) == rows


def test_the_page_has_the_machine_under_each_condition() -> None:
    load = loaded_ladder().conditions[1].title
    title = f"The complete machine, nominally and under load (case1: {load}):"
    assert table_under(title) == ["| lqr | 0.5 | 3.25x |", "| fl-pid | 0.5 | 3.25x |"]


def test_the_page_ends_with_the_statements_of_the_claims() -> None:
    assert page_parts()[-1] == "`quick`: It is so."


def test_the_page_names_the_numbers_that_are_assumed() -> None:
    sentence = "\\* rests on numbers that are assumed: physics (computing: jitter)."
    assert sentence in page_parts()


@cache
def servo_climb() -> tuple[list[Verdict], Verdict]:
    """Results of LQR on the rungs of a servo, and with its friction alone."""
    studied = ladder("servo", ["lqr"])
    steps = [x for x in studied.runs() if x[3] or x[1].name == "friction"]
    *rungs, friction_alone = [run_rung(studied, *x[:3], together=x[3]) for x in steps]
    return rungs, friction_alone


def servo_rung(name: str) -> Verdict:
    rungs, _ = servo_climb()
    return next(step for step in rungs if step.step == name)


@pytest.mark.slow
def test_lqr_climbs_a_servo_up_to_its_friction() -> None:
    rungs, friction_alone = servo_climb()
    broken = first_failed(rungs)
    assert broken is not None
    assert broken.step == "friction"
    assert broken.tightest == "settles_within"
    # The optimum's poles are -1 and -12 rad/s: 2 % of 1 rad after ln(50 * 12/11) = 4.0 s.
    assert broken.numbers["optimum_settles"] == pytest.approx(math.log(50 * 12 / 11), abs=0.06)
    # The chapter's 2 % of the step fall there, too, as they are about both laws.
    assert fallen(rungs, "servo-before-load") is broken
    # It needs no other imperfection for that, and stops where friction holds the rest of K e.
    assert not friction_alone.kept
    assert not any(step.kept for step in rungs[rungs.index(broken) :])


@pytest.mark.slow
def test_lqr_climbs_the_servo_s_physics_as_its_equations() -> None:
    equations = servo_rung("corrected").share
    physics = servo_rung("physics").share
    assert physics == pytest.approx(equations, rel=1e-3)


@pytest.mark.slow
def test_the_servo_s_motor_changes_nothing() -> None:
    """The model's damping has the back-EMF in it, and 24 V are enough."""
    motor = servo_rung("motor")
    actuator = servo_rung("actuator")
    assert motor.shares == pytest.approx(actuator.shares, rel=0.01)
    for name in ("variation", "amplitude"):
        assert motor.numbers[name] == pytest.approx(actuator.numbers[name], rel=0.01)


@pytest.mark.slow
def test_steps_of_the_servo_s_encoders_make_the_input_move() -> None:
    sensors = servo_rung("sensors")
    sampled = servo_rung("sampled").numbers["variation"] or 0.0
    assert (sensors.numbers["variation"] or 0.0) > 1.5 * sampled
    assert sensors.numbers["frequency"] is not None


# The command.


class Climber:
    """A law that keeps everything up to the motor, and ends at the stops; can be stopped."""

    def __init__(self) -> None:
        self.ran: list[tuple[str, bool]] = []
        self.at_delay = lambda: None

    def __call__(self, _: Any, law: Any, rung: Rung, condition: Any, *, together: bool) -> Verdict:
        if rung.name == "delay":
            self.at_delay()
        self.ran.append((rung.name, together))
        verdict = verdict_of({"deviation_below": 0.5})
        if rung.name in ("friction", "backlash", "flexibility"):
            verdict = verdict_of({"deviation_below": 3.25})
        if rung.name == "stops":
            verdict = verdict_of({}, ended="diverged")
        claims = {}
        if law.name == "lqr":
            claims = {"servo-before-load": verdict.share / 3}
        return described(verdict).changed(
            law=law.name,
            step=rung.name,
            condition=condition.name,
            group=UP_TO if together else ALONE,
            claims=claims,
        )


@pytest.fixture
def climber(monkeypatch: pytest.MonkeyPatch) -> Climber:
    climber = Climber()
    monkeypatch.setattr(study, "run_rung", climber)
    return climber


class ServoLadder(NamedTuple):
    """The command's ladder of two laws that are made up: its words, its folder, its steps."""

    output: str
    folder: Path
    ran: list[tuple[str, bool]]

    @property
    def document(self) -> dict[str, Any]:
        file = self.folder / "ladder_servo_machine.json"
        return json.loads(file.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def servo_ladder(tmp_path_factory: pytest.TempPathFactory) -> ServoLadder:
    """One ladder; tests only read its folder."""
    climber = Climber()
    folder = tmp_path_factory.mktemp("servo_ladder")
    options = ("--laws", "lqr", "fl-pid", "--out", folder)
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(study, "run_rung", climber)
        with contextlib.redirect_stdout(io.StringIO()) as output:
            assert run("study", "ladder", "servo", *options) == cli.DONE
    return ServoLadder(" ".join(output.getvalue().split()), folder, climber.ran)


@pytest.mark.parametrize(
    "words",
    [
        "0 of 2 laws pass every rung, 0 the complete machine; friction breaks 2.",
        "deviation below: 3.25",
        "ladder_servo_machine.json",
        "servo-before-load",
    ],
)
def test_the_command_prints_the_answer(words: str, servo_ladder: ServoLadder) -> None:
    assert words in servo_ladder.output


def test_the_command_writes_its_laws(servo_ladder: ServoLadder) -> None:
    document = servo_ladder.document
    assert document["complete"]
    assert document["configuration"]["target"] == "servo/machine"
    assert [law["name"] for law in document["laws"]] == ["lqr", "fl-pid"]


def test_the_command_writes_a_row_for_every_step(servo_ladder: ServoLadder) -> None:
    climbs = servo_ladder.document["verdicts"]
    assert len(climbs) == len(servo_ladder.ran) == 2 * (13 + 10)


def test_infinite_stiffness_is_null_in_the_document(servo_ladder: ServoLadder) -> None:
    climbing = servo_ladder.document["climbing"]
    (teeth,) = (rung["parts"][-1] for rung in climbing if rung["name"] == "backlash")
    assert teeth["kind"] == "transmission"
    assert teeth["stiffness"] is None


def test_the_share_of_a_run_that_ended_is_null_in_the_document(servo_ladder: ServoLadder) -> None:
    last = next(row for row in servo_ladder.document["verdicts"] if row["step"] == "stops")
    assert last["share"] is None
    assert last["ended"] == "diverged"


def test_the_document_has_the_statements_of_the_claims(servo_ladder: ServoLadder) -> None:
    claims = servo_ladder.document["claims"]
    stated = {claim["claim"]: claim["statement"] for claim in claims}
    assert stated["servo-before-load"].startswith("Without disturbance both laws")


def test_the_document_has_the_rung_that_breaks_each_law(servo_ladder: ServoLadder) -> None:
    standings = servo_ladder.document["standings"]
    assert [law["breaks_at"] for law in standings] == ["friction", "friction"]


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_the_command_draws_the_ladder(suffix: str, servo_ladder: ServoLadder) -> None:
    assert (servo_ladder.folder / f"ladder_servo_machine.{suffix}").stat().st_size > 1000


class Killed(BaseException):
    """Ends a ladder as SIGKILL does: nothing that is done at an interrupt is done."""


@pytest.mark.parametrize("stop", [Killed, KeyboardInterrupt, signal.SIGTERM])
def test_a_stopped_ladder_goes_on_to_the_same_bytes(
    stop: type[BaseException] | signal.Signals,
    climber: Climber,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From the rung at which it was stopped."""

    def stopped() -> None:
        if isinstance(stop, signal.Signals):
            signal.raise_signal(stop)
        else:
            raise stop

    monkeypatch.setattr("grosmc_mj.output.charts.figure.write_chart", lambda _, path: path)
    climber.at_delay = stopped
    file = tmp_path / "ladder_servo_machine.json"
    command = ("study", "ladder", "servo", "--laws", "lqr", "--out", tmp_path)
    if stop is Killed:
        with pytest.raises(Killed):
            run(*command)
        assert not file.exists()
    else:
        assert run(*command) == cli.INTERRUPTED
        assert not json.loads(file.read_text(encoding="utf-8"))["complete"]
    below = [(name, True) for name in ("corrected", "physics", "sampled", "sensors")]
    assert climber.ran == below
    climber.at_delay = lambda: None
    assert run(*command, "--resume") == cli.DONE
    assert len(climber.ran) == len(set(climber.ran))
    resumed = file.read_bytes()
    everything = climber.ran[:]
    assert run(*command, "--resume") == cli.DONE
    assert climber.ran == everything
    assert run(*command) == cli.DONE
    assert climber.ran == 2 * everything
    assert file.read_bytes() == resumed


def test_a_law_that_keeps_everything_on_no_rung_is_a_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never_kept(_: Any, law: Any, rung: Rung, condition: Any, *, together: bool) -> Verdict:
        group = UP_TO if together else ALONE
        return row(rung.name, 2.0, law.name, group=group, condition=condition.name)

    monkeypatch.setattr(study, "run_rung", never_kept)
    monkeypatch.setattr("grosmc_mj.output.charts.figure.write_chart", lambda _, path: path)
    command = ("study", "ladder", "servo", "--laws", "lqr", "--out", tmp_path)
    assert run(*command) == cli.DIFFERS


@pytest.mark.parametrize(
    ("name", "other"), [("versions", {"mujoco": "another"}), ("source_digest", "another")]
)
def test_a_ladder_of_another_version_is_climbed_anew(
    name: str,
    other: Any,
    climber: Climber,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("grosmc_mj.output.charts.figure.write_chart", lambda _, path: path)
    command = ("study", "ladder", "servo", "--laws", "lqr", "--out", tmp_path)
    assert run(*command) == cli.DONE
    everything = climber.ran[:]
    monkeypatch.setattr(cells, name, lambda: other)
    climber.ran.clear()
    assert run(*command, "--resume") == cli.DONE
    assert climber.ran == everything


def cell_of(stored: Verdict) -> StudyCell[Verdict]:
    """Return the cell of a row, among those of a ladder."""
    key = (stored.law, stored.step, stored.condition, stored.group)
    return StudyCell("", key, "a ladder", lambda _: stored)


@pytest.mark.parametrize(
    "other",
    [{"condition": "case2"}, {"law": "grosmc"}, {"rung": "delay"}, {"group": ALONE}],
    ids=["condition", "law", "rung", "group"],
)
def test_rows_under_case1_and_case2_are_kept_apart(other: dict[str, Any], tmp_path: Path) -> None:
    """As are those of two laws, of two rungs, and of a rung alone and with those below."""
    stored = CellRunner(tmp_path, Verdict)
    place: dict[str, Any] = {"rung": "sensors", "condition": "case1"}
    first = row(used=0.5, **place)
    second = row(used=2.0, **place | other)
    stored.write(cell_of(first), first)
    stored.write(cell_of(second), second)
    assert stored.read(cell_of(first)) == first
    assert stored.read(cell_of(second)) == second


def depends_on(studied: study.Ladder) -> dict[str | bool, str]:
    """Return all that the rows of a ladder depend on, by condition."""
    return {cell.key[2]: cell.depends_on for cell in studied.cells()}


def test_rows_of_a_ladder_are_made_anew_if_the_load_of_a_case_changes() -> None:
    """The load of case1 stands in no file of the ladder's own."""
    studied = ladder("servo", ["lqr"], loaded=True)
    *others, load = studied.conditions
    before = depends_on(studied)
    assert depends_on(studied) == before

    heavier = load.experiment.changed(edits=(BodyEdit("rotor", 2.0),))
    changed = replace(studied, conditions=[*others, replace(load, experiment=heavier)])
    after = depends_on(changed)
    assert after.pop(load.name) != before.pop(load.name)
    assert after == before


def test_rows_depend_on_the_code_of_a_law_of_one_s_own(tmp_path: Path) -> None:
    file = written(tmp_path, OWN_LAW)
    sources = []
    for value in ("0.0", "1.0"):
        (tmp_path / "mine.py").write_text(f"def law(t, x, memory, p):\n    return {value}\n")
        sources.append(ladder(str(file)).configuration()["sources"])
    assert sources[0].keys() == sources[1].keys() != set()
    assert sources[0] != sources[1]


@pytest.mark.parametrize(
    ("requirement", "claim", "words"),
    [
        (
            'deviation_below = "1 rad"',
            'id = "servo-befor-load"\ndeviation_below = "1 urad"',
            "did you mean 'servo-before-load'",
        ),
        (
            'deviation_below = "1 rad"',
            'id = "servo-before-load"\ndeviation_below = "1 V"',
            'claim 1: deviation_below: "1 V" cannot be converted to rad',
        ),
        (
            'deviation_below = "1 rad"',
            'id = "servo-before-load"\nunder = "case3"\ndeviation_below = "1 urad"',
            "claim 1",
        ),
        (
            'deviation_below = "1 rad"',
            'id = "servo-before-load"\nof = ["lqrr"]\ndeviation_below = "1 urad"',
            "did you mean 'lqr'",
        ),
        (
            'deviation_below = "1 rad"',
            'id = "servo-before-load"',
            "claim 1: nothing is required",
        ),
        (
            "",
            'id = "servo-before-load"\ndeviation_below = "1 urad"',
            "nothing is required: give it a",
        ),
    ],
)
def test_a_requirement_or_claim_that_is_wrong_is_one_line(
    requirement: str,
    claim: str,
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    requirements = f"[{{ {requirement} }}]" if requirement else "[]"
    text = f"""{SERVO}
lugre = [{{ joint = "shaft", coulomb = "0.05 N m" }}]
requirement = {requirements}
[[claim]]
{claim}
"""
    file = written(tmp_path, text)
    assert run("study", "ladder", file, "--out", tmp_path / "out") == cli.WRONG
    error = capsys.readouterr().err
    assert words in error
    assert_one_line(error)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("maglev", "there is nothing to climb to: give the file a loop"),
        ("servo --laws lqrr", "unknown law 'lqrr': did you mean 'lqr'"),
        ("servo --film lqrr", "unknown law 'lqrr': did you mean 'lqr'"),
    ],
)
def test_a_target_or_law_that_is_wrong_is_one_line(
    arguments: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("study", "ladder", *arguments.split(), "--out", tmp_path / "out") == cli.WRONG
    error = capsys.readouterr().err
    assert words in error
    assert_one_line(error)
    assert not (tmp_path / "out").exists()


def test_no_verdict_depends_on_a_claim(tmp_path: Path) -> None:
    """Friction breaks it, and the run keeps all that is required."""
    file = written(tmp_path)
    assert run("run", file, "--out", tmp_path) == cli.DONE
    studied = ladder(str(file), ["lqr"])
    alone = run_rung(
        studied, studied.laws[0], studied.alone[0], studied.conditions[0], together=False
    )
    assert alone.kept
    assert alone.claims["servo-before-load"] > 1


def test_of_a_claim_s_limits_the_one_that_is_used_most_counts(tmp_path: Path) -> None:
    """The run leaves its optimum by more than 1 urad; its error and its input are small."""
    loose = 'input_below = "100 A"\nstays_within = "100 rad"\n'
    studied = ladder(str(written(tmp_path, CLAIMED + loose)), ["lqr"])
    climb = (studied.laws[0], studied.alone[0], studied.conditions[0])
    assert run_rung(studied, *climb, together=False).claims["servo-before-load"] > 1


def test_a_law_that_cannot_be_designed_has_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise ArgumentError("there is no such law")

    monkeypatch.setattr(study, "trial_of", refused)
    studied = ladder(str(written(tmp_path)), ["lqr"])
    law, rung, condition, _ = next(studied.runs())
    step = run_rung(studied, law, rung, condition, together=True)
    assert step.impossible == "there is no such law"
    assert not step.kept
    assert step.shares == {}


def test_rows_of_two_conditions_have_keys_of_their_own() -> None:
    """Case 1 and case 2 of a law on a rung are stored beside each other."""
    studied = ladder("servo", ["lqr"], loaded=True)
    keys = [cell.key for cell in studied.cells()]
    assert len(set(keys)) == len(keys) == 3 * 13 + 10


MEASURED_CASE = """
plant = { system = "servo", compare = ["physics"] }
run = { duration = "3 s", timestep = "0.5 ms", control_period = "1 ms" }
task = { reference = ["1"] }
computing = { delay = "6.5 ms" }
edit = [{ body = "rotor", mass_scale = 1.788 }, { joint = "shaft", damping = 0.02734 }]
controller = [{ law = "pd", frequency = 6, damping = 0.7 }]
requirement = [{ reaches_within = "1.5 s", band = "20 mrad" }, { overshoot_below = 0.08 }]
measured = [{ log = "servo_step.csv" }]
"""


def test_the_measured_machine_stands_beside_the_model_of_it(tmp_path: Path) -> None:
    log = Path(grosmc_mj.__file__).parent / "experiments" / "cases" / "logs" / "servo_step.csv"
    shutil.copy(log, tmp_path)
    studied = ladder(str(written(tmp_path, MEASURED_CASE)), ["pd"])
    (measured,) = study.measured_rows(studied)
    law = studied.laws[0]
    modelled = run_rung(studied, law, studied.climbing[-1], studied.conditions[0], together=True)
    assert measured.tightest == modelled.tightest == "overshoot_below"
    assert not measured.kept
    assert measured.share == pytest.approx(modelled.share, rel=0.05)
    assert answer.verdict(studied, [modelled, measured], studied.conditions[0].name).endswith(
        "The measured machine agrees with the model on 1 of 1 law."
    )
