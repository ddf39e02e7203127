"""What a campaign is asked for, as plain values that travel and are kept."""

from __future__ import annotations

import dataclasses
from dataclasses import MISSING, asdict, dataclass, replace
from pathlib import Path
from typing import Any, get_args

from grosmc_mj.arguments import whole
from grosmc_mj.campaign.family.sampling import SAMPLERS
from grosmc_mj.errors import ArgumentError, Mistakes, SetupError, shown, unknown_name
from grosmc_mj.experiments.file.reading import parse_case_file, resolved_text
from grosmc_mj.experiments.file.schema import CaseFile, file_name
from grosmc_mj.experiments.file.shipped import campaign_files, find_file, shipped_files
from grosmc_mj.physics.mujoco_plant import Integrator

# The package's own campaigns, one for each system.
# Plants of one part: enough to fill all cores, few enough to lose little and to fit in memory.
SHARD = 512
# Whether equations judge runs: where they agree with MuJoCo, wherever there are some, or nowhere.
SCREENS = ("auto", "equations", "none")
_MOST_RUNS, _MOST_PARTS = 10**12, 10**7
# Of one run [s]: eleven days.
_LONGEST = 1e6
# Types in a document; bool, which is an int to Python, is none of them.
_TYPES: dict[str, tuple[type, ...]] = {
    "name": (str,),
    "text": (str,),
    "folder": (str,),
    "runs": (int,),
    "seed": (int,),
    "sampler": (str,),
    "controllers": (list,),
    "control_period": (float, int, type(None)),
    "duration": (float, int, type(None)),
    "integrator": (str, type(None)),
    "shard": (int,),
    "screen": (str,),
}
_WORDS = {
    str: "a text",
    int: "a whole number",
    float: "a number",
    list: "a list",
    type(None): "null",
}


