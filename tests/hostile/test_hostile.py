"""Mutated case files, models and command lines: kept, a verdict, or one line."""

from __future__ import annotations

import json
import os
import random
import re
from pathlib import Path

import cases
import mcap.writer
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest
from hostile_trial import Trial
from mjcf import TREE
from scipy.io import savemat

from grosmc_mj.experiments.file.shipped import CASES, campaign_files, shipped_files

pytestmark = [pytest.mark.slow, pytest.mark.apart]

# So many times as many mutations; `make hostile` asks for more.
TIMES = int(os.environ.get("HOSTILE", "1"))

# In place of a number, or no number that anything should be.
NUMBERS = (
    "0",
    "-0.0",
    "-1",
    "nan",
    "-inf",
    "1e308",
    "1e-320",
    "1e400",
    "9" * 19,
    "9" * 5000,
    "0x10",
    "true",
    '""',
    "[]",
    "[1, [2]]",
    "{}",
    "1979-05-27",
    '"nan"',
    "[" * 3000 + "]" * 3000,
)
# In place of a text. CANARY becomes code that would leave a file behind.
TEXTS = (
    "",
    ".",
    "../../up",
    "/etc/passwd",
    "/dev/zero",
    "a/" * 999,
    "\\u0000",
    "\\u001b[31mred",
    "\\n\\ngrosmc-mj: all is well",
    "\\u202egnp",
    "\\uD7FF",
    "x" * 100_000,
    "[bold]x[/]",
    "[/]",
    "{}",
    "%s%n",
    "nan",
    "-1 s",
    "0 s",
    "1e-300 s",
    "1e300 s",
    "nan s",
    "1e400 rad",
    "1 parsec",
    "1 m**9**9",
    "1 s s s",
    "10 ** 10",
    "os:system",
    "json:dumps",
    "canary:law",
    ":law",
    "a:b:c",
    "..canary:x",
    "sin(t",
    "9**9**9",
    "((9!)!)!",
    "(" * 900 + "t" + ")" * 900,
    "1/(t-t)",
    "1/step(t-1)",
    "step(step(-t))**-64",
    "sqrt(-1)",
    "lambda: t",
    "t.__class__",
    "CANARY",
    'sin(\\"CANARY\\")',
    "sin('CANARY')",
    "__import__('os')",
    "servo",
    "physics",
    "lqr",
    "grosmc",
    "pulse",
)
_LETTERS = "\0\x1b\r\n\t\"'[]{}=.,#\\é\u202e\U0001f600"
_NAMES = ("law", "name", "model", "plant", "x" * 5000, '"\\u001b"', "k", "Q", "reference", '"a.b"')
_HEADERS = (
    "[plant]",
    "[[plant]]",
    "[run]",
    "[[edit]]",
    "[task]",
    "[[uncertain]]",
    "[x]",
    "[[[x]]]",
)
_TEXT = r'"[^"\n]*"'
_QUANTITIES = tuple(number for number in NUMBERS if number[0].isalnum())
# Places of a case file, and their replacements.
_PLACES = {
    "key": (r"(?m)^[A-Za-z_]+(?= *=)", _NAMES),
    "header": (r"(?m)^\[+[A-Za-z_]+\]+$", _HEADERS),
    "number": (r"(?<![\w\"'])-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?", NUMBERS),
    "text": (_TEXT, tuple(f'"{text}"' for text in TEXTS)),
    "text as number": (_TEXT, NUMBERS),
    "quantity": (r'(?<=")-?\d+(?:\.\d+)?(?= )', _QUANTITIES),
}
# Kinds of mutations: of letters, of lines and of places.
_LINES = ("cut", "double", "swap")
KINDS = ("end", "noise", *_LINES, *_PLACES)


def replaced(pattern: str, text: str, rng: random.Random, new: str) -> str:
    """One of the places that a pattern matches, replaced; \\g<0> in the new text is the old one."""
    places = list(re.finditer(pattern, text))
    if not places:
        return new
    place = rng.choice(places)
    return text[: place.start()] + new.replace(r"\g<0>", place[0]) + text[place.end() :]


def _with_lines(text: str, rng: random.Random, kind: str) -> str:
    """A text with a line left out, twice, or in another one's place."""
    lines = text.splitlines(keepends=True)
    i = rng.randrange(len(lines))
    j = rng.randrange(len(lines))
    if kind == "cut":
        del lines[i]
    elif kind == "double":
        lines.insert(i, lines[i])
    else:
        lines[i], lines[j] = lines[j], lines[i]
    return "".join(lines)


