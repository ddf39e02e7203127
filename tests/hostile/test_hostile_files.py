"""Mutated case files: kept, a verdict, or one line."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest
from mutation import mutant
from trial import TIMES, trial

from grosmc_mj.experiments.file.shipped import CASES, campaign_files, shipped_files

pytestmark = [pytest.mark.slow, pytest.mark.apart]

# Mutants of each file; those of files whose laws take long to design are fewer.
CHEAP, DEAR = 12 * TIMES, 1 * TIMES
_DEAR = ("cart_pendulum", "cartpole", "starter", "two_link_arm/regulation")
# The Jaco's take seconds each, whatever is in them; other robots are in test_hostile_models.
_LEFT_OUT = "jaco"


def texts() -> dict[str, str]:
    """The shipped case and campaign files, cut to a few milliseconds and to MuJoCo."""
    files = {**shipped_files(), "starter/starter": CASES / "starter.toml"}
    files |= {f"{name}/campaign": path for name, path in campaign_files().items()}
    short = {}
    for name, path in files.items():
        text = path.read_text(encoding="utf-8")
        text = re.sub(r'^duration = ".*?"', 'duration = "0.02 s"', text, flags=re.MULTILINE)
        text = re.sub(r'^after = ".*?"', 'after = "0.01 s"', text, flags=re.MULTILINE)
        if "compare" not in text and 'system = "' in text:
            text = text.replace("[plant]\n", '[plant]\ncompare = ["physics"]\n', 1)
        # A formula of one's own is the way to what executes text.
        if name == "arm/nominal":
            text = text.replace("[run]\n", '[run]\nengine = "python"\n')
            text += '\n[task]\nreference = ["0.1*sin(2*t)"]\n'
        short[name] = text
    return {name: text for name, text in short.items() if not name.startswith(_LEFT_OUT)}


@pytest.mark.parametrize("half", [0, 1])
def test_mutated_case_files(half: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    tried = 0
    with trial(capfd, tmp_path) as hostile:
        for name, text in list(texts().items())[half::2]:
            rng = random.Random(f"{name} 1")
            for index in range(DEAR if name.startswith(_DEAR) else CHEAP):
                kind, changed = mutant(text, rng, str(hostile.canary))
                file = tmp_path / "case.toml"
                file.write_text(changed, encoding="utf-8")
                out = tmp_path / "out"
                hostile.run(f"{name} {index} {kind}", "run", file, "--no-figures", "--out", out)
                tried += 1
    hostile.finish(tried)
