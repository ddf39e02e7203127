"""Do the tests notice? Faults of one operator or number, put in one at a time.

A sample of lines of the package, drawn by a seed, each with one mutant of cosmic-ray's. The tests
must pass without a fault; a mutant is noticed if a fast test of its module fails. A call works for
some minutes and stores a JSON line a mutant under build/mutants, by the hash of package and tests
and by the seed; the next call goes on where it stopped. Each worker has a copy of the checkout:
this one stays as it is.

    python tools/mutants.py --seed 7 --count 60
    python tools/mutants.py --seed 7 --count 60 --slow    # survivors again, with slow tests too
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import os
import random
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from cosmic_ray.commands import init
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec

ROOT = Path(__file__).resolve().parents[1]
# The rest either is the same program (`is` for `==` on an enum, another bit operation on a union of
# types, a cache that is not there) or stands for so many others that it would crowd them out.
KINDS = re.compile(
    r"core/(ReplaceBinaryOperator_(Add_Sub|Sub_Add|Mul_Div|Div_Mul|Pow_Mul)"
    r"|ReplaceComparisonOperator_(Eq_NotEq|NotEq_Eq|Lt_LtE|Lt_Gt|LtE_Lt|Gt_GtE|Gt_Lt|GtE_Gt)"
    r"|ReplaceComparisonOperator_(Is_IsNot|IsNot_Is)|ReplaceUnaryOperator_Delete_(USub|Not)"
    r"|Replace(AndWithOr|OrWithAnd|TrueWithFalse|FalseWithTrue)"
    r"|Replace(BreakWithContinue|ContinueWithBreak)|AddNot|NumberReplacer|ZeroIterationForLoop)"
)
# The mutants of a call and the last one [s]: together, with the run without a fault before them,
# below ten minutes.
CALL, TIMEOUT = 240.0, 200.0
# Test files that are tried for a mutant: the nearest of those that import its module.
NEAREST = 8


def idle_lines(file: Path) -> set[int]:
    """Lines of annotations, decorators and errors: no result there."""
    lines: set[int] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        parts: list[Any] = [getattr(node, "annotation", None), getattr(node, "returns", None)]
        parts += [
            *getattr(node, "decorator_list", ()),
            node if isinstance(node, ast.Raise) else None,
        ]
        for part in filter(None, parts):
            lines.update(range(part.lineno, (part.end_lineno or part.lineno) + 1))
    return lines


def sample(count: int, seed: int) -> list[MutationSpec]:
    """One mutant on each of so many lines, more in longer files; a seed's first ones stay the same.

    Lines whose mutants change no result are left out.
    """
    files, chance = sorted(Path("grosmc_mj").rglob("*.py")), random.Random(seed)
    files = chance.choices(files, [file.stat().st_size for file in files], k=count)
    with use_db(":memory:", WorkDB.Mode.create) as database:
        init(set(files), database, {})
        mutants = [mutant for item in database.work_items for mutant in item.mutations]
    lines: dict[Path, dict[int, list[MutationSpec]]] = {file: defaultdict(list) for file in files}
    idle = {file: idle_lines(file) for file in lines}
    for mutant in mutants:
        file, line = mutant.module_path, mutant.start_pos[0]
        if KINDS.fullmatch(mutant.operator_name) and line not in idle[file]:
            lines[file][line].append(mutant)
    drawn = []
    for index, file in enumerate(files):
        own = random.Random(f"{seed} {index}")
        if lines[file]:
            drawn.append(own.choice(lines[file].pop(own.choice(sorted(lines[file])))))
    return drawn


def module_of(path: Path) -> str:
    """The dotted name of a module."""
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


@cache
def imported(file: Path) -> set[str]:
    """All that a file imports, also inside functions, and the names taken from a module."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def tests_of(module: Path) -> list[str]:
    """Test files that depend on a module: those of its own folder first, then the nearest."""
    package = {module_of(file): imported(file) for file in Path("grosmc_mj").rglob("*.py")}
    near: dict[str, int] = {}
    edge = {module_of(module)}
    while edge:
        near |= dict.fromkeys(edge, len(near))
        edge = {user for user, names in package.items() if names & edge} - near.keys()
    own, words = set(module.parts[1:-1]), set(module.stem.split("_"))
    ranked = [
        (not own & set(file.parts), not words & set(file.stem.split("_")), min(steps), str(file))
        for file in sorted(Path("tests").rglob("test_*.py"))
        if (steps := [near[name] for name in imported(file) & near.keys()])
    ]
    return [file for *_, file in sorted(ranked)][:NEAREST]