def _with_noise(text: str, rng: random.Random) -> str:
    """A text with some letters replaced."""
    letters = list(text)
    for _ in range(rng.randint(1, 5)):
        letters[rng.randrange(len(letters))] = rng.choice(_LETTERS)
    return "".join(letters)


def mutated(text: str, rng: random.Random, kind: str) -> str:
    """A text with a mutation of a kind."""
    if kind == "end":
        return text[: rng.randrange(len(text))]
    if kind == "noise":
        return _with_noise(text, rng)
    if kind in _LINES:
        return _with_lines(text, rng, kind)
    pattern, replacements = _PLACES[kind]
    return replaced(pattern, text, rng, rng.choice(replacements))


def mutant(text: str, rng: random.Random, canary: str) -> tuple[str, str]:
    """A mutated text and the kind of its mutation."""
    kind = rng.choice(KINDS)
    # In octal, which hides it from a filter of words.
    program = f"__import__('pathlib').Path({canary!r}).touch()"
    code = "".join(f"\\\\{ord(letter):o}" for letter in program)
    return kind, mutated(text, rng, kind).replace("CANARY", code)


# Mutants of a file, and of a file whose laws take long to design.
CHEAP = 3 * TIMES
DEAR = 1 * TIMES
_DEAR = ("cart_pendulum", "cartpole", "starter", "two_link_arm/regulation")
# The Jaco's take seconds each, whatever is in them; other robots are among the models.
_LEFT_OUT = "jaco"


def texts() -> dict[str, str]:
    """The shipped case and campaign files, cut to a few milliseconds and to MuJoCo."""
    files = {**shipped_files(), "starter/starter": CASES / "starter.toml"}
    for name, path in campaign_files().items():
        files[f"{name}/campaign"] = path

    short = {}
    for name, path in files.items():
        if not name.startswith(_LEFT_OUT):
            short[name] = _shortened(name, path.read_text(encoding="utf-8"))
    return short


def _shortened(name: str, text: str) -> str:
    """A case file cut to a few milliseconds and to MuJoCo."""
    text = re.sub(r'(?m)^duration = ".*?"', 'duration = "0.02 s"', text)
    text = re.sub(r'(?m)^after = ".*?"', 'after = "0.01 s"', text)
    if "compare" not in text and 'system = "' in text:
        text = text.replace("[plant]\n", '[plant]\ncompare = ["physics"]\n', 1)
    # A formula of one's own is the way to code that executes text.
    if name == "arm/nominal":
        text = text.replace("[run]\n", '[run]\nengine = "python"\n')
        text += '\n[task]\nreference = ["0.1*sin(2*t)"]\n'
    return text


def test_mutated_case_files(hostile: Trial, tmp_path: Path) -> None:
    file = tmp_path / "case.toml"
    out = tmp_path / "out"
    for name, text in texts().items():
        rng = random.Random(f"{name} 1")
        mutants = DEAR if name.startswith(_DEAR) else CHEAP
        for index in range(mutants):
            kind, changed = mutant(text, rng, str(hostile.canary))
            file.write_text(changed, encoding="utf-8")
            hostile.run(f"{name} {index} {kind}", "run", file, "--no-figures", "--out", out)


_ELEMENT = r"<(\w+)[^<>]*/>"
_ELEMENTS = (
    "<freejoint/>",
    '<joint type="ball"/>',
    '<joint type="slide" axis="0 0 0"/>',
    "<nothing/>",
    '<geom type="mesh" mesh="none"/>',
    '<include file="robot.xml"/>',
    '<include file="/dev/zero"/>',
    '<replicate count="2"/>',
    '<geom size="0.1" mass="-1"/>',
    '<inertial pos="0 0 0" mass="0"/>',
    '<plugin plugin="nothing"/>',
    '<frame euler="nan 0 0"/>',
    '<body name="boom"/>',
    "<!-- ",
)


