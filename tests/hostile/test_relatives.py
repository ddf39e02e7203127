"""Relatives of inputs that once went wrong: the same answer, another right one, or one line.

Each test draws its inputs by a seed, so that an input that fails is made again by its name.
"""

from __future__ import annotations

import json
import os
import random
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cases
import mcap.writer
import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest
from hostile_trial import Trial

from grosmc_mj import cli
from grosmc_mj.experiments.file.shipped import CASES

pytestmark = [pytest.mark.slow, pytest.mark.apart]

# So many times as many relatives; `make hostile` asks for more.
TIMES = int(os.environ.get("HOSTILE", "1"))

# A step of the servo, as its log is judged.
STEP: dict[str, Any] = {
    "plant": {"compare": ["physics"]},
    "run": {"duration": "3 s"},
    "task": {"reference": ["1"]},
    "controller": {"law": "pd", "frequency": 6, "damping": 0.7},
    "requirement": [
        {"reaches_within": "1.5 s", "band": "20 mrad"},
        {"overshoot_below": 0.08, "input_below": "4 A"},
        {"always": "abs(current) > 2 A implies eventually[0 s, 200 ms] abs(current) < 2 A"},
    ],
}
HEADERS = ("time [s]", "current [A]", "rotor angle [rad]")
Columns = dict[str, list[str]]


@pytest.fixture
def step(tmp_path: Path) -> Path:
    """The case of a step."""
    return cases.write(tmp_path, "servo", name="step", **STEP)


def step_log() -> Columns:
    """The shipped log of a step as texts, by their headers; time, input and angle."""
    lines = (CASES / "logs" / "servo_step.csv").read_text(encoding="utf-8").splitlines()
    rows = [line.split(",") for line in lines[1:]]
    return {header: [row[k] for row in rows] for k, header in enumerate(HEADERS)}


def log_text(columns: Columns, separator: str = ",", line_end: str = "\n") -> str:
    """The columns of a log as CSV."""
    rows = [columns.keys(), *zip(*columns.values(), strict=True)]
    return "".join(separator.join(row) + line_end for row in rows)


# Logs with the same content.

# Units of a time, and their ticks in a millisecond, the finest step of the log.
TICKS = {"s": None, "ms": 1, "us": 1_000, "ns": 1_000_000}


def since_1970(columns: Columns, rng: random.Random) -> Columns:
    """The log with a time since some year, in some unit, exact to the digit."""
    unit = rng.choice(list(TICKS))
    year = rng.choice((0, 1, 946_684_800, 1_700_000_000, 1_764_329_400))
    ticks = TICKS[unit]
    times = []
    for text in columns[HEADERS[0]]:
        milliseconds = 1000 * year + round(1000 * float(text))
        whole, rest = divmod(milliseconds, 1000)
        times.append(f"{whole}.{rest:03d}" if ticks is None else str(milliseconds * ticks))
    rest_of_log = {header: columns[header] for header in HEADERS[1:]}
    return {f"time [{unit}]": times, **rest_of_log}


def with_strange_columns(columns: Columns, rng: random.Random) -> Columns:
    """The log with columns that nobody asks for, in another order."""
    length = len(columns[HEADERS[1]])
    more = {
        "status": ["ok"] * length,
        "battery [V]": ["11.1"] * length,
        "note (see manual)": [""] * length,
        "count": [str(k) for k in range(length)],
    }
    chosen = rng.sample(sorted(more), rng.randint(1, len(more)))
    headers = [*columns, *chosen]
    rng.shuffle(headers)
    return {header: {**columns, **more}[header] for header in headers}


def with_decimal_commas(columns: Columns) -> Columns:
    """The log with a comma before the decimals."""
    return {header: [text.replace(".", ",") for text in texts] for header, texts in columns.items()}


def write_alike(columns: Columns, path: Path, rng: random.Random) -> Path:
    """Write a log in some layout that the reader knows; returns its file."""
    kind = rng.choice(("comma", "tab", "decimal comma", "comment", "mark", "utf-16", "parquet"))
    if kind == "parquet":
        text = log_text(columns).encode()
        file = path.with_suffix(".parquet")
        pq.write_table(pyarrow.csv.read_csv(pa.BufferReader(text)), file)
        return file

    if kind == "decimal comma":
        columns = with_decimal_commas(columns)
    separator = {"tab": "\t", "decimal comma": ";"}.get(kind, ",")
    text = log_text(columns, separator, rng.choice(("\n", "\r\n")))
    if kind == "comment":
        text = f"# recorded today\n\n{text}# end\n"
    encoding = {"mark": "utf-8-sig", "utf-16": "utf-16"}.get(kind, "utf-8")
    file = path.with_suffix(".csv")
    file.write_bytes(text.encode(encoding))
    return file


