"""Damaged and forged campaign folders: one line, or what the undamaged folder says."""

from __future__ import annotations

import json
import os
import random
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from campaign_cases import pair
from mutation import TEXTS, code
from trial import LINE, TIMES, Trial, trial

from grosmc_mj import cli

pytestmark = [pytest.mark.slow, pytest.mark.apart]

_RUNS, _SHARD = 12, 3
# Of each damage.
_TRIED = 3 * TIMES
# Values where a manifest has others, as JSON writes them.
_ODD: tuple[Any, ...] = (
    None, True, 0, -1, 10**30, 1e308, "", "..", "canary:law", "/etc", "a\0b", "\x1b[31m", [], {},
    [[[]]], {"a": 1}, *TEXTS[:6],
)  # fmt: skip


Damage = Callable[[Path, random.Random, str], object]


def command(file: Path, folder: Path, seed: int = 5) -> list[Any]:
    """The campaign's command line."""
    sizes = ("--runs", _RUNS, "--shard", _SHARD, "--seed", seed, "--no-figures")
    return ["campaign", file, *sizes, "--screen", "equations", "--out", folder]


def part(folder: Path, rng: random.Random) -> Path:
    """One of the parts."""
    return rng.choice(sorted((folder / "parts").glob("*.parquet")))


def manifest_or_part(folder: Path, rng: random.Random) -> Path:
    return rng.choice((folder / "manifest.json", part(folder, rng)))


def leaves(value: Any) -> Iterator[tuple[Any, Any]]:
    """Where the values of nested tables are."""
    for key, item in value.items() if isinstance(value, dict) else enumerate(value):
        yield value, key
        if isinstance(item, (dict, list)):
            yield from leaves(item)


def leaf(content: Any, rng: random.Random, canary: str) -> None:
    """Another value somewhere in the manifest."""
    table, key = rng.choice(list(leaves(content)))
    value = rng.choice(_ODD)
    table[key] = value.replace("CANARY", code(canary)) if isinstance(value, str) else value


def text_of_the_question(content: Any, rng: random.Random, canary: str) -> None:
    """A case file that would execute something."""
    text = content["question"]["text"]
    task = f"[task]\nreference = ['''sin(\"{code(canary)}\")''']\n"
    law = text.replace('law = "lqr"', 'law = "canary:law"', 1)
    content["question"]["text"] = rng.choice((law, text + task))


def in_manifest(change: Callable[[Any, random.Random, str], None]) -> Damage:
    """A manifest with other values."""

    def rewrite(folder: Path, rng: random.Random, canary: str) -> None:
        path = folder / "manifest.json"
        content = json.loads(path.read_text())
        change(content, rng, canary)
        path.write_text(json.dumps(content))

    return rewrite


def in_part(change: Callable[[pa.Table, random.Random], pa.Table]) -> Damage:
    """A part with other rows or columns, and all that it says of itself."""

    def rewrite(folder: Path, rng: random.Random, _: str) -> None:
        path = part(folder, rng)
        table = pq.read_table(path)
        pq.write_table(change(table, rng).replace_schema_metadata(table.schema.metadata), path)

    return rewrite


def cut(folder: Path, rng: random.Random, _: str) -> None:
    """A file that ends too early."""
    path = manifest_or_part(folder, rng)
    path.write_bytes(path.read_bytes()[: rng.randrange(path.stat().st_size)])


def flipped(folder: Path, rng: random.Random, _: str) -> None:
    """A bit that is another."""
    path = part(folder, rng)
    content = bytearray(path.read_bytes())
    content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    path.write_bytes(content)


def noise(folder: Path, rng: random.Random, _: str) -> None:
    """A file of something else."""
    others = (b"", b"\0" * 99, rng.randbytes(500), b"[" * 3000, b"{}", b"1", b"nan")
    manifest_or_part(folder, rng).write_bytes(rng.choice(others))


def swapped(folder: Path, rng: random.Random, _: str) -> None:
    """Two parts in each other's place."""
    first, second = rng.sample(sorted((folder / "parts").glob("*.parquet")), 2)
    content = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(content)


