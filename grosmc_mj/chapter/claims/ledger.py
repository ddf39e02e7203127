"""The chapter's claims: a file of data a system, each claim with the measurement that it names."""

from __future__ import annotations

import inspect
import itertools
import tomllib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from grosmc_mj.arguments import require_known
from grosmc_mj.chapter.claims.claim import Choice, Claim, Measured, NoValueError
from grosmc_mj.chapter.claims.measurements import (
    arm,
    cart,
    cart_pendulum,
    measures,
    servo,
    theory,
    two_link_arm,
)
from grosmc_mj.chapter.claims.words import WORDS
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.fields import translated
from grosmc_mj.plants import SYSTEMS

# A claim may name these modules' public functions that take a laboratory.
FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    f"{module.__name__.rpartition('.')[2]}.{name}": function
    for module in (servo, cart_pendulum, cart, arm, two_link_arm, theory, measures)
    for name, function in inspect.getmembers(module, inspect.isfunction)
    if function.__module__ == module.__name__
    and not name.startswith("_")
    and "lab" in inspect.signature(function).parameters
}


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
        arguments = {**self.arguments, **changed}
        if "epsilon" in arguments:
            lab = lab.varied("laws.grosmc.epsilon", arguments.pop("epsilon"))
        try:
            if not self.take:
                return self._at(lab, plant, arguments)
            return self._extreme(lab, plant, arguments)
        except NoValueError as error:
            return Measured(None, str(error), broken=True)

    def _extreme(self, lab: Laboratory, plant: PlantName, arguments: Mapping[str, Any]) -> Measured:
        lists = [name for name, value in arguments.items() if isinstance(value, list)]
        found: list[Measured] = []
        for values in itertools.product(*(arguments[name] for name in lists)):
            point = dict(zip(lists, values, strict=True))
            value, note, broken = self._at(lab, plant, {**arguments, **point})
            where = " ".join(map(str, values))
            if value is None or broken:
                return Measured(value, f"{where}: {note}", broken)
            words = f"{where} {value:.3g}" + (f" ({note})" if note else "")
            found.append(Measured(value, words))
        pick = max if self.take == "largest" else min
        extreme = pick(found, key=lambda measured: measured.value or 0.0)
        return extreme._replace(note="; ".join(measured.note for measured in found))

    def _at(self, lab: Laboratory, plant: PlantName, arguments: Mapping[str, Any]) -> Measured:
        first = self.function(lab, plant, **arguments)
        if not self.extrapolated or first.value is None or first.broken:
            return first
        second = self.function(lab.refined, plant, **arguments)
        if second.value is None or second.broken:
            return second
        note = f"{first.value:.3g} at T, {second.value:.3g} at T/2"
        return Measured(abs(2 * second.value - first.value), note)


def read_claims(path: Path) -> list[Claim]:
    """The claims of a system's file, in its order.

    Args:
        path: It has the system's name.

    Raises:
        SetupError: If a claim is not as it must be.
    """
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    shared, causes = content.pop("choices", {}), content.pop("causes", {})
    claims = []
    for name, table in content.items():
        try:
            choices = {key: Choice(**value) for key, value in shared.items()}
            values = _values(table, path.stem, choices, causes)
            claims.append(Claim(id=name, system=path.stem, **values))
        except ValidationError as error:
            mistake: Exception = translated(error, [], ArgumentError)
            raise SetupError(f"{path}: claim {name}: {mistake}") from None
        except (ArgumentError, TypeError) as error:
            raise SetupError(f"{path}: claim {name}: {error}") from None
    return claims


def _values(
    table: Mapping[str, Any], system: str, choices: Mapping[str, Choice], causes: Mapping[str, str]
) -> dict[str, Any]:
    """The fields of a claim by its table in the file.

    Raises:
        ArgumentError: If it names something that does not exist.
        TypeError: If arguments are not the function's own.
    """
    values = dict(table)
    if "word" in table:
        values = {**WORDS[_known("word", table["word"], WORDS)], **values}
    for key in ("choices", "every", "some"):
        own = [choices[_known("choice", name, choices)] for name in table.get(key, ())]
        values[key] = own if key == "choices" else [choice.name for choice in own]
    if "cause" in table:
        values["cause"] = causes[_known("cause", table["cause"], causes)]
    for key, called_with in (("measure", (0, 0)), ("premise", (0,))):
        if key not in table:
            continue
        arguments = dict(table[key])
        function = FUNCTIONS[_known("function", arguments.pop("function", ""), FUNCTIONS)]
        options = {name: arguments.pop(name) for name in _OPTIONS if name in arguments}
        if "system" in inspect.signature(function).parameters:
            arguments["system"] = system
        own = {name: value for name, value in arguments.items() if name != "epsilon"}
        inspect.signature(function).bind(*called_with, **own)
        values[key] = (
            Measurement(function, arguments, **options)
            if key == "measure"
            else partial(function, **arguments)
        )
    return values


_OPTIONS = ("take", "extrapolated")


def _known(kind: str, name: str, valid: Collection[str]) -> str:
    require_known(kind, name, valid)
    return name


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
        _known("claim", target, [*dict.fromkeys(c.system for c in CLAIMS), *(c.id for c in CLAIMS)])
    return [claim for claim in CLAIMS if target in (None, claim.system, claim.id)]


def find_claim(name: str) -> Claim:
    """A claim by its id.

    Raises:
        ArgumentError: If there is none of that name.
    """
    claims = {claim.id: claim for claim in CLAIMS}
    return claims[_known("claim", name, claims)]
