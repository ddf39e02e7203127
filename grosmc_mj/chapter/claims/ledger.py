"""The chapter's claims, read from a data file for each system."""

from __future__ import annotations

import inspect
import itertools
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

from grosmc_mj.chapter.claims.claim import WORDS, Choice, Claim, ClaimValue, Kind, NoValueError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.theory.plants import SYSTEMS

# A place in the chapter, as a user names it.
_PLACE = re.compile(r"(fig|eq)[a-z]*\.? *\(?(\d{1,3})\)?", re.IGNORECASE)


@dataclass(frozen=True)
class ClaimMeasurement:
    """A measurement with the arguments of its claim.

    Attributes:
        function: Function of a run cache, a plant and the arguments.
        arguments: Its further arguments. ``epsilon`` is the arm's gain instead of the case files'.
        take: The extreme over all combinations of the arguments that are lists; empty for none.
        extrapolated: Whether the value is extrapolated to a sampling time of zero.
    """

    function: Callable[..., ClaimValue]
    arguments: Mapping[str, Any]
    take: Literal["", "largest", "least"] = ""
    extrapolated: bool = False

    def __call__(
        self,
        lab: RunCache,
        plant: PlantName,
        **changed: Any,
    ) -> ClaimValue:
        """The value on a plant; broken if a run that it rests on is."""
        arguments = {**self.arguments, **changed}
        if "epsilon" in arguments:
            lab = lab.varied("laws.grosmc.epsilon", arguments.pop("epsilon"))
        try:
            if self.take:
                return self._extreme(lab, plant, arguments)
            return self._at(lab, plant, arguments)
        except NoValueError as error:
            return ClaimValue(None, str(error), broken=True)

    def _extreme(
        self,
        lab: RunCache,
        plant: PlantName,
        arguments: Mapping[str, Any],
    ) -> ClaimValue:
        """The extreme over all combinations of the lists, with all values in its note."""
        lists = [name for name in arguments if isinstance(arguments[name], list)]
        points = []
        for values in itertools.product(*(arguments[name] for name in lists)):
            combination = dict(zip(lists, values, strict=True))
            point = self._at(lab, plant, {**arguments, **combination})
            where = " ".join(map(str, values))
            if point.value is None or point.broken:
                return point._replace(note=f"{where}: {point.note}")

            note = f"{where} {point.value:.3g}"
            if point.note:
                note += f" ({point.note})"
            points.append(ClaimValue(point.value, note))

        pick = max if self.take == "largest" else min
        extreme = pick(points, key=lambda point: point.value or 0.0)
        return extreme._replace(note="; ".join(point.note for point in points))

    def _at(
        self,
        lab: RunCache,
        plant: PlantName,
        arguments: Mapping[str, Any],
    ) -> ClaimValue:
        """The value v at T, or 2 v(T/2) - v(T), which removes an error that is linear in T."""
        first = self.function(lab, plant, **arguments)
        if not self.extrapolated or first.value is None or first.broken:
            return first

        second = self.function(lab.refined, plant, **arguments)
        if second.value is None or second.broken:
            return second
        note = f"{first.value:.3g} at T, {second.value:.3g} at T/2"
        return ClaimValue(abs(2 * second.value - first.value), note)


def read_claims(path: Path) -> list[Claim]:
    """Read the claims of a system's file, in its order; the file has the system's name."""
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    causes = content.pop("causes", {})
    tables = content.pop("choices", {})
    choices = {key: Choice(**table) for key, table in tables.items()}
    return [_claim(name, path.stem, table, choices, causes) for name, table in content.items()]


def _claim(
    name: str,
    system: str,
    table: Mapping[str, Any],
    choices: Mapping[str, Choice],
    causes: Mapping[str, str],
) -> Claim:
    """The claim of a table; its choices and its cause are keys of the file's own."""
    # The limit of a word counts where the table has none.
    limit = WORDS.get(table.get("word", ""), {})
    fields = {**limit, **table, "id": name, "system": system}
    fields["kind"] = Kind[table.get("kind", "claim").upper()]
    fields["choices"] = [choices[key] for key in table.get("choices", ())]
    for quantifier in ("every", "some"):
        fields[quantifier] = [choices[key].name for key in table.get(quantifier, ())]
    if "cause" in table:
        fields["cause"] = causes[table["cause"]]

    fields["measure"] = _measurement(table["measure"], system)
    if "premise" in table:
        function, arguments = _function(table["premise"], system)
        fields["premise"] = partial(function, **arguments)
    return Claim(**fields)