def of_another_seed(folder: Path, rng: random.Random, _: str) -> None:
    """A part of the same campaign with other numbers."""
    mine = part(folder, rng)
    shutil.copy(folder.with_name("other") / "parts" / mine.name, mine)


def permuted(table: pa.Table, rng: random.Random) -> pa.Table:
    order = list(range(table.num_rows))
    while order == sorted(order):
        rng.shuffle(order)
    return table.take(order)


def better(table: pa.Table, _: random.Random) -> pa.Table:
    """Every margin as if it were kept."""
    index = table.column_names.index("relative")
    return table.set_column(index, table.field(index), pa.array([1.0] * table.num_rows))


def link(folder: Path, rng: random.Random, _: str) -> None:
    """A link in place of a file that is written."""
    elsewhere = folder.with_name("elsewhere")
    elsewhere.write_text("somebody's")
    target = rng.choice((folder / "results.json", part(folder, rng)))
    target.unlink()
    target.symlink_to(rng.choice((elsewhere, Path("/dev/zero"), folder / "nowhere")))


def in_the_way(folder: Path, rng: random.Random, _: str) -> None:
    """A folder or a pipe in place of a file."""
    target = rng.choice((folder / "manifest.json", part(folder, rng), folder / ".lock"))
    target.unlink()
    rng.choice((Path.mkdir, os.mkfifo))(target)


DAMAGES: dict[str, Damage] = {
    "leaf": in_manifest(leaf),
    "text": in_manifest(text_of_the_question),
    "cut": cut,
    "flipped": flipped,
    "noise": noise,
    "swapped": swapped,
    "other seed": of_another_seed,
    "permuted": in_part(permuted),
    "column": in_part(lambda table, rng: table.drop_columns([rng.choice(table.column_names)])),
    "better": in_part(better),
    "missing": lambda folder, rng, _: rng.choice(
        (manifest_or_part(folder, rng), folder / "results.json")
    ).unlink(),
    "link": link,
    "in the way": in_the_way,
}
# What must be noticed wherever it is, by whoever adds parts.
_ALWAYS_NOTICED = ("swapped", "other seed", "permuted", "column", "better")


def attempt(
    hostile: Trial, what: str, arguments: list[Any], truth: dict[str, Any], out: Path
) -> str:
    """Run a command on a damaged folder; what it says must be one line, or true."""
    elsewhere = out.with_name("elsewhere")
    end = hostile.run(what, *arguments)
    if elsewhere.exists():
        hostile.expect(what, elsewhere.read_text() == "somebody's", "a link was followed")
    results = out / "results.json"
    # A replay leaves a link where it is.
    written = results.is_file() and not results.is_symlink()
    if end != LINE and arguments[0] == "campaign" and written:
        found = {**json.loads(results.read_text()), "command": truth["command"]}
        hostile.expect(what, found == truth, "other results")
    return end


def test_damaged_campaign_folders(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    rng, file, whole = random.Random(3), tmp_path / "small.toml", tmp_path / "whole"
    file.write_text(pair())
    with trial(capfd, tmp_path) as hostile:
        for folder, seed in ((whole, 5), (tmp_path / "other", 6)):
            with pytest.raises(SystemExit) as stop:
                cli.main([str(word) for word in command(file, folder, seed)])
            assert stop.value.code == cli.DONE
        truth = json.loads((whole / "results.json").read_text())
        tried = 0
        for index in range(_TRIED * len(DAMAGES)):
            kind = list(DAMAGES)[index % len(DAMAGES)]
            damaged = tmp_path / "damaged"
            shutil.copytree(whole, damaged)
            DAMAGES[kind](damaged, rng, str(hostile.canary))
            (damaged / "results.json").unlink(missing_ok=True) if rng.random() < 0.5 else None
            resumed = [*command(file, damaged), "--resume"]
            replayed = ["campaign", damaged, "--replay", rng.randrange(_RUNS), "--no-figures"]
            for arguments in (replayed, resumed):
                what = f"{kind} {index} {arguments[0]}"
                end = attempt(hostile, what, arguments, truth, damaged)
                tried += 1
                if kind in _ALWAYS_NOTICED and arguments is resumed:
                    hostile.expect(what, end == LINE, "it was not noticed")
            shutil.rmtree(damaged)
    hostile.finish(tried)