@dataclass(frozen=True)
class Specification:
    """A family of plants and how much of it is run.

    Attributes:
        name: Of the campaign.
        text: The case file, with all that it extends.
        folder: Where it lies, and what it names.
        runs: Plants; each meets every controller.
        seed: Of the sampler.
        sampler: ``random``, which alone gives intervals, ``sobol``, ``lhs`` or ``corners``.
        controllers: Names of those to run; empty for all of the file.
        control_period: Instead of the file's [s].
        duration: Instead of the file's [s].
        integrator: Instead of the file's: ``implicitfast`` is several times as fast as ``RK4``.
        shard: Plants of one part.
        screen: ``auto``, ``equations`` or ``none``: whether runs are made on the equations, and in
            MuJoCo only those that need it.
    """

    name: str
    text: str
    folder: str
    runs: int = 1024
    seed: int = 0
    sampler: str = "random"
    controllers: tuple[str, ...] = ()
    control_period: float | None = None
    duration: float | None = None
    integrator: str | None = None
    shard: int = SHARD
    screen: str = "auto"

    def __post_init__(self) -> None:
        mistakes = Mistakes()
        runs, shard, seed = (whole(each) for each in (self.runs, self.shard, self.seed))
        for name, found, most in (("runs", runs, _MOST_RUNS), ("shard", shard, 10**6)):
            if found is None or not 1 <= found <= most:
                given = shown(getattr(self, name))
                mistakes.note(f"--{name} {given} must be from 1 to {most}, a whole number")
        if runs and shard and shard > 0 and _MOST_PARTS < self.shards <= _MOST_RUNS:
            mistakes.note(
                f"--runs {self.runs} in parts of {self.shard} are {self.shards} parts: at most "
                f"{_MOST_PARTS} are kept; take a larger --shard"
            )
        if seed is None or not 0 <= seed < 2**63:
            given = shown(self.seed)
            mistakes.note(f"--seed {given} must be 0 or more, below 2^63, a whole number")
        if self.sampler not in SAMPLERS:
            mistakes.note(unknown_name("sampler", self.sampler, SAMPLERS))
        if self.integrator is not None and self.integrator not in get_args(Integrator):
            mistakes.note(unknown_name("integrator", self.integrator, get_args(Integrator)))
        if self.screen not in SCREENS:
            mistakes.note(unknown_name("screen", self.screen, SCREENS))
        for name in ("control_period", "duration"):
            value = getattr(self, name)
            if value is not None and not (0 < value <= _LONGEST):
                # A whole number from a manifest may have thousands of digits.
                said = f"{value:g}" if isinstance(value, float) else str(value)[:20]
                mistakes.note(
                    f"--{name.replace('_', '-')} {said} s must be positive and at most "
                    f"{_LONGEST:g} s"
                )
        try:
            file_name(self.name)
        except ValueError as error:
            mistakes.note(f"name: {error}")
        if "\0" in self.folder:
            mistakes.note(f"{shown(self.folder)} is no folder")
        mistakes.refuse()

    @property
    def path(self) -> Path:
        """Where the file lay."""
        return Path(self.folder) / f"{self.name}.toml"

    @property
    def file(self) -> CaseFile:
        """The case file with what is asked for instead."""
        file = parse_case_file(self.text, self.path)
        file = file if file.name else file.model_copy(update={"name": self.name})
        instead: dict[str, Any] = {
            name: getattr(self, name)
            for name in ("control_period", "duration", "integrator")
            if getattr(self, name) is not None
        }
        # Campaigns run in MuJoCo, where there is a model: no laws are designed for other plants.
        modelled = file.plant.system is not None or file.plant.model is not None
        compared = {"compare": ["physics"]} if modelled else {}
        return file.model_copy(
            update={
                "run": file.run.model_copy(update=instead),
                "plant": file.plant.model_copy(update=compared),
            }
        )

    @property
    def shards(self) -> int:
        """Number of parts."""
        return -(-self.runs // self.shard)

    def ids(self, index: int) -> range:
        """Numbers of the runs in one part."""
        return range(index * self.shard, min((index + 1) * self.shard, self.runs))

    def document(self) -> dict[str, Any]:
        """As plain values."""
        return {**asdict(self), "controllers": list(self.controllers)}

    @classmethod
    def of_document(cls, content: dict[str, Any]) -> Specification:
        """From plain values.

        Raises:
            SetupError: If they are not those of a specification.
        """
        fields = {each.name: each for each in dataclasses.fields(cls)}
        for name, kinds in _TYPES.items():
            if name not in content:
                if fields[name].default is MISSING:
                    raise SetupError(
                        f"the specification of this campaign cannot be read: no {name}"
                    )
            elif type(content[name]) not in kinds:
                raise SetupError(
                    f"the specification of this campaign cannot be read: {name} must be "
                    f"{' or '.join(_WORDS[kind] for kind in kinds)}"
                )
        if unknown := [name for name in content if name not in _TYPES]:
            raise SetupError(
                "the specification of this campaign cannot be read: "
                f"{unknown_name('field', unknown[0], _TYPES)}"
            )
        controllers = content.get("controllers", [])
        if not all(isinstance(each, str) for each in controllers):
            raise SetupError(
                "the specification of this campaign cannot be read: controllers must be texts"
            )
        return cls(**{**content, "controllers": tuple(controllers)})


def specification_of(target: str, **asked: Any) -> Specification:
    """The specification of a campaign on a system of the package or a file.

    Args:
        target: Name of a system, of a case of the package, or path of a case file.
        asked: What else ``Specification`` has; None for its default.

    Raises:
        ArgumentError: If there is no such thing, or a number does not fit.
    """
    path = _found(target)
    given = {name: value for name, value in asked.items() if value is not None}
    specification = Specification(
        path.stem, resolved_text(path), str(path.parent.resolve()), **given
    )
    name = specification.file.name or path.stem
    try:
        return replace(specification, name=name)
    except ArgumentError as error:
        raise ArgumentError(f"{path}: {error}") from None


def _found(target: str) -> Path:
    """The file that is meant."""
    known = {**shipped_files(), **campaign_files()}
    if target in known:
        return known[target]
    if Path(target).exists() or Path(target).suffix == ".toml":
        return find_file(target)
    valid = [*campaign_files(), "or a path that ends in .toml"]
    raise ArgumentError(unknown_name("system", target, valid))