def verdicts(output: str) -> list[str]:
    """The lines of an answer that judge a requirement."""
    return [line for line in output.splitlines() if line.startswith(("kept", "FAILED"))]


def test_the_same_log_in_another_layout_has_the_same_verdicts(
    hostile: Trial, step: Path, tmp_path: Path
) -> None:
    rng = random.Random(1)
    options = ("--no-figures", "--out", tmp_path / "out")
    shipped = CASES / "logs" / "servo_step.csv"
    expected = hostile.run("as shipped", "run", step, "--log", shipped, *options)
    assert verdicts(expected.output)
    for index in range(40 * TIMES):
        columns = step_log()
        for change in (since_1970, with_strange_columns):
            if rng.random() < 0.7:
                columns = change(columns, rng)
        log = write_alike(columns, tmp_path / f"log{index}", rng)
        answer = hostile.run(f"alike {index}", "run", step, "--log", log, *options)
        assert answer.code == expected.code, index
        assert verdicts(answer.output) == verdicts(expected.output), index
        log.unlink()
    hostile.run("no log", "run", step, "--log", tmp_path / "nothing.csv", *options)


# Logs with another content.

HUGE = ("1e308", "-1e308", "1e155", "9" * 19, "1e-320", "nan", "inf", "", "0", "on", "1e20")


def with_huge_numbers(columns: Columns, rng: random.Random) -> Columns:
    """The log with another number in a field, in a part of a column, or all along it."""
    changed = {header: list(texts) for header, texts in columns.items()}
    texts = changed[rng.choice(HEADERS)]
    begin = rng.randrange(len(texts))
    length = rng.choice((1, 1, 30, len(texts)))
    number = rng.choice(HUGE)
    for k in range(begin, min(begin + length, len(texts))):
        texts[k] = number
    return changed


def with_other_times(columns: Columns, rng: random.Random) -> Columns:
    """The log with rows lost, twice, backwards, late or all at one instant."""
    times = np.array([float(text) for text in columns[HEADERS[0]]])
    rows = np.arange(len(times))
    kind = rng.choice(("few", "sparse", "lost", "twice", "backwards", "late", "one instant"))
    if kind == "few":
        rows = rows[: rng.randint(0, 60)]
    elif kind == "sparse":
        rows = rows[:: rng.choice((3, 15, 29, 200, 1000))]
    elif kind == "lost":
        start = rng.randrange(len(rows))
        rows = np.delete(rows, slice(start, start + rng.randrange(1, 1500)))
    elif kind == "twice":
        rows = np.sort(np.append(rows, rng.choices(rows.tolist(), k=5)))
    elif kind == "backwards":
        rows = rows[::-1]
    elif kind == "late":
        times[rng.randrange(len(times)) :] += rng.choice((1e-9, 0.5, 1e3, 1e9, -0.5))
    else:
        times[:] = times[0]
    changed = {header: [texts[k] for k in rows] for header, texts in columns.items()}
    return {**changed, HEADERS[0]: [repr(float(time)) for time in times[rows]]}


_LETTERS = (" ", "[", "]", "(", ")", "\t", "m", "/", "°", "²", "*", "'", "\\", ".", "_")


def with_odd_header(columns: Columns, rng: random.Random) -> Columns:
    """The log with a header of up to some thousand odd letters, or of another unit."""
    header = rng.choice(HEADERS)
    name = header.split(" [")[0]
    odd = {
        "long": lambda: rng.choice(_LETTERS) * rng.choice((7, 500, 5000)),
        "mixed": lambda: name + "".join(rng.choices(_LETTERS, k=rng.choice((3, 40, 2000)))),
        "unit": lambda: f"{name} [{rng.choice(('V', 'deg', 'm/s^2', 'N m', '1', 'furlong'))}]",
        "empty": lambda: "",
    }
    new = odd[rng.choice(list(odd))]()
    return {new if each == header else each: texts for each, texts in columns.items()}


