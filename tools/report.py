"""Summary of the stored results of ``make test``: a line a part; exit code 1 if one is missing.

Each run stores its results in build/tests: those of all folders, of one (``PART=tests/control``),
of the tests that run apart, or of the portable ones. The newest result of a part counts, unless the
code is newer. A run that was interrupted stores none.
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
FAILURES = ("failure", "error")


def part_of(name: str) -> str:
    """Return the part of a folder of tests, or of a file at their top."""
    if not name or name.startswith("test_"):
        return TOP
    return name


def parts() -> list[str]:
    """Return all parts that must have passed."""
    tests = ROOT / "tests"
    names = {part_of(file.relative_to(tests).parts[0]) for file in tests.rglob("test_*.py")}
    names.update(RUNS)
    # All tests of this folder run apart.
    names.discard("hostile")
    return sorted(names)


def changed() -> float:
    """Return the time of the last change of the code or of a test."""
    times = []
    for top in ("grosmc_mj", "measured", "models", "tests"):
        files = [path for path in (ROOT / top).rglob("*") if path.is_file()]
        times += [path.stat().st_mtime for path in files if path.parent.name != "__pycache__"]
    return max(times)


def results(folder: Path, since: float) -> dict[str, Counter[str]]:
    """Return the newest result of each part: how many tests passed, were skipped or failed."""
    newest: dict[str, Counter[str]] = {}
    for file in sorted(folder.glob("*.xml"), key=lambda file: file.stat().st_mtime):
        if file.stat().st_mtime >= since:
            newest.update(results_of(file))
    return newest


def results_of(file: Path) -> dict[str, Counter[str]]:
    """Return the results of each part in a file."""
    ends: dict[str, Counter[str]] = {}
    for case in ElementTree.parse(file).iter("testcase"):
        part = file.stem
        if part not in RUNS:
            # Such as tests.control.test_lqr.
            part = part_of(f"{case.get('classname')}.".split(".")[1])
        ends.setdefault(part, Counter())[end_of(case)] += 1
    return ends


def end_of(case: ElementTree.Element) -> str:
    """Return the end of a test, which its first child with such a name has."""
    for child in case:
        if child.tag in (*FAILURES, "skipped"):
            return child.tag
    return "passed"


def report(newest: dict[str, Counter[str]], required: list[str]) -> tuple[str, bool]:
    """Return a line for each part, and True if all passed."""
    lines = []
    failed = 0
    for part in required:
        ends = newest.get(part, Counter())
        counts = ", ".join(f"{count} {end}" for end, count in sorted(ends.items()))
        verdict = "ok"
        if not ends or any(ends[end] for end in FAILURES):
            verdict = "FAILED"
            failed += 1
        lines.append(f"{verdict:6}  {part:14}  {counts or 'missing'}")

    if failed:
        lines.append(f"{failed} of {len(required)} parts failed or are missing")
    else:
        lines.append("All passed")
    return "\n".join(lines), not failed


if __name__ == "__main__":
    text, passed = report(results(ROOT / "build/tests", changed()), parts())
    sys.stdout.write(f"{text}\n")
    sys.exit(not passed)
