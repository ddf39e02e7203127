"""The chapter's claims: a file of data a system, each claim with the measurement that it names."""

from __future__ import annotations

import inspect
import itertools
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

from grosmc_mj.arguments import require_known
from grosmc_mj.chapter.claims.claim import WORDS, Choice, Claim, Kind, Measured, NoValueError
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.plants import SYSTEMS


@dataclass(frozen=True)
class Measurement:
    """A measurement with the arguments of its claim.

    Attributes:
        function: Of a laboratory and a plant.
        arguments: Its further arguments. ``epsilon`` is the arm's gain instead of the case files'.
        take: The extreme over all combinations of the arguments that are lists; empty for none.
        extrapolated: Whether the value is extrapolated to a sampling time of zero.
    """

    function: Callable[..., Measured]
    arguments: Mapping[str, Any]
    take: Literal["", "largest", "least"] = ""
    extrapolated: bool = False

    def __call__(self, lab: Laboratory, plant: PlantName, **changed: Any) -> Measured:
        """The value on a plant; broken where a run that it rests on is."""
        arguments, points = {**self.arguments, **changed}, list[Measured]()
        if "epsilon" in arguments:
            lab = lab.varied("laws.grosmc.epsilon", arguments.pop("epsilon"))
        lists = [name for name in arguments if self.take and isinstance(arguments[name], list)]
        for values in itertools.product(*(arguments[name] for name in lists)):
            try:
                point = self._at(lab, plant, arguments | dict(zip(lists, values, strict=True)))
            except NoValueError as error:
                return Measured(None, str(error), broken=True)
            if not self.take:
                return point
            where, note = " ".join(map(str, values)), f" ({point.note})" if point.note else ""
            if point.value is None or point.broken:
                return point._replace(note=f"{where}: {point.note}")
            points.append(Measured(point.value, f"{where} {point.value:.3g}{note}"))
        pick = max if self.take == "largest" else min
        extreme = pick(points, key=lambda point: point.value or 0.0)
        return extreme._replace(note="; ".join(point.note for point in points))

    def _at(self, lab: Laboratory, plant: PlantName, arguments: Mapping[str, Any]) -> Measured:
        """The value at T, or 2 v(T/2) - v(T): what is left of an error that is linear in T."""
        first = self.function(lab, plant, **arguments)
        if not self.extrapolated or first.value is None or first.broken:
            return first
        second = self.function(lab.refined, plant, **arguments)
        if second.value is None or second.broken:
            return second
        note = f"{first.value:.3g} at T, {second.value:.3g} at T/2"
        return Measured(abs(2 * second.value - first.value), note)


def read_claims(path: Path) -> list[Claim]:
    """The claims of a system's file, in its order; the file has the system's name."""
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    causes = content.pop("causes", {})
    choices = {key: Choice(**value) for key, value in content.pop("choices", {}).items()}
    claims = []
    for name, table in content.items():
        values = {**WORDS.get(table.get("word", ""), {}), **table, "id": name, "system": path.stem}
        values["choices"] = [choices[key] for key in table.get("choices", ())]
        for quantified in ("every", "some"):
            values[quantified] = [choices[key].name for key in table.get(quantified, ())]
        values["kind"] = Kind[table.get("kind", "claim").upper()]
        values["cause"] = causes[table["cause"]] if "cause" in table else ""
        take, extrapolated = (table["measure"].pop(key, "") for key in ("take", "extrapolated"))
        function, arguments = _function(table["measure"], path.stem)
        values["measure"] = Measurement(function, arguments, take, bool(extrapolated))
        if "premise" in table:
            function, arguments = _function(table["premise"], path.stem)
            values["premise"] = partial(function, **arguments)
        claims.append(Claim(**values))
    return claims


def _function(table: Mapping[str, Any], system: str) -> tuple[Callable[..., Any], dict[str, Any]]:
    """The measurement that a table names as MODULE.FUNCTION, with its arguments."""
    arguments = dict(table)
    module, _, name = arguments.pop("function").partition(".")
    function = getattr(import_module(f"grosmc_mj.chapter.claims.measurements.{module}"), name)
    if "system" in inspect.signature(function).parameters:
        arguments["system"] = system
    return function, arguments


# A system that the chapter says nothing of has no file.
CLAIMS = tuple(
    claim
    for system in SYSTEMS
    if (path := Path(__file__).with_name(f"{system}.toml")).is_file()
    for claim in read_claims(path)
)


def select_claims(target: str | None = None) -> list[Claim]:
    """The claims about a system, one claim by its id, or all.

    Raises:
        ArgumentError: If there is no such system with claims, and no such claim.
    """
    if target is not None:
        systems = dict.fromkeys(claim.system for claim in CLAIMS)
        require_known("claim", target, [*systems, *(claim.id for claim in CLAIMS)])
    return [claim for claim in CLAIMS if target in (None, claim.system, claim.id)]


def find_claim(name: str) -> Claim:
    """A claim by its id.

    Raises:
        ArgumentError: If there is none of that name.
    """
    require_known("claim", name, [claim.id for claim in CLAIMS])
    return next(claim for claim in CLAIMS if claim.id == name)
