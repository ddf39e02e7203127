"""A campaign's specification: plain values that travel to workers and stand in its manifest."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.experiments.file.reading import parse_case_file, resolved_text
from grosmc_mj.experiments.file.schema import CaseFile, file_name
from grosmc_mj.experiments.file.shipped import campaign_files, find_file, shipped_files
from grosmc_mj.fields import Range, checked
from grosmc_mj.physics.mujoco_plant import Integrator

# Plants of one part: enough to fill all cores, few enough to lose little and to fit in memory.
SHARD = 512
_MOST_PARTS = 10**7
# Of one run [s]: eleven days.
_Time = Annotated[float, Range(0, 1e6, unit="s", above=True)] | None


@checked()
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
    runs: Annotated[int, Range(1, 10**12, whole=True)] = 1024
    seed: Annotated[int, Range(0, 2**63, whole=True, below=True)] = 0
    sampler: Literal["random", "sobol", "lhs", "corners"] = "random"
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
        """Where the file lay."""
        return Path(self.folder) / f"{self.name}.toml"

    @property
    def file(self) -> CaseFile:
        """The case file with the specification's own numbers."""
        file = parse_case_file(self.text, self.path)
        options = ("control_period", "duration", "integrator")
        own = {name: value for name in options if (value := getattr(self, name)) is not None}
        # Campaigns run in MuJoCo, where there is a model: no laws are designed for other plants.
        modelled = file.plant.system is not None or file.plant.model is not None
        compared = {"compare": ["physics"]} if modelled else {}
        return file.model_copy(
            update={
                "run": file.run.model_copy(update=own),
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
            ArgumentError: If they are not those of a specification.
        """
        return cls(**{**content, "controllers": tuple(content.get("controllers", ()))})


def specification_of(target: str, **options: Any) -> Specification:
    """The specification of a campaign on a system of the package or a file.

    Args:
        target: Name of a system, of a case of the package, or path of a case file.
        options: What else ``Specification`` has; None for its default.

    Raises:
        ArgumentError: If there is no such thing, or a number does not fit.
    """
    path = _path_of(target)
    text = resolved_text(path)
    options = {name: value for name, value in options.items() if value is not None}
    folder, name = str(path.parent.resolve()), parse_case_file(text, path).name
    return Specification(name=name, text=text, folder=folder, **options)


def _path_of(target: str) -> Path:
    known = {**shipped_files(), **campaign_files()}
    if target in known:
        return known[target]
    if Path(target).exists() or Path(target).suffix == ".toml":
        return find_file(target)
    valid = [*campaign_files(), "or a path that ends in .toml"]
    raise ArgumentError(unknown_name("system", target, valid))