def mutated_model(rng: random.Random) -> tuple[str, str]:
    """A mutated model and the kind of its mutation."""
    kind = rng.choice(("value", "value", "number", "number", "element", "added", "line", "cut"))
    if kind == "cut":
        return kind, TREE[: rng.randrange(len(TREE))]
    value = rng.choice((*TEXTS, *NUMBERS)).replace('"', "'").replace("<", "")
    number = rng.choice([number for number in NUMBERS if number[0] not in '"[{'])
    element = rng.choice(_ELEMENTS)
    pattern, new = {
        "value": (r'(?<==")[^"]*(?=")', value),
        "number": (r"-?\d+(?:\.\d+)?", number),
        "element": (_ELEMENT, ""),
        "added": (_ELEMENT, rf"\g<0>{element}"),
        "line": (r"(?m)^.*\n", ""),
    }[kind]
    return kind, replaced(pattern, TREE, rng, new)


def test_mutated_models(hostile: Trial, tmp_path: Path) -> None:
    rng = random.Random(4)
    laws = [{"law": "lqr"}, {"law": "grosmc", "k": 5, "epsilon": 2}]
    run = {"duration": "10 ms"}
    case = cases.write(tmp_path, "robot.xml", run=run, task={"Q": 10, "R": 1}, controller=laws)
    for index in range(25 * TIMES):
        kind, changed = mutated_model(rng)
        (tmp_path / "robot.xml").write_text(changed, encoding="utf-8")
        hostile.run(f"{kind} {index}", "run", case, "--no-figures", "--out", tmp_path / "out")


# OUT and CASE become a folder and a file. Long commands are wrong in two ways: a mutation may well
# mend one of them.
COMMANDS = (
    "run CASE --no-figures --out OUT",
    "new mine --like arm/case1",
    "campaign CASE --runs 2 --shard 1 --seed 3 --sampler corners --out OUT --no-figures",
    "campaign OUT --plant 0 --laws lqr",
    "claims premises servo/case9 --laws nothing --out OUT",
    "film arm --duration 0 --laws lqr grosmc --switching banana --surface printed -o f.mp4",
    "view arm/case9 --laws lqr --speed 0",
    "study region servo/case9 --points 0 --duration 0.01 --limits -10 1 --out OUT",
    "report OUT CASE --verbose -o OUT/report.html",
    "diff OUT CASE --out OUT --verbose",
    "study tolerance servo/case9 --laws lqr nothing --draws 0 --out OUT",
    "tune servo/case9 --law lqr --number laws.lqr.Q[1]=1e5..1 --runs 0 --plants -1 --out OUT",
)
_WORDS = (
    "",
    "-",
    "--",
    "---",
    "-o",
    "--help",
    "--out",
    "--nothing",
    "-1",
    "CASE/..",
    "OUT",
    "\x1b[31m",
    "a\nb",
    "\udcff",
    "\U0001f600",
    "CASE",
    "arm",
    "lqr",
    "/dev/null",
    "/dev/full",
)


def mutated_line(command: str, rng: random.Random) -> list[str]:
    """The words of a command line with one word, or two, that should not be there."""
    words = command.split()
    for _ in range(rng.randint(1, 2)):
        index = rng.randrange(len(words) + 1)
        word = rng.choice((rng.choice(_WORDS), rng.choice(TEXTS), rng.choice(NUMBERS)))
        kind = rng.choice(("replace", "insert", "remove", "double"))
        # The command itself, at 0, is neither replaced nor removed.
        if kind == "insert" or index == len(words):
            words.insert(index, word)
        elif kind == "double":
            words.insert(index, words[index])
        elif kind == "replace" and index > 0:
            words[index] = word
        elif kind == "remove" and index > 0:
            del words[index]
    return words


def test_mutated_command_lines(hostile: Trial, tmp_path: Path) -> None:
    rng = random.Random(2)
    case = tmp_path / "case.toml"
    run = {"duration": "0.1 s", "engine": "python"}
    text = cases.text("arm", law="lqi", plant={"compare": ["physics"]}, run=run)
    places = {"CASE": str(case), "OUT": str(tmp_path / "out"), "f.mp4": "/dev/null/f.mp4"}
    for command in COMMANDS:
        for index in range(3 * TIMES):
            case.write_text(text)
            words = mutated_line(command, rng)
            words = [places.get(word, word.replace("\0", "")) for word in words]
            hostile.run(f"{command} {index}: {words!r:.200}", *words, leaves=True)


# Logs and results, whose bytes are changed: nobody writes them by hand.