def without_a_column(columns: Columns, rng: random.Random) -> Columns:
    """The log without one of its columns."""
    lost = rng.choice(HEADERS)
    return {header: texts for header, texts in columns.items() if header != lost}


@pytest.mark.parametrize(
    "change", [with_huge_numbers, with_other_times, with_odd_header, without_a_column]
)
def test_another_log_is_judged_or_refused(
    change: Callable[[Columns, random.Random], Columns], hostile: Trial, step: Path, tmp_path: Path
) -> None:
    rng = random.Random(2)
    log = tmp_path / "log.csv"
    count = 4 if change is without_a_column else 20
    options = ("--no-figures", "--out", tmp_path / "out")
    log.write_text(log_text(step_log()), encoding="utf-8")
    hostile.run("sound", "run", step, "--log", log, *options)
    for index in range(count * TIMES):
        log.write_text(log_text(change(step_log(), rng)), encoding="utf-8")
        hostile.run(f"{change.__name__} {index}", "run", step, "--log", log, *options)
    hostile.run("no log", "run", step, "--log", tmp_path / "nothing.csv", *options)


# Recorders.

COLUMNS = {"current": {"column": "/u.value"}, "rotor angle": {"column": "/q.value"}}


def write_topics(path: Path, rng: random.Random) -> None:
    """Write a log whose two topics begin, end and sample as they please."""
    columns = step_log()
    times = [float(text) for text in columns[HEADERS[0]]]
    with path.open("wb") as file:
        writer = mcap.writer.Writer(file)
        writer.start()
        for topic, header in (("/u", HEADERS[1]), ("/q", HEADERS[2])):
            channel = writer.register_channel(topic, "json", 0)
            begin = rng.choice((0.0, 0.0, 0.001, 0.5, 2.9, 5.0))
            end = rng.choice((4.0, 4.0, 3.0, 1.0, 0.1))
            for time, text in list(zip(times, columns[header], strict=True))[:: rng.choice((1, 7))]:
                if begin <= time <= end:
                    stamp = 1_700_000_000_000_000_000 + round(1e9 * time)
                    content = json.dumps({"value": float(text)}).encode()
                    writer.add_message(channel, stamp, content, stamp)
        writer.finish()


def test_topics_that_begin_late_or_end_early_are_judged_or_refused(
    hostile: Trial, step: Path, tmp_path: Path
) -> None:
    rng = random.Random(3)
    run = {"duration": "2 s"}
    bag = {**STEP, "run": run, "log": {"columns": COLUMNS}}
    case = cases.write(tmp_path, "servo", name="bag", **bag)
    log = tmp_path / "log.mcap"
    options = ("--no-figures", "--out", tmp_path / "out")
    for index in range(15 * TIMES):
        write_topics(log, rng)
        hostile.run(f"topics {index}", "run", case, "--log", log, *options)
    hostile.run("no columns", "run", step, "--log", log, *options)


# Cases.

# Places of a case, and the units of their numbers.
PLACES = {
    '[[disturbance]]\ninput = "current"\namplitude = {}\n': "A",
    '[[disturbance]]\nbody = "rotor"\ntorque = ["0 N m", {}, "0 N m"]\n': "N m",
    '[[disturbance]]\nmeasured = "rotor angle"\namplitude = {}\n': "rad",
    '[run]\nduration = "0.05 s"\nstart = {{ "rotor speed" = {} }}\n': "rad/s",
    '[[actuator]]\nof = "current"\nlimit = {}\n': "A",
    '[[actuator]]\nof = "current"\nresolution = {}\n': "A",
    '[[actuator]]\nof = "current"\ngain = {}\n': "",
    '[[sensor]]\nof = "rotor angle"\nbias = {}\n': "deg",
    '[[sensor]]\nof = "rotor angle"\nnoise = {}\n': "rad",
    "[computing]\ndelay = {}\n": "s",
    '[[edit]]\nbody = "rotor"\nmass_scale = {}\n': "",
    '[[edit]]\njoint = "shaft"\ndamping = {}\n': "",
    "[[requirement]]\nstays_within = {}\n": "rad",
    '[run]\nduration = {}\ntimestep = "1 us"\n': "s",
}
SIZES = ("0", "1", "-1", "1e-320", "1e-9", "0.05", "1e8", "1e30", "1e99", "1e155", "1e308", "nan")
# Formulas, where a text stands for a function of time or a requirement.
FORMULAS = {
    "[task]\nreference = [{}]\n": (
        '"1e308"',
        '"step(t - 0.02)"',
        '"step(t - 1e308)"',
        '"exp(1e5*t)"',
        '"1/t"',
        '"sqrt(0.01 - t)"',
    ),
    "[[requirement]]\nalways = {}\n": (
        '"abs(rotor angle) < 1e308"',
        '"2 * abs(error) < 20 mrad"',
        '"abs(current) < 0.02 * abs(start(current))"',
        '"always[0.03 s, 0.01 s] error < 1 rad"',
        '"eventually[1e-9 s, 2e-9 s] error < 1 rad"',
        '"abs(error) / abs(error) < 2"',
    ),
}
BEGINNING = """
[plant]
system = "servo"
compare = ["physics"]
{}[[controller]]
law = "pd"
frequency = 6
damping = 0.7
[[requirement]]
stays_within = "5 rad"
"""


