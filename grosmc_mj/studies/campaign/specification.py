"""Specification of a campaign, in plain values: a case file and how much of its family is run."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w

from grosmc_mj.experiments.file.content import read_content
from grosmc_mj.experiments.file.reading import case_file_of, parse_case_file
from grosmc_mj.experiments.file.schema import CaseFile, file_name
from grosmc_mj.experiments.file.shipped import campaign_files, find_file, shipped_files
from grosmc_mj.ground.errors import ArgumentError, unknown_name
from grosmc_mj.ground.fields import Range, checked
from grosmc_mj.mechanics.physics.mujoco_plant import Integrator

# Plants of one part: enough to fill all cores, few enough to lose little and to fit in memory.
SHARD = 512
_MOST_PARTS = 10**7
# Time of one run or of a control period [s]: eleven days at most.
_Time = Annotated[float, Range(0, 1e6, unit="s", above=True)] | None


@checked()
class Specification:
    """Family of plants and how much of it is run.

    Attributes:
        name: Name of the campaign.
        text: The case file, with all that it extends.
        folder: Folder of the case file and of what it names.
        runs: Number of plants; each meets every controller.
        seed: Seed of the sampler.
        sampler: ``random``, which alone gives intervals, or ``corners``.
        controllers: Names of the laws to run; empty for all controllers of the file.
        control_period: Control period instead of the file's [s].
        duration: Duration of each run instead of the file's [s].
        integrator: Integrator instead of the file's: ``implicitfast`` is several times as fast as
            ``RK4``.
        shard: Number of plants of one part.
        screen: ``auto``, ``equations`` or ``none``: whether runs are made on the equations, and in
            MuJoCo only those that need it.
    """

    name: str
    text: str
    folder: str
    runs: Annotated[int, Range(1, 10**12, whole=True)] = 1024
    seed: Annotated[int, Range(0, 2**63, whole=True, below=True)] = 0
    sampler: Literal["random", "corners"] = "random"
    controllers: tuple[str, ...] = ()
    control_period: _Time = None
    duration: _Time = None
    integrator: Integrator | None = None
    shard: Annotated[int, Range(1, 10**6, whole=True)] = SHARD
    screen: Literal["auto", "equations", "none"] = "auto"

    def __post_init__(self) -> None:
        if self.shards > _MOST_PARTS:
            raise ArgumentError(
                f"{self.runs} runs in parts of {self.shard} are {self.shards} parts: at most "
                f"{_MOST_PARTS} are kept; take a larger shard"
            )
        try:
            file_name(self.name)
        except ValueError as error:
            raise ArgumentError(f"name: {error}") from None

    @property
    def path(self) -> Path:
        """Path of the case file."""
        return Path(self.folder) / f"{self.name}.toml"

    @property
    def file(self) -> CaseFile:
        """The case file with the specification's own numbers."""
        file = parse_case_file(self.text, self.path)
        options = {
            "control_period": self.control_period,
            "duration": self.duration,
            "integrator": self.integrator,
        }
        numbers = {name: value for name, value in options.items() if value is not None}
        run = file.run.model_copy(update=numbers)

        plant = file.plant
        if plant.system is not None or plant.model is not None:
            # There is a model, and campaigns run in MuJoCo: no laws are designed for other plants.
            plant = plant.model_copy(update={"compare": ["physics"]})
        return file.model_copy(update={"run": run, "plant": plant})

    @property
    def shards(self) -> int:
        """Number of parts."""
        return -(-self.runs // self.shard)

    def ids(self, index: int) -> range:
        """Return the numbers of the runs in one part."""
        first = index * self.shard
        return range(first, min(first + self.shard, self.runs))

    def document(self) -> dict[str, Any]:
        """Return its plain values."""
        return {**asdict(self), "controllers": list(self.controllers)}

    @classmethod
    def of_document(cls, content: dict[str, Any]) -> Specification:
        """Read a specification from plain values.

        Raises:
            ArgumentError: If they are not those of a specification.
        """
        controllers = tuple(content.get("controllers", ()))
        return cls(**{**content, "controllers": controllers})


def specification_of(target: str, **options: Any) -> Specification:
    """Return the specification of a campaign on a system of the package or a file.

    Args:
        target: Name of a system, of a case of the package, or path of a case file.
        options: Other attributes of ``Specification``; None for the default.

    Raises:
        ArgumentError: If there is no such file, or a number does not fit.
    """
    path = _path_of(target)
    content = read_content(path)
    name = case_file_of(content, path).name
    text = tomli_w.dumps(content)
    folder = str(path.parent.resolve())
    options = {name: value for name, value in options.items() if value is not None}
    return Specification(name=name, text=text, folder=folder, **options)


def _path_of(target: str) -> Path:
    """The case file of a system, of a case or of a path."""
    files = {**shipped_files(), **campaign_files()}
    if target in files:
        return files[target]
    if Path(target).exists() or Path(target).suffix == ".toml":
        return find_file(target)
    valid = [*campaign_files(), "or a path that ends in .toml"]
    raise ArgumentError(unknown_name("system", target, valid))