def with_other_bytes(content: bytes, rng: random.Random) -> bytes:
    """A file that is cut off, or has other bytes here and there, or a part twice."""
    changed = bytearray(content)
    kind = rng.choice(("end", "noise", "noise", "double"))
    if kind == "end":
        del changed[rng.randrange(len(changed)) :]
    elif kind == "double":
        start = rng.randrange(len(changed))
        changed[start:start] = changed[start : start + rng.randrange(1, 200)]
    else:
        for _ in range(rng.randint(1, 20)):
            changed[rng.randrange(len(changed))] = rng.randrange(256)
    return bytes(changed)


# In place of a field of a CSV file.
_FIELDS = (
    "",
    "nan",
    "1e400",
    "-1e308",
    "9" * 400,
    "1,5",
    "1;5",
    '"',
    '"a\nb"',
    "#",
    "\ufeff",
    "on",
)


def with_other_field(content: bytes, rng: random.Random) -> bytes:
    """A CSV file with another field, another separator, or one column more, in some encoding."""
    rows = [line.split(",") for line in content.decode().splitlines()]
    field = rng.choice(_FIELDS)
    separator = ","
    kind = rng.choice(("field", "field", "column", "separator"))
    if kind == "field":
        # The first lines decide how the others are read.
        row = rng.choice((0, 1, rng.randrange(len(rows))))
        rows[row][rng.randrange(len(rows[row]))] = field
    elif kind == "column":
        rows = [[*row, field] for row in rows]
    else:
        separator = rng.choice((";", "\t", " ", ",,"))
    text = "\n".join(separator.join(row) for row in rows)
    return text.encode(rng.choice(("utf-8", "utf-8-sig", "utf-16")))


def write_bag(table: pa.Table, path: Path) -> None:
    """Write a log as an MCAP file of JSON messages."""
    with path.open("wb") as file:
        writer = mcap.writer.Writer(file)
        writer.start()
        channel = writer.register_channel("/servo", "json", 0)
        for row in table.to_pylist():
            stamp = round(1e9 * row["time [s]"])
            writer.add_message(channel, stamp, json.dumps(row).encode(), stamp)
        writer.finish()


BAG = {
    "current": {"column": "/servo.current [A]"},
    "rotor angle": {"column": "/servo.rotor angle [rad]"},
}


def log_files(folder: Path) -> dict[str, bytes]:
    """A short log of the servo as CSV, Parquet, MCAP and MATLAB."""
    text = (CASES / "logs" / "servo.csv").read_text(encoding="utf-8")
    short = folder / "short.csv"
    short.write_text("".join(text.splitlines(keepends=True)[:300]), encoding="utf-8")
    table = pyarrow.csv.read_csv(short)
    pq.write_table(table, folder / "short.parquet")
    write_bag(table, folder / "short.mcap")
    arrays = zip(("time", "current", "rotor_angle"), table.columns, strict=True)
    savemat(folder / "short.mat", {name: column.to_numpy() for name, column in arrays})
    return {path.suffix: path.read_bytes() for path in sorted(folder.glob("short.*"))}


def test_mutated_logs(hostile: Trial, tmp_path: Path) -> None:
    rng = random.Random(6)
    case = cases.write(tmp_path, "logs/servo", name="bag", log={"columns": BAG})
    for suffix, content in log_files(tmp_path).items():
        file = tmp_path / f"log{suffix}"
        of = case if suffix == ".mcap" else "logs/servo"
        hostile.run(f"sound {suffix}", "compare", file.with_stem("short"), of, "--out", tmp_path)
        for index in range(9 * TIMES):
            mutate = with_other_bytes
            if suffix == ".csv" and index % 2:
                mutate = with_other_field
            file.write_bytes(mutate(content, rng))
            name = f"{suffix} {index}"
            hostile.run(name, "compare", file, of, "--out", tmp_path / "out")


def test_mutated_results(hostile: Trial, tmp_path: Path) -> None:
    """Also the good result beside the mutated one is shown."""
    rng = random.Random(7)
    old = tmp_path / "old"
    new = tmp_path / "new"
    for folder in (old, new):
        hostile.run("sound", "run", "servo/nominal", "--no-figures", "--out", folder)
    (file,) = new.glob("*.json")
    content = file.read_bytes()
    for index in range(25 * TIMES):
        file.write_bytes(with_other_bytes(content, rng))
        hostile.run(f"diff {index}", "diff", old, new, "--out", tmp_path / "out")
        page = tmp_path / "out" / "report.html"
        hostile.run(f"report {index}", "report", new, "-o", page)