def case_with(text: str) -> str:
    """A case of the servo with a table."""
    run = "" if text.startswith("[run]") else '[run]\nduration = "0.05 s"\n'
    return BEGINNING.format(run) + text


def tables() -> list[str]:
    """Tables of a case with each size at each place, and with each formula."""
    texts = []
    for place, unit in PLACES.items():
        values = [f'"{size} {unit}"' if unit else size for size in SIZES]
        texts += [place.format(value) for value in values]
    for place, formulas in FORMULAS.items():
        texts += [place.format(formula) for formula in formulas]
    return texts


def test_numbers_of_a_case_are_judged_or_refused(hostile: Trial, tmp_path: Path) -> None:
    rng = random.Random(6)
    case = tmp_path / "case.toml"
    every = tables()
    for text in rng.sample(every, min(80 * TIMES, len(every))):
        case.write_text(case_with(text), encoding="utf-8")
        options = ("--no-figures", "--out", tmp_path / "out")
        hostile.run(text, "run", case, *options)


@pytest.mark.parametrize(
    "bound", ["1e-9 A", "0 A", "-1 A", "1e308 A", "nan A", "1 N m", "1", "", "1e-320 A"]
)
def test_bounds_of_a_disturbance_are_searched_or_refused(
    bound: str, hostile: Trial, step: Path, tmp_path: Path
) -> None:
    options = ("--on", "current", "--pieces", "2", "--no-figures", "--out", tmp_path / "out")
    command = ("study", "disturbance", "servo/nominal", "--laws", "lqr")
    hostile.run(bound, *command, "--bound", bound, *options)
    hostile.run("sound", "run", step, "--no-figures", "--out", tmp_path / "out")
    hostile.run("no case", "run", tmp_path / "nothing.toml", "--out", tmp_path / "out")


# Laws.

BRIEF: dict[str, Any] = {
    "plant": {"compare": ["physics"]},
    "run": {"duration": "50 ms"},
    "requirement": {"stays_within": "5 rad"},
}
# Names that C has as well.
C_NAMES = ("main", "round", "NAN", "double", "register", "law", "signed", "asm", "y0", "errno")
ATOMS = ("x[0]", "x[1]", "t", "0.0", "1.0", "-2.5", "1e308", 'float("nan")', "math.inf", "3")


def expression(rng: random.Random, depth: int) -> str:
    """A formula of a law, of some depth."""
    if depth == 0:
        return rng.choice(ATOMS)
    a, b, c = (expression(rng, depth - 1) for _ in range(3))
    forms = (
        f"({a} or {b})",
        f"({a} and {b})",
        f"(not {a})",
        f"({a} if {b} > {c} else {c})",
        f"({a} + {b} * {c})",
        f"({a} / {b})",
        f"({a} - {b}) ** 2",
        f"({a} < {b} < {c})",
        f"min({a}, {b})",
        f"max({a}, -{b})",
        f"abs({a})",
        f"math.sin({a})",
        f"math.sqrt({a})",
        f"math.fmod({a}, {b})",
        f"round({a})",
        f"int({a})",
    )
    return rng.choice(forms)