def in_a_copy(scratch: str) -> None:
    """Make a copy of the checkout for this worker, and go there."""
    place = Path(tempfile.mkdtemp(dir=scratch))
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    ).stdout
    for name in filter(None, listed.decode().split("\0")):
        if (ROOT / name).is_file():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, place / name)
    os.chdir(place)
    os.environ["PYTHONPATH"] = str(place)


def pytest_command(tests: list[str], slow: bool) -> list[str]:
    """The command that runs these test files up to the first failure."""
    which = "not render and not apart" + ("" if slow else " and not slow")
    options = ["-q", "-x", "-p", "no:cacheprovider", "-m"]
    return [sys.executable, "-m", "pytest", *options, which, *tests]


def passes_without_a_fault(mutants: list[MutationSpec], workers: int) -> bool:
    """Whether the fast tests of all mutants pass as the package is."""
    tests = sorted({test for mutant in mutants for test in tests_of(mutant.module_path)})
    return not subprocess.run([*pytest_command(tests, slow=False), "-n", str(workers)]).returncode


def attempt(mutant: MutationSpec, end: float, slow: bool) -> dict[str, Any] | None:
    """Put a fault in, run the tests, take it out; None where no time is left."""
    if time.time() > end:
        return None
    tests = tests_of(mutant.module_path)
    result = mutate_and_test([mutant], shlex.join(pytest_command(tests, slow)), TIMEOUT)
    # Where no test was left to run, or none could be collected, nothing was noticed.
    found = re.search(r"\d+ (failed|error)", result.output or "")
    ended = "noticed" if result.is_killed and found else "survived"
    return {
        "where": where(mutant),
        "kind": mutant.operator_name.removeprefix("core/"),
        "outcome": "timeout" if result.output == "timeout" else ended if tests else "untested",
        "slow": slow,
        "diff": result.diff,
        "last": (result.output or "").strip().splitlines()[-1:],
    }


def where(mutant: MutationSpec) -> str:
    """File and line."""
    return f"{mutant.module_path}:{mutant.start_pos[0]}"


def report(rows: list[dict[str, Any]], count: int) -> str:
    """The score of each folder, and what was not noticed."""
    total = Counter(row["where"].split("/")[1] for row in rows)
    noticed = Counter(row["where"].split("/")[1] for row in rows if row["outcome"] == "noticed")
    lines = [f"{sum(noticed.values())} of {len(rows)} mutants noticed"]
    lines += [f"  {folder}: {noticed[folder]} of {total[folder]}" for folder in sorted(total)]
    missed = [row for row in rows if row["outcome"] != "noticed"]
    lines += [f"{row['outcome']}: {row['where']} {row['kind']}" for row in missed]
    if len(rows) < count:
        lines.append(f"{count - len(rows)} are left: call it again")
    return "\n".join(lines)


def main() -> None:
    """Draw, try as many as there is time for, report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--slow", action="store_true")
    options = parser.parse_args()
    os.chdir(ROOT)
    drawn = sample(options.count, options.seed)
    files = [file for top in ("grosmc_mj", "tests") for file in sorted(Path(top).rglob("*.py"))]
    tree = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]
    store = Path(f"build/mutants/{tree}_{options.seed}.jsonl")
    if not store.exists():
        if not passes_without_a_fault(drawn, options.workers):
            sys.exit("tests fail without a fault: mend them first")
        store.parent.mkdir(parents=True, exist_ok=True)
        store.touch()
    rows = {row["where"]: row for row in map(json.loads, store.read_text().splitlines())}
    tried = {name for name, row in rows.items() if row["slow"] or row["outcome"] == "noticed"}
    waiting = [m for m in drawn if where(m) not in (tried if options.slow else rows)]
    context, end = get_context("spawn"), time.time() + CALL
    with (
        tempfile.TemporaryDirectory(prefix="grosmc_mj_mutants_") as scratch,
        ProcessPoolExecutor(options.workers, context, in_a_copy, (scratch,)) as pool,
        store.open("a", encoding="utf-8") as lines,
    ):
        for row in filter(None, pool.map(partial(attempt, end=end, slow=options.slow), waiting)):
            rows[row["where"]] = row
            lines.write(json.dumps(row) + "\n")
            lines.flush()
    sys.stdout.write(report([rows[n] for n in map(where, drawn) if n in rows], len(drawn)) + "\n")


if __name__ == "__main__":
    main()
