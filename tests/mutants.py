"""Do the tests notice? Faults of one operator or number, put in one at a time.

A sample of lines, drawn by a seed from the code that decides results, each with one mutant of
cosmic-ray's. A mutant is noticed if a fast test of what depends on it fails; ``--again`` tries
those that survived with the slow tests too. Each worker has a copy of the checkout: this one stays
as it is.

    python tests/mutants.py --number 200 --seed 0 --out build/mutants.json
    python tests/mutants.py --number 200 --seed 0 --out build/mutants.json --again
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from cosmic_ray.commands import init
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.plugins import operator_names
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec

ROOT = Path(__file__).resolve().parents[1]
# What is mutated, and the tests that shall notice: its own, and those of what is next to it.
WATCHED = {
    "plants": ("plants", "control", "simulation"),
    "control": ("control", "simulation", "assumptions"),
    "simulation": ("simulation", "loop", "control", "cases"),
    "loop": ("loop", "simulation"),
    "machine": ("machine", "physics"),
    "physics": ("physics", "machine", "simulation"),
    "robots": ("robots", "cases"),
    "experiments": ("experiments", "assumptions", "studies", "cli"),
    "assumptions": ("assumptions",),
    "campaign": ("campaign",),
    "cases": ("cases", "studies"),
}
# What else notices, slowly: whole runs, studies, verdicts, films, commands.
_SLOWLY = {
    "plants": ("assumptions",),
    "control": ("studies", "assumptions"),
    "simulation": ("bench", "campaign", "environments"),
    "loop": ("campaign", "environments"),
    "machine": ("robots", "cases"),
    "physics": ("robots", "campaign"),
    "robots": ("assumptions", "environments"),
    "experiments": ("films", "campaign", "environments"),
    "assumptions": ("campaign", "cli"),
    "campaign": ("experiments",),
    "cases": ("chapter",),
}
# The rest either is the same program (`is` for `==` on an enum, another bit operation on a union of
# types, a cache that is not there) or stands for so many others that it would crowd them out.
_KINDS = (
    "ReplaceBinaryOperator_Add_Sub",
    "ReplaceBinaryOperator_Sub_Add",
    "ReplaceBinaryOperator_Mul_Div",
    "ReplaceBinaryOperator_Div_Mul",
    "ReplaceBinaryOperator_Pow_Mul",
    "ReplaceComparisonOperator_Eq_NotEq",
    "ReplaceComparisonOperator_NotEq_Eq",
    "ReplaceComparisonOperator_Lt_LtE",
    "ReplaceComparisonOperator_Lt_Gt",
    "ReplaceComparisonOperator_LtE_Lt",
    "ReplaceComparisonOperator_Gt_GtE",
    "ReplaceComparisonOperator_Gt_Lt",
    "ReplaceComparisonOperator_GtE_Gt",
    "ReplaceComparisonOperator_Is_IsNot",
    "ReplaceComparisonOperator_IsNot_Is",
    "ReplaceUnaryOperator_Delete_USub",
    "ReplaceUnaryOperator_Delete_Not",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak",
    "AddNot",
    "NumberReplacer",
    "ZeroIterationForLoop",
)
_TIMEOUT = 900.0


def main() -> None:
    """Draw, try, report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--number", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=Path("build/mutants.json"))
    parser.add_argument("--again", action="store_true")
    asked = parser.parse_args()
    os.chdir(ROOT)
    drawn = sample(candidates(), asked.number, asked.seed)
    rows: list[dict[str, Any]] = []
    try_one = attempt
    if asked.again:
        known = json.loads(asked.out.read_text())["mutants"]
        rows = [row for row in known if row["outcome"] == "noticed"]
        survived = {row["where"] for row in known if row["outcome"] == "survived"}
        drawn, try_one = [each for each in drawn if _where(each) in survived], attempt_slowly
    with (
        tempfile.TemporaryDirectory(prefix="grosmc_mj_mutants_") as scratch,
        ProcessPoolExecutor(
            asked.workers, get_context("spawn"), initializer=_in_a_copy, initargs=(scratch,)
        ) as pool,
    ):
        for row in pool.map(try_one, drawn):
            rows.append(row)
            asked.out.parent.mkdir(parents=True, exist_ok=True)
            asked.out.write_text(json.dumps({"seed": asked.seed, "mutants": rows}, indent=1))
            print(f"{len(rows)}/{len(drawn)} {row['outcome']}: {row['where']}", file=sys.stderr)
    print(report(rows, asked.seed))