def law_text(rng: random.Random) -> str:
    """A law in Python: formulas, loops and names that C may take otherwise."""
    name = rng.choice(C_NAMES)
    formula = expression(rng, rng.randint(1, 2))
    loop = rng.choice(("range(0)", "range(3)", "range(int(x[0]))"))
    bodies = (
        f"    u[0] = {formula}\n",
        f"    {name} = {formula}\n    u[0] = {name}\n",
        f"    u[0] = 0.0\n    for k in {loop}:\n        u[0] += k * {formula}\n",
        f"    if {formula}:\n        u[0] = 1.0\n    else:\n        u[0] = -1.0\n",
        f"    u[0] = {name}({formula})\n",
        f"    return {formula}\n",
    )
    head = f"import math\n\n\ndef {name}(a):\n    return 2.0 * a\n\n\n"
    return f"{head}def law(t, x, memory, p, u):\n{rng.choice(bodies)}"


# A law is compiled for each command.
@pytest.mark.parametrize("command", ["run", "export"])
def test_a_law_runs_or_is_refused(command: str, hostile: Trial, tmp_path: Path) -> None:
    """What is exported without a word is the Python law to the bit: the command proves it."""
    rng = random.Random(7)
    out = ("--out", tmp_path / "out")
    options = (
        ("--no-figures", *out) if command == "run" else ("--law", "law", "--plants", "0", *out)
    )
    for index in range(12 * TIMES):
        source = tmp_path / f"law{index}.py"
        source.write_text(law_text(rng), encoding="utf-8")
        case = cases.write(tmp_path, "servo", law=f"{source.stem}:law", **BRIEF)
        hostile.run(f"{index}: {source.read_text()}", command, case, *options)
    hostile.run("no case", "run", tmp_path / "nothing.toml", *out)


# Places that are written to.


def put_link(place: Path, victim: Path) -> None:
    """Put a link to a file of somebody else."""
    place.symlink_to(victim)


def put_pipe(place: Path, victim: Path) -> None:
    """Put a pipe that nobody reads."""
    os.mkfifo(place)


def put_folder(place: Path, victim: Path) -> None:
    """Put a folder."""
    place.mkdir()


def put_hard_link(place: Path, victim: Path) -> None:
    """Put another name of a file of somebody else."""
    place.hardlink_to(victim)


COMMANDS = {
    "run": ("run", "servo/nominal", "--no-figures"),
    "export": ("export", "servo/nominal", "--law", "lqr", "--plants", "0"),
    "compare": ("compare", CASES / "logs" / "servo.csv", "logs/servo"),
    "report": ("claims", "premises", "servo/nominal", "--laws", "lqr"),
}


@pytest.mark.parametrize("put", [put_link, put_pipe, put_folder, put_hard_link])
def test_nothing_is_written_through_what_stands_at_a_result(
    put: Callable[[Path, Path], None], hostile: Trial, tmp_path: Path
) -> None:
    for name, command in COMMANDS.items():
        sound = tmp_path / name / "sound"
        hostile.run(f"{name} sound", *command, "--out", sound)
        written = [path.relative_to(sound) for path in sorted(sound.rglob("*")) if path.is_file()]
        for index, file in enumerate(written):
            victim = tmp_path / f"{name}{index}.txt"
            victim.write_text("somebody's", encoding="utf-8")
            place = tmp_path / name / str(index) / file
            place.parent.mkdir(parents=True)
            put(place, victim)
            hostile.run(f"{put.__name__} {file}", *command, "--out", tmp_path / name / str(index))
            assert victim.read_text(encoding="utf-8") == "somebody's", file
    hostile.run("no case", "run", tmp_path / "nothing.toml", "--out", tmp_path / "out")


# Robots.

