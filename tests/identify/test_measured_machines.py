"""The page on measured machines, followed on the logs of those machines.

Errors by horizon are those of the page within the tolerance of ``shown_output``, 10 %.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from commands import Patch, Screen
from shown_output import follow

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "measured_machines.md"


def section(heading: str) -> str:
    """Text of the page under a heading."""
    page = PAGE.read_text(encoding="utf-8")
    (text,) = re.findall(rf"^## {heading}\n(.*?)^## ", page, re.DOTALL | re.MULTILINE)
    return text


# The fit of eleven parameters takes longer than those of four and five.
LONGER = pytest.param("A double pendulum", "double_pendulum", marks=pytest.mark.apart)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("heading", "folder"),
    [
        ("A swing-up of a real pendulum", "pendulum"),
        LONGER,
        ("A DC servo", "dc_servo"),
        ("A cart-pole", "cart_pole"),
    ],
)
def test_a_machine_is_predicted_as_well_as_the_page_says(
    heading: str, folder: str, tmp_path: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    shutil.copytree(ROOT / "measured" / folder, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    follow(section(heading), heading, capsys)
