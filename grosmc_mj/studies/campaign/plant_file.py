"""Case file of one plant of a campaign, which run, film and diff take like any other."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grosmc_mj.experiments.file.content import Content, read_content
from grosmc_mj.experiments.file.parts import LOOP_PARTS, keep_known_motors
from grosmc_mj.experiments.file.text import text_of
from grosmc_mj.experiments.number import written
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, SetupError
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.folder import Folder
from grosmc_mj.studies.campaign.radius import RADIUS
from grosmc_mj.studies.campaign.screening import EQUATIONS
from grosmc_mj.studies.campaign.specification import Specification
from grosmc_mj.studies.campaign.worst import WORST

# Plants that a search has found: the file that has their numbers, and the option that searches.
SEARCHED = {
    "worst": (WORST, "--worst"),
    "shrunk": (WORST, "--worst"),
    "outside": (RADIUS, "--radius"),
}
# Digits of a run's number: more than any campaign has.
_MOST_DIGITS = 18


@dataclass(frozen=True, eq=False)
class ChosenPlant:
    """One plant of a campaign.

    Attributes:
        which: Number of its run, or ``worst``, ``shrunk`` or ``outside``.
        law: The law that ran on it.
        values: Its uncertain numbers, (d,).
        run: Number of the run that the loop draws for.
        kind: ``physics``, or ``corrected`` if the equations judged it.
    """

    which: str
    law: str
    values: Array
    run: int
    kind: PlantName

    @property
    def words(self) -> str:
        """The plant as a title names it."""
        if self.which in SEARCHED:
            return f"{self.which} plant under {self.law}"
        return f"run {self.which} under {self.law}"

    def file_name(self, campaign: str) -> str:
        """Return a name that leads nowhere else, whatever the law is called.

        Args:
            campaign: Name of the campaign.
        """
        law = re.sub(r"[^\w.+-]+", "_", self.law)
        return f"{campaign}_{self.which}_{law}.toml"


def find_plant(
    campaign: Campaign, folder: Folder, which: str, law: str | None = None
) -> ChosenPlant:
    """Find a plant of a campaign.

    Args:
        campaign: The campaign.
        folder: Its folder.
        which: Number of a run, or ``worst``, ``shrunk`` or ``outside``.
        law: The law that ran on it; the campaign's last one by default.

    Raises:
        GrosmcError: If there is no such run, plant or law.
    """
    if law is None:
        law = list(campaign.laws)[-1]
    require_known("law", law, campaign.laws)
    if which in SEARCHED:
        values, run = searched_plant(campaign, folder.path, which, law)
        return ChosenPlant(which, law, values, run, _kind_of(campaign))

    runs = campaign.specification.runs
    if not (which.isdecimal() and len(which) <= _MOST_DIGITS and int(which) < runs):
        raise ArgumentError(f"run {which!r}: there are 0 to {runs - 1}, {', '.join(SEARCHED)}")
    number = int(which)
    (values,) = campaign.values(range(number, number + 1))
    kind: PlantName = _kind_of(campaign)
    if kind == "physics" and _judged_by_equations(campaign, folder, number, law):
        kind = "corrected"
    return ChosenPlant(f"{number}", law, values, number, kind)


def searched_plant(
    campaign: Campaign,
    folder: Path,
    which: str,
    law: str,
) -> tuple[Array, int]:
    """Read the uncertain numbers of a plant that a search has found, (d,), and its run's number.

    Args:
        campaign: The campaign.
        folder: Its folder.
        which: ``worst``, ``shrunk`` or ``outside``.
        law: The law that it was found for.

    Raises:
        SetupError: If there is no such plant.
    """
    name, option = SEARCHED[which]
    path = folder / name
    if not path.is_file():
        raise SetupError(f"{folder} has no {name}: run the campaign with {option}")
    unreadable = f"{path} cannot be read: run the campaign with {option} again"
    try:
        found = json.loads(path.read_text(encoding="utf-8"))["controllers"][law]
        plant = found[which]
        if plant is None:
            raise SetupError(f"{path}: no plant was found that fails under {law}")
        values = np.array([float(plant[name]) for name in campaign.family.names])
        run = int(found.get(f"{which}_run", 0))
    except (OSError, ValueError, LookupError, TypeError, RecursionError, OverflowError):
        raise SetupError(unreadable) from None
    if not np.all(np.isfinite(values)) or not 0 <= run < 10**_MOST_DIGITS:
        raise SetupError(unreadable)
    return values, run


def _kind_of(campaign: Campaign) -> PlantName:
    """The plant of runs that nothing screens."""
    return "physics" if campaign.plant.kind == "physics" else "corrected"


def _judged_by_equations(
    campaign: Campaign,
    folder: Folder,
    number: int,
    law: str,
) -> bool:
    """Whether the equations judged a run; False if its part is not there."""
    if campaign.specification.screen == "none":
        return False
    part, row = divmod(number, campaign.specification.shard)
    columns = folder.columns(campaign, ["judged_by"], [part])
    return bool(columns) and columns[law]["judged_by"][row] == EQUATIONS


def case_text(campaign: Campaign, plant: ChosenPlant, base: Path | None = None) -> str:
    """Return the case file of a plant.

    Args:
        campaign: The campaign.
        plant: One of its plants.
        base: Case file of the campaign, beside which the new one will lie and which it extends.
            Without it the new file is complete.

    Raises:
        ArgumentError: If the case file names a model beside it, and is not given.
    """
    specification = campaign.specification
    model = specification.file.plant.model
    if base is None and model is not None and ":" not in model:
        raise ArgumentError(
            f"the case file of {specification.name} names {model}, which lies beside it: give "
            "that case file by --case-file"
        )

    content = _content(campaign, plant)
    if base is not None:
        changes = _changes(content, read_content(base))
        content = {"extends": base.name, **changes}
    return _comment(campaign, plant) + text_of(content)


def _comment(campaign: Campaign, plant: ChosenPlant) -> str:
    """The lines that a case file begins with: the plant and its uncertain numbers, as run."""
    specification = campaign.specification
    judge = "MuJoCo" if plant.kind == "physics" else "the equations"
    lines = [
        f"Campaign {specification.name}, seed {specification.seed}: {plant.words}, judged by "
        f"{judge}."
    ]
    for quantity, value, nominal in campaign.pairs_as_run(plant.values):
        number = f"{quantity.name} = {value!r} {quantity.unit}".rstrip()
        lines.append(f"{number} (nominal {nominal!r})")
    loop = campaign.experiment.loop
    if loop is not None and loop.drawn:
        lines.append(
            "The campaign made one run of it, that of --draws 1; run alone judges it by the worst "
            "of several draws of its loop."
        )
    return "".join(f"# {line}\n" for line in lines)


def _content(campaign: Campaign, plant: ChosenPlant) -> Content:
    """The content of a complete case file."""
    experiment = campaign.experiment
    content: Content = tomllib.loads(campaign.specification.text)
    for key in ("name", "uncertain", "correlation"):
        content.pop(key, None)
    content["title"] = f"{experiment.title}: {plant.words}"
    _run_on(content, plant.kind)
    _run_as(content, campaign.specification)

    pairs = campaign.pairs_as_run(plant.values)
    uncertain_loop = any(quantity.number.of_loop for quantity, *_ in pairs)
    if uncertain_loop and any(map(experiment.knows_loop, campaign.laws)):
        _keep_known_loop(content)
    if any(quantity.owner == "motor" for quantity, *_ in pairs):
        keep_known_motors(content)
    for quantity, value, _ in pairs:
        quantity.number.write(content, value)
    if experiment.loop is not None:
        content.setdefault("computing", {})["run"] = plant.run
    return content


def _run_on(content: Content, kind: PlantName) -> None:
    """Have the file run on one kind of plant, where everything is required."""
    content["plant"]["compare"] = [kind]
    for key in ("requirement", "claim"):
        for table in content.get(key, []):
            if "on" in table:
                table["on"] = [kind]


def _run_as(content: Content, specification: Specification) -> None:
    """Have the file run as long, as often sampled, by the integrator and laws of a campaign."""
    run = content["run"]
    for name in ("control_period", "duration"):
        seconds = getattr(specification, name)
        if seconds is not None:
            run[name] = written(seconds, "s")
    if specification.integrator is not None:
        run["integrator"] = specification.integrator

    declared = [table.called for table in specification.file.controller]
    for law in specification.controllers:
        if law not in declared:
            content.setdefault("controller", []).append({"law": law})


def _keep_known_loop(content: Content) -> None:
    """Have laws that know their loop know it as it is now, whatever numbers it gets."""
    if "known_loop" not in content:
        parts = {kind: content[kind] for kind in LOOP_PARTS if kind in content}
        content["known_loop"] = deepcopy(parts)


def _changes(content: Mapping[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
    """The content that a base does not have; arrays that only the base has become empty."""
    changes: dict[str, Any] = {}
    for key, value in base.items():
        if key not in content and isinstance(value, list):
            changes[key] = []
    for key, value in content.items():
        old = base.get(key)
        if isinstance(value, dict) and isinstance(old, dict):
            inner = _changes(value, old)
            if inner:
                changes[key] = inner
        elif value != old or key not in base:
            changes[key] = value
    return changes