GRIPPER = """<mujoco model="arm with gripper">
  <compiler autolimits="true"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" range="RANGE" damping="1"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="1" contype="0"/>
      <body name="lower" pos="0.3 0 0">
        <joint name="elbow" axis="0 1 0" range="RANGE" damping="0.5"/>
        <geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.025" mass="0.6" contype="0"/>
        <body name="left" pos="0.27 0 0">
          <joint name="finger1" type="slide" axis="0 1 0" range="0 0.04" armature="0.1"/>
          <geom type="box" size="0.02 0.005 0.01" mass="0.02" contype="0"/>
        </body>
        <body name="right" pos="0.27 0 0">
          <joint name="finger2" type="slide" axis="0 -1 0" range="0 0.04" armature="0.1"/>
          <geom type="box" size="0.02 0.005 0.01" mass="0.02" contype="0"/>
        </body>
      </body>
    </body>
  </worldbody>
PARTS</mujoco>
"""
PARTS = (
    '<tendon><fixed name="split"><joint joint="finger1" coef="0.5"/>'
    '<joint joint="finger2" coef="0.5"/></fixed></tendon>',
    '<tendon><fixed name="mixed"><joint joint="elbow" coef="1"/>'
    '<joint joint="finger1" coef="1"/></fixed></tendon>',
    '<equality><joint joint1="finger1" joint2="finger2"/></equality>',
    '<equality><weld body1="left" body2="right"/></equality>',
    '<sensor><jointpos name="grip" joint="finger1"/></sensor>',
    '<sensor><tendonpos name="open" tendon="split"/></sensor>',
    '<actuator><motor name="grip" tendon="split"/></actuator>',
    '<actuator><motor name="close" joint="finger1" gear="5"/></actuator>',
    '<contact><exclude body1="left" body2="right"/></contact>',
    '<keyframe><key name="home" qpos="0 0 0.01 0.01"/></keyframe>',
    '<keyframe><key name="away" qpos="0 0" ctrl="1 2 3"/></keyframe>',
)
DRIVES = (
    '<actuator><motor name="a1" joint="shoulder" gear="40"/>'
    '<motor name="a2" joint="elbow" gear="20"/></actuator>'
)
RANGES = ("-2 2", "-120 120", "0 0", "1 -1", "-3.14 3.14", "0 1e308", "nan 1", "5")


def write_robot(folder: Path, rng: random.Random) -> Path:
    """Write an arm of which a case takes some joints; returns the case."""
    parts = [DRIVES, *rng.sample(PARTS, rng.randint(1, 4))]
    model = GRIPPER.replace("RANGE", rng.choice(RANGES)).replace("PARTS", "\n".join(parts))
    (folder / "arm.xml").write_text(model, encoding="utf-8")
    joints = [["shoulder", "elbow"], ["shoulder", "elbow"], ["elbow"], ["shoulder", "finger1"]]
    chosen = rng.choice(joints)
    reference = {joint: str(rng.choice((0.0, 0.01, 0.3, 90))) for joint in chosen}
    return cases.write(
        folder,
        "arm.xml",
        plant={"joints": chosen},
        run={"duration": "50 ms"},
        task={"reference": reference, "Q": 10, "R": 1},
        requirement={"settles_within": "40 ms"},
    )


def test_an_arm_with_a_gripper_is_judged_or_refused(hostile: Trial, tmp_path: Path) -> None:
    rng = random.Random(8)
    for index in range(30 * TIMES):
        case = write_robot(tmp_path, rng)
        hostile.run(f"arm {index}", "run", case, "--no-figures", "--out", tmp_path / "out")


# States that no input reaches.

PLANT = """import sympy as sp

import grosmc_mj as gm

q, w, z = sp.symbols("q w z")


def plant():
    units = {{"q": "rad", "w": "rad/s", "z": "rad"}}
    f = [w, {coupling} * z, {growth} * z]
    g = [0, 1, {reach}]
    return gm.affine_plant("carried", states=units, inputs={{"u": "N"}}, f=f, g=g, h=[q])
"""


# Rates of growth [1/s], and how the state couples with the rest.
@pytest.mark.parametrize(
    ("growth", "coupling", "reach"),
    [(0.5, 1, 0), (-0.5, 1, 0), (0.0, 1, 0), (3.0, 0, 0), (0.5, 0, 1), (-2.0, 0, 1)],
)
def test_a_state_that_grows_by_itself_is_named(
    growth: float, coupling: float, reach: float, hostile: Trial, tmp_path: Path
) -> None:
    """Neither the law of the output nor its requirement sees it."""
    source = tmp_path / f"plant{round(10 * growth + 50)}{coupling}{reach}.py"
    source.write_text(PLANT.format(growth=growth, coupling=coupling, reach=reach), encoding="utf-8")
    case = cases.write(
        tmp_path,
        f"{source.stem}:plant",
        run={"start": {"q": "0.1 rad", "z": "0.01 rad"}, "duration": "2 s"},
        task={"reference": ["0"], "Q": [1, 1], "R": 1},
        requirement={"settles_within": "6 s"},
    )
    options = ("--no-figures", "--out", tmp_path / "out")
    answer = hostile.run(source.stem, "run", case, *options)
    if growth > 0 and answer.code != cli.WRONG:
        assert re.search(r"\bz\b.*(grows|unstable)|(grows|unstable).*\bz\b", answer.output)
    hostile.run("sound", "run", "servo/nominal", *options)
    hostile.run("no case", "run", tmp_path / "nothing.toml", *options)
