"""Damaged and forged campaign folders: one line, or the results of the undamaged folder."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from campaign_cases import pair
from commands import run
from hostile import LINE, TEXTS, TIMES, code, trial

from grosmc_mj import cli

pytestmark = [pytest.mark.slow, pytest.mark.apart]

_RUNS, _SHARD = 12, 3
# Of every damage.
_TRIED = 2 * TIMES
# Values in place of those of a manifest, as JSON writes them.
_ODD: tuple[Any, ...] = (
    None, True, 0, -1, 10**30, 1e308, "", "..", "canary:law", "/etc", "a\0b", "\x1b[31m", [], {},
    [[[]]], {"a": 1}, *TEXTS[:6],
)  # fmt: skip


def command(file: Path, folder: Path) -> list[Any]:
    """The campaign's command line."""
    sizes = ("--runs", _RUNS, "--shard", _SHARD, "--seed", 5, "--no-figures")
    return ["campaign", file, *sizes, "--screen", "equations", "--out", folder]


def part(folder: Path, rng: random.Random) -> Path:
    return rng.choice(sorted((folder / "parts").glob("*.parquet")))


def manifest_or_part(folder: Path, rng: random.Random) -> Path:
    return rng.choice((folder / "manifest.json", part(folder, rng)))


def leaves(value: Any) -> Iterator[tuple[Any, Any]]:
    """Where the values of nested tables are."""
    for key, item in value.items() if isinstance(value, dict) else enumerate(value):
        yield value, key
        if isinstance(item, (dict, list)):
            yield from leaves(item)


def leaf(folder: Path, rng: random.Random, canary: str) -> None:
    """Another value somewhere in the manifest, or a case file that would execute something."""
    path = folder / "manifest.json"
    content = json.loads(path.read_text())
    if rng.random() < 0.3:
        text = content["question"]["text"]
        task = f"[task]\nreference = ['''sin(\"{code(canary)}\")''']\n"
        law = text.replace('law = "lqr"', 'law = "canary:law"', 1)
        content["question"]["text"] = rng.choice((law, text + task))
    else:
        table, key = rng.choice(list(leaves(content)))
        value = rng.choice(_ODD)
        table[key] = value.replace("CANARY", code(canary)) if isinstance(value, str) else value
    path.write_text(json.dumps(content))


def cut(folder: Path, rng: random.Random, _: str) -> None:
    """A file that ends too early, is another, or has a bit that is another."""
    path = manifest_or_part(folder, rng)
    content = bytearray(path.read_bytes())
    changes = [
        content[: rng.randrange(len(content))],
        rng.choice((b"", b"\0" * 99, rng.randbytes(500), b"[" * 3000, b"{}", b"1", b"nan")),
    ]
    if path.suffix == ".parquet":
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        changes.append(content)
    path.write_bytes(rng.choice(changes))


def missing(folder: Path, rng: random.Random, _: str) -> None:
    rng.choice((manifest_or_part(folder, rng), folder / "results.json")).unlink()


def swapped(folder: Path, rng: random.Random, _: str) -> None:
    """Two parts in each other's place."""
    first, second = rng.sample(sorted((folder / "parts").glob("*.parquet")), 2)
    content = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(content)


DAMAGES: dict[str, Callable[[Path, random.Random, str], None]] = {
    "leaf": leaf, "cut": cut, "missing": missing, "swapped": swapped,
}  # fmt: skip


def test_damaged_campaign_folders(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    rng, file = random.Random(3), tmp_path / "small.toml"
    file.write_text(pair())
    assert run(*command(file, tmp_path / "intact")) == cli.DONE
    truth = json.loads((tmp_path / "intact/results.json").read_text())
    damaged, results = tmp_path / "damaged", tmp_path / "damaged" / "results.json"
    with trial(capfd, tmp_path, 2 * _TRIED * len(DAMAGES)) as hostile:
        for index in range(_TRIED * len(DAMAGES)):
            kind = list(DAMAGES)[index % len(DAMAGES)]
            shutil.copytree(tmp_path / "intact", damaged)
            DAMAGES[kind](damaged, rng, str(hostile.canary))
            if rng.random() < 0.5:
                results.unlink(missing_ok=True)
            for arguments in (
                ["campaign", damaged, "--replay", rng.randrange(_RUNS), "--no-figures"],
                [*command(file, damaged), "--resume"],
            ):
                name = f"{kind} {index} {arguments[-1]}"
                end = hostile.run(name, *arguments)
                if end != LINE and results.is_file():
                    written = {**json.loads(results.read_text()), "command": truth["command"]}
                    hostile.expect(f"{name}: other results", holds=written == truth)
                if kind == "swapped" and "--resume" in arguments:
                    hostile.expect(f"{name}: it was not noticed", holds=end == LINE)
            shutil.rmtree(damaged)
