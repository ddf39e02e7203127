"""Mutated command lines: kept, a verdict, or one line."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from mutation import NUMBERS, TEXTS
from trial import TIMES, trial

pytestmark = [pytest.mark.slow, pytest.mark.apart]

CASE = """
[plant]
system = "arm"
compare = ["physics"]
[run]
duration = "0.01 s"
[[controller]]
law = "lqr"
[[requirement]]
input_below = "5 N m"
"""
# OUT and CASE become a folder and a file. What would take long is wrong in two ways, as a mutation
# may well mend one of them.
COMMANDS = (
    "run CASE --no-figures --out OUT",
    "new mine --like arm/case1",
    "campaign CASE --runs 2 --shard 1 --seed 3 --sampler lhs --out OUT --no-figures",
    "campaign CASE --runs 2 --workers 0 --screen equations --worst --evaluations 5 --at-least 2",
    "campaign OUT --replay 0 --controller lqr --engine python",
    "claims self-test nothing --out OUT",
    "claims nothing --page page.txt",
    "claims premises servo/case9 --controller nothing --out OUT",
    "film servo/case9 --size 641x480 --fps 30 --speed 1 --from 0 --to 1 -o f.avi",
    "film arm --duration 0 --controllers lqr grosmc --switching banana --surface printed -o f.mp4",
    "list CASE --verbose",
    "view arm/case9 --controller lqr --speed 0",
    "study region servo/case9 --points 0 --duration 0.01 --rate -10 --screen none --out OUT",
    "study switching banana --nothing --out OUT",
    "report OUT CASE --verbose -o OUT/report.html",
    "diff OUT CASE --junit OUT/junit.xml --out OUT --verbose",
    "study tolerance servo/case9 --laws lqr nothing --seeds 0 --every-end --out OUT",
    "bench --integrator heun --rounds 0",
    "validate nothing/case9 --control-period 0.001 --timestep 0 --out OUT",
    "replay OUT 0 --case nothing",
)
_WORDS = (
    "", "-", "--", "---", "-o", "--help", "--out", "--nothing", "-1", "CASE/..", "OUT",
    "\x1b[31m", "a\nb", "\udcff", "\U0001f600", "CASE", "arm", "lqr", "/dev/null", "/dev/full",
)  # fmt: skip
_TRIED = 4 * TIMES


def mutated(words: list[str], rng: random.Random) -> list[str]:
    """A command line with one word, or two, that should not be there."""
    for _ in range(rng.randint(1, 2)):
        index = rng.randrange(len(words) + 1)
        new = rng.choice((rng.choice(_WORDS), rng.choice(TEXTS), rng.choice(NUMBERS)))
        how = rng.choice(("replace", "insert", "remove", "double"))
        if how == "insert" or index == len(words):
            words = [*words[:index], new, *words[index:]]
        elif how == "replace" and index > 0:
            words = [*words[:index], new, *words[index + 1 :]]
        elif how == "double":
            words = [*words[:index], words[index], *words[index:]]
        elif index > 0:
            words = [*words[:index], *words[index + 1 :]]
    return words


def test_mutated_command_lines(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    rng, tried, case = random.Random(2), 0, tmp_path / "case.toml"
    with trial(capfd, tmp_path) as hostile:
        for command in COMMANDS:
            for index in range(_TRIED):
                case.write_text(CASE)
                words = mutated(list[str](command.split()), rng)
                places = {
                    "CASE": str(case),
                    "OUT": str(tmp_path / "out"),
                    "f.mp4": "/dev/null/f.mp4",
                }
                given = [places.get(word, word.replace("\0", "")) for word in words]
                hostile.run(f"{command} {index}: {given!r:.200}", *given, leaves=True)
                tried += 1
    hostile.finish(tried)