def _measurement(table: Mapping[str, Any], system: str) -> ClaimMeasurement:
    options = dict(table)
    take = options.pop("take", "")
    extrapolated = options.pop("extrapolated", False)
    function, arguments = _function(options, system)
    return ClaimMeasurement(function, arguments, take, extrapolated)


def _function(table: Mapping[str, Any], system: str) -> tuple[Callable[..., Any], dict[str, Any]]:
    """The function that a table names as MODULE.FUNCTION, and its arguments."""
    arguments = dict(table)
    module, _, name = arguments.pop("function").partition(".")
    function = getattr(import_module(f"grosmc_mj.chapter.claims.measurements.{module}"), name)
    if "system" in inspect.signature(function).parameters:
        arguments["system"] = system
    return function, arguments


def _all_claims() -> list[Claim]:
    """The claims of all systems; a system that the chapter does not treat has no file."""
    claims = []
    for system in SYSTEMS:
        path = Path(__file__).with_name(f"{system}.toml")
        if path.is_file():
            claims += read_claims(path)
    return claims


CLAIMS = tuple(_all_claims())


def select_claims(target: str | None = None) -> list[Claim]:
    """Return the claims about a system, a figure or an equation, one claim by its id, or all.

    Args:
        target: A system, the id of a claim, or a place in the chapter: ``Fig. 3``, ``eq. (37)``.

    Raises:
        ArgumentError: If there is no such system with claims, no such claim, and none of a place.
    """
    if target is None:
        return list(CLAIMS)
    place = _PLACE.fullmatch(target.strip())
    if place is not None:
        return _claims_of_place(place[1].lower(), int(place[2]))

    systems = dict.fromkeys(claim.system for claim in CLAIMS)
    require_known("claim", target, [*systems, *(claim.id for claim in CLAIMS)])
    return [claim for claim in CLAIMS if target in (claim.system, claim.id)]


def _claims_of_place(kind: str, number: int) -> list[Claim]:
    """Return the claims that name a figure or an equation as their source."""
    cited = [claim for claim in CLAIMS if number in _numbers_cited(claim.source, kind)]
    if not cited:
        place = f"Fig. {number}" if kind == "fig" else f"eq. ({number})"
        raise ArgumentError(
            f"no claim rests on {place}: docs/map.md leads from each equation to its code, "
            "docs/tutorials/the_chapter.md from each figure to its command"
        )
    return cited


def _numbers_cited(source: str, kind: str) -> set[int]:
    """Return the numbers of figures, or of equations, in words such as ``eqs. (4)-(7), Fig. 3``."""
    numbers: set[int] = set()
    if kind == "fig":
        for listed in re.findall(r"Figs?\. (\d+(?:(?:, | and )\d+)*)", source):
            numbers.update(map(int, re.findall(r"\d+", listed)))
        return numbers
    for first, last in re.findall(r"\((\d+)\)(?:-\((\d+)\))?", source):
        numbers.update(range(int(first), int(last or first) + 1))
    return numbers


def find_claim(name: str) -> Claim:
    """Return a claim by its id.

    Raises:
        ArgumentError: If there is no claim of that name.
    """
    claims = {claim.id: claim for claim in CLAIMS}
    require_known("claim", name, claims)
    return claims[name]


def cited_claims(experiment: Experiment) -> dict[str, Claim]:
    """Return the claims that an experiment's file names, by their ids.

    Raises:
        ArgumentError: If there is no claim of such an id.
    """
    cited = experiment.file.claim
    if not cited:
        return {}

    try:
        return {table.id: find_claim(table.id) for table in cited}
    except ArgumentError as error:
        raise ArgumentError(f"{experiment.path}: {error}") from None
