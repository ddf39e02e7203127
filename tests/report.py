"""Put the stored results of ``make test`` together: a line a part; exit code 1 if one is missing.

Each run stores its results in build/tests: of all folders, of one (``PART=tests/control``), of the
tests that run apart, or of the portable ones. Of a part its newest result counts, unless the code
is newer. A run that was interrupted stores none.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
TOP = "top level"
# Runs that are a part as a whole, whatever folders their tests come from.
RUNS = ("apart", "portable")


def part_of(name: str) -> str:
    """A folder of tests, or the files that lie in none."""
    return TOP if name.startswith("test_") or not name else name


def parts() -> list[str]:
    """All that must have passed; of the folder ``hostile`` everything runs apart."""
    files = (file.relative_to(ROOT / "tests") for file in (ROOT / "tests").rglob("test_*.py"))
    return sorted({part_of(file.parts[0]) for file in files} - {"hostile"} | {*RUNS})


def changed() -> float:
    """When the code or a test was changed last."""
    files = [f for top in ("grosmc_mj", "models", "tests") for f in (ROOT / top).rglob("*")]
    return max(f.stat().st_mtime for f in files if f.is_file() and f.parent.name != "__pycache__")


def results(folder: Path, since: float) -> dict[str, Counter[str]]:
    """How many tests of each part passed, were skipped or failed, by its newest result."""
    newest: dict[str, Counter[str]] = {}
    for file in sorted(folder.glob("*.xml"), key=lambda file: file.stat().st_mtime):
        if file.stat().st_mtime < since:
            continue
        ends: dict[str, Counter[str]] = {}
        for case in ElementTree.parse(file).iter("testcase"):
            part = part_of(f"{case.get('classname')}.".split(".")[1])
            end = next((x.tag for x in case if x.tag in ("failure", "error", "skipped")), "passed")
            ends.setdefault(file.stem if file.stem in RUNS else part, Counter())[end] += 1
        newest |= ends
    return newest


def report(found: dict[str, Counter[str]], needed: list[str]) -> tuple[str, bool]:
    """A line a part, and whether all passed."""
    lines, bad = [], 0
    for part in needed:
        ends = found.get(part, Counter())
        wrong = not ends or ends["failure"] + ends["error"] > 0
        counts = ", ".join(f"{count} {end}" for end, count in sorted(ends.items())) or "missing"
        lines.append(f"{'FAILED' if wrong else 'ok':6}  {part:14}  {counts}")
        bad += wrong
    lines.append(f"{bad} of {len(needed)} parts failed or are missing" if bad else "All passed")
    return "\n".join(lines), not bad


if __name__ == "__main__":
    text, passed = report(results(ROOT / "build/tests", changed()), parts())
    sys.stdout.write(f"{text}\n")
    sys.exit(not passed)
