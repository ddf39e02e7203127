"""Mutated case files, models and command lines: kept, a verdict, or one line."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest
from case_texts import RIVAL
from hostile import NUMBERS, TEXTS, TIMES, mutant, replaced, trial
from mjcf import TREE

from grosmc_mj.experiments.file.shipped import CASES, campaign_files, shipped_files

pytestmark = [pytest.mark.slow, pytest.mark.apart]

# Mutants of a file; those of files whose laws take long to design are fewer.
CHEAP, DEAR = 3 * TIMES, 1 * TIMES
_DEAR = ("cart_pendulum", "cartpole", "starter", "two_link_arm/regulation")
# The Jaco's take seconds each, whatever is in them; other robots are among the models.
_LEFT_OUT = "jaco"


def texts() -> dict[str, str]:
    """The shipped case and campaign files, cut to a few milliseconds and to MuJoCo."""
    files = {**shipped_files(), "starter/starter": CASES / "starter.toml"}
    files |= {f"{name}/campaign": path for name, path in campaign_files().items()}
    short = {}
    for name, path in files.items():
        text = path.read_text(encoding="utf-8")
        text = re.sub(r'(?m)^duration = ".*?"', 'duration = "0.02 s"', text)
        text = re.sub(r'(?m)^after = ".*?"', 'after = "0.01 s"', text)
        if "compare" not in text and 'system = "' in text:
            text = text.replace("[plant]\n", '[plant]\ncompare = ["physics"]\n', 1)
        # A formula of one's own is the way to code that executes text.
        if name == "arm/nominal":
            text = text.replace("[run]\n", '[run]\nengine = "python"\n')
            text += '\n[task]\nreference = ["0.1*sin(2*t)"]\n'
        short[name] = text
    return {name: text for name, text in short.items() if not name.startswith(_LEFT_OUT)}


def test_mutated_case_files(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    plan = [
        (name, text, DEAR if name.startswith(_DEAR) else CHEAP) for name, text in texts().items()
    ]
    file, out = tmp_path / "case.toml", tmp_path / "out"
    with trial(capfd, tmp_path, sum(count for *_, count in plan)) as hostile:
        for name, text, count in plan:
            rng = random.Random(f"{name} 1")
            for index in range(count):
                kind, changed = mutant(text, rng, str(hostile.canary))
                file.write_text(changed, encoding="utf-8")
                hostile.run(f"{name} {index} {kind}", "run", file, "--no-figures", "--out", out)


CASE = """
[plant]
model = "robot.xml"
[run]
duration = "0.01 s"
[task]
Q = 10
R = 1
[[controller]]
law = "lqr"
[[controller]]
law = "grosmc"
k = 5
epsilon = 2
"""
_ELEMENT = r"<(\w+)[^<>]*/>"
_ELEMENTS = (
    '<freejoint/>', '<joint type="ball"/>', '<joint type="slide" axis="0 0 0"/>', "<nothing/>",
    '<geom type="mesh" mesh="none"/>', '<include file="robot.xml"/>', '<include file="/dev/zero"/>',
    '<replicate count="2"/>', '<geom size="0.1" mass="-1"/>', '<inertial pos="0 0 0" mass="0"/>',
    '<plugin plugin="nothing"/>', '<frame euler="nan 0 0"/>', '<body name="boom"/>', "<!-- ",
)  # fmt: skip
_MODELS = 25 * TIMES


def mutated_model(rng: random.Random) -> tuple[str, str]:
    """A mutated model and the kind of its mutation."""
    kind = rng.choice(("value", "value", "number", "number", "element", "added", "line", "cut"))
    if kind == "cut":
        return kind, TREE[: rng.randrange(len(TREE))]
    value = rng.choice((*TEXTS, *NUMBERS)).replace('"', "'").replace("<", "")
    number = rng.choice([number for number in NUMBERS if number[0] not in '"[{'])
    pattern, new = {
        "value": (r'(?<==")[^"]*(?=")', value),
        "number": (r"-?\d+(?:\.\d+)?", number),
        "element": (_ELEMENT, ""),
        "added": (_ELEMENT, r"\g<0>" + rng.choice(_ELEMENTS)),
        "line": (r"(?m)^.*\n", ""),
    }[kind]
    return kind, replaced(pattern, TREE, rng, new)


def test_mutated_models(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    rng, case = random.Random(4), tmp_path / "case.toml"
    case.write_text(CASE)
    with trial(capfd, tmp_path, _MODELS) as hostile:
        for index in range(_MODELS):
            kind, changed = mutated_model(rng)
            (tmp_path / "robot.xml").write_text(changed, encoding="utf-8")
            hostile.run(f"{kind} {index}", "run", case, "--no-figures", "--out", tmp_path / "out")


# OUT and CASE become a folder and a file. Long commands are wrong in two ways: a mutation may well
# mend one of them.
COMMANDS = (
    "run CASE --no-figures --out OUT",
    "new mine --like arm/case1",
    "campaign CASE --runs 2 --shard 1 --seed 3 --sampler lhs --out OUT --no-figures",
    "campaign OUT --replay 0 --controller lqr --engine python",
    "claims premises servo/case9 --controller nothing --out OUT",
    "film arm --duration 0 --controllers lqr grosmc --switching banana --surface printed -o f.mp4",
    "view arm/case9 --controller lqr --speed 0",
    "study region servo/case9 --points 0 --duration 0.01 --limits -10 1 --out OUT",
    "report OUT CASE --verbose -o OUT/report.html",
    "diff OUT CASE --junit OUT/junit.xml --out OUT --verbose",
    "study tolerance servo/case9 --laws lqr nothing --seeds 0 --out OUT",
)
_WORDS = (
    "", "-", "--", "---", "-o", "--help", "--out", "--nothing", "-1", "CASE/..", "OUT",
    "\x1b[31m", "a\nb", "\udcff", "\U0001f600", "CASE", "arm", "lqr", "/dev/null", "/dev/full",
)  # fmt: skip
_LINES = 3 * TIMES


def mutated_line(words: list[str], rng: random.Random) -> list[str]:
    """A command line with one word, or two, that should not be there."""
    for _ in range(rng.randint(1, 2)):
        index = rng.randrange(len(words) + 1)
        new = [rng.choice((rng.choice(_WORDS), rng.choice(TEXTS), rng.choice(NUMBERS)))]
        how = rng.choice(("replace", "insert", "remove", "double"))
        if how == "insert" or index == len(words):
            words = words[:index] + new + words[index:]
        elif how == "double":
            words = words[:index] + words[index : index + 1] + words[index:]
        elif index > 0:
            words = words[:index] + (new if how == "replace" else []) + words[index + 1 :]
    return words


def test_mutated_command_lines(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    rng, case = random.Random(2), tmp_path / "case.toml"
    places = {"CASE": f"{case}", "OUT": f"{tmp_path / 'out'}", "f.mp4": "/dev/null/f.mp4"}
    with trial(capfd, tmp_path, _LINES * len(COMMANDS)) as hostile:
        for command in COMMANDS:
            for index in range(_LINES):
                case.write_text(RIVAL)
                words = mutated_line(list[str](command.split()), rng)
                words = [places.get(word, word.replace("\0", "")) for word in words]
                hostile.run(f"{command} {index}: {words!r:.200}", *words, leaves=True)