def candidates() -> list[MutationSpec]:
    """Every mutant of the code that is watched, save where it changes no result."""
    files = [file for area in WATCHED for file in sorted((Path("grosmc_mj") / area).rglob("*.py"))]
    kinds = {f"core/{name}" for name in _KINDS}
    assert kinds <= set(operator_names())
    with use_db(":memory:", WorkDB.Mode.create) as database:
        init(files, database, {})
        found = [each for item in database.work_items for each in item.mutations]
    idle = {file: _idle_lines(file) for file in files}
    return [
        each
        for each in found
        if each.operator_name in kinds and each.start_pos[0] not in idle[each.module_path]
    ]


def _idle_lines(file: Path) -> set[int]:
    """Lines of annotations, decorators, errors and arguments of their texts: no result there."""
    tree, lines = ast.parse(file.read_text(encoding="utf-8")), set()
    for node in ast.walk(tree):
        parts: list[ast.AST | None] = []
        if isinstance(node, ast.Raise):
            parts = [node]
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            parts = [*node.decorator_list]
        if isinstance(node, ast.AnnAssign):
            parts.append(node.annotation)
        if isinstance(node, ast.arg):
            parts.append(node.annotation)
        if isinstance(node, ast.FunctionDef):
            parts.append(node.returns)
        for part in filter(None, parts):
            lines.update(range(part.lineno, (part.end_lineno or part.lineno) + 1))  # type: ignore[attr-defined]
    return lines


def sample(found: list[MutationSpec], number: int, seed: int) -> list[MutationSpec]:
    """One mutant on each of so many lines."""
    chance = random.Random(seed)
    by_line: dict[tuple[str, int], list[MutationSpec]] = {}
    for each in found:
        by_line.setdefault((str(each.module_path), each.start_pos[0]), []).append(each)
    lines = chance.sample(sorted(by_line), min(number, len(by_line)))
    return [chance.choice(by_line[line]) for line in lines]


def _in_a_copy(scratch: str) -> None:
    """Make a copy of the checkout for this worker, and go there."""
    place = Path(tempfile.mkdtemp(dir=scratch))
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, check=True,
    ).stdout  # fmt: skip
    for name in filter(None, listed.decode().split("\0")):
        if (ROOT / name).is_file():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, place / name)
    os.chdir(place)
    os.environ["PYTHONPATH"] = str(place)


def _where(mutant: MutationSpec) -> str:
    """File and line."""
    return f"{mutant.module_path}:{mutant.start_pos[0]}"


def attempt_slowly(mutant: MutationSpec) -> dict[str, Any]:
    """The same with slow tests and with those further away."""
    area = mutant.module_path.parts[1]
    return attempt(mutant, "not render", (*WATCHED[area], *_SLOWLY[area]))


def attempt(
    mutant: MutationSpec, which: str = "not slow and not render", folders: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Put a fault in, run the tests, take it out."""
    area = mutant.module_path.parts[1]
    command = f"{sys.executable} -m pytest -q -x -p no:cacheprovider -m '{which}' " + " ".join(
        _tests(mutant.module_path, folders or WATCHED[area])
    )
    line = mutant.module_path.read_text(encoding="utf-8").splitlines()[mutant.start_pos[0] - 1]
    result = mutate_and_test([mutant], command, _TIMEOUT)
    return {
        "area": area,
        "where": _where(mutant),
        "kind": mutant.operator_name.removeprefix("core/"),
        "line": line.strip(),
        "diff": result.diff,
        "outcome": "noticed" if result.is_killed else "survived",
        "said": (result.output or "").strip().splitlines()[-1:],
    }


def _tests(module: Path, folders: tuple[str, ...]) -> Iterator[str]:
    """Tests that shall notice, those named like the module first."""
    words = set(module.stem.split("_"))
    files = [
        file for folder in folders for file in sorted((Path("tests") / folder).rglob("test_*.py"))
    ]
    near = sorted(files, key=lambda file: not words & set(file.stem.split("_")[1:]))
    yield from map(str, near)


def report(rows: list[dict[str, Any]], seed: int) -> str:
    """The score of each area, and what survived."""
    noticed = Counter(row["area"] for row in rows if row["outcome"] == "noticed")
    total = Counter(row["area"] for row in rows)
    lines = [f"{sum(noticed.values())} of {len(rows)} mutants noticed, seed {seed}"]
    lines += [f"  {area}: {noticed[area]} of {total[area]}" for area in WATCHED if total[area]]
    lines += [
        f"survived: {row['where']} {row['kind']}: {row['line']}"
        for row in rows
        if row["outcome"] == "survived"
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
