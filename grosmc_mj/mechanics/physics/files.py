"""The MJCF files of the package: where they are and how they are read."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mujoco

from grosmc_mj.ground.errors import ModelError, SetupError
from grosmc_mj.mechanics.physics.checks import refuse_unusable
from grosmc_mj.mechanics.physics.hooks import warnings_ignored
from grosmc_mj.theory.plants import find_system

_PACKAGE = Path(__file__).resolve().parents[2]
# The wheel carries the models inside the package; a checkout has them beside it.
# Number of the line in MuJoCo's messages.
_LINE = re.compile(r"\b[Ll]ine (?:number=)?(\d+)")
_FOLDERS = (_PACKAGE / "models", _PACKAGE.parent / "models")


def model_path(name: str) -> Path:
    """Path of the MJCF file of a system, installed or in the checkout.

    Raises:
        ModelError: If there is no such system.
        SetupError: If its file is missing.
    """
    file = f"{find_system(name).name}.xml"
    for folder in _FOLDERS:
        if (folder / file).is_file():
            return folder / file
    places = " or ".join(str(folder) for folder in _FOLDERS)
    raise SetupError(f"{file} is not in {places}: install the package again")


def load_spec(name: str) -> mujoco.MjSpec:
    """Read the editable MjSpec of a system's nominal model.

    Raises:
        ModelError: If there is no such system or its MJCF is broken.
    """
    path = model_path(name)
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise ModelError(f"{path}: {' '.join(str(error).split())}") from error


def load_model(name: str) -> mujoco.MjModel:
    """Compile the nominal model of a system, such as ``servo``.

    Raises:
        ModelError: If there is no such system or its MJCF is broken.
    """
    return compile_spec(load_spec(name))


def compile_spec(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a model; if MuJoCo cannot, its message becomes one line.

    Args:
        spec: The model.

    Raises:
        ModelError: If MuJoCo refuses the model, or nobody could simulate it.
    """
    try:
        with warnings_ignored():
            model = spec.compile()
    except ValueError as error:
        words = " ".join(str(error).split()).removeprefix("Error: ")
        raise ModelError(f"{spec.modelname}: {words}") from error
    # Finite edits of finite numbers may overflow.
    refuse_unusable(model, spec.modelname)
    return model


@contextmanager
def of_file(model: Any) -> Iterator[None]:
    """Name the file of a model, and the line if MuJoCo tells it, in the errors of the block.

    Args:
        model: Path of an MJCF; of anything else, errors stay as they are.

    Raises:
        ModelError: In the place of each ``ModelError``.
    """
    try:
        yield
    except ModelError as error:
        is_text = isinstance(model, str) and model.lstrip().startswith("<")
        if is_text or not isinstance(model, (str, Path)):
            raise
        line = _LINE.search(str(error))
        place = f":{line[1]}" if line is not None else ""
        raise ModelError(f"{Path(model).name}{place}: {error}") from error


def body_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of its bodies, without the world."""
    return tuple(model.body(i).name for i in range(1, model.nbody))


def joint_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of its joints."""
    return tuple(model.joint(i).name for i in range(model.njnt))
