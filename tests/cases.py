"""Cases of tests, from the values that a test is about: no text of a file where none is meant.

A keyword is a table of the case file, see docs/guide.md::

    case("servo", edit=dict(body="rotor", mass_scale=3), requirement=dict(input_below="10 A"))
    case(
        "arm", law="grosmc", run=dict(duration="1 s"), sensor=[dict(of="joint angle", delay="1 ms")]
    )
    case("servo/machine", controller=dict(law="lqr"))
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import read_content
from grosmc_mj.experiments.file.reading import parse_case_file
from grosmc_mj.experiments.file.shipped import find_file
from grosmc_mj.experiments.file.text import text_of

# Tables that a file has once; there are lists of all others.
SINGLE = ("plant", "run", "task", "computing", "known_loop", "design", "laws", "log")
# The run of a case that is built from nothing.
SHORT = {"duration": "20 ms"}


def content(base: str = "servo", *, law: str = "lqr", **tables: Any) -> dict[str, Any]:
    """Return the values of a case.

    Args:
        base: A system, whose case takes 20 ms under one law; a shipped case; a model's file,
            ``leg.xml``; or the file and the name of a plant in Python, ``plants:block``.
        law: Name of the law, unless there are tables of controllers.
        tables: Tables by their names. Values of a single one stand in place of the base's; a list
            or one table of the other kinds stands in place of all that the base has. Keys above
            the tables, such as ``title``, are plain values.
    """
    if base.endswith(".xml"):
        values = {"plant": {"model": base}, "run": dict(SHORT), "controller": [{"law": law}]}
    elif "/" in base:
        values = read_content(find_file(base))
    else:
        kind = "plant" if ":" in base else "system"
        values = {"plant": {kind: base}, "run": dict(SHORT), "controller": [{"law": law}]}
    for name, table in tables.items():
        if name in SINGLE:
            values[name] = {**values.get(name, {}), **table}
        elif isinstance(table, dict):
            values[name] = [table]
        else:
            values[name] = table
    return values


def text(base: str = "servo", **tables: Any) -> str:
    """Return the text of a case file, see ``content``."""
    return text_of(content(base, **tables))


def write(folder: Path, base: str = "servo", /, *, name: str = "mine", **tables: Any) -> Path:
    """Write a case file for a command, and return its path."""
    path = folder / f"{name}.toml"
    path.write_text(text(base, **tables), encoding="utf-8")
    return path


def case(base: str = "servo", /, *, folder: Path = Path(), **tables: Any) -> Experiment:
    """Return the experiment of a case, whose laws are designed.

    Args:
        base: A system, a shipped case or a plant in Python, see ``content``.
        folder: Folder of the files that it names.
        tables: Tables by their names, see ``content``.
    """
    path = folder / "mine.toml"
    return Experiment.of_file(parse_case_file(text(base, **tables), path), path).checked()
