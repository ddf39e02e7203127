"""Former places of modules: importing one says where it is now."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.abc import MetaPathFinder

# Folders and modules that stood at the top of the package, and the doors behind which they are.
_DOORS = {
    "arguments": "ground",
    "arrays": "ground",
    "assumptions": "experiments",
    "cases": "experiments",
    "codegen": "ground.compilation",
    "comparison": "studies",
    "control": "theory",
    "errors": "ground",
    "executors": "ground",
    "fields": "ground",
    "films": "output",
    "jitable": "ground.compilation",
    "logs": "experiments",
    "loop": "simulation",
    "machine": "mechanics",
    "margins": "studies",
    "page": "output",
    "physics": "mechanics",
    "plants": "theory",
    "requirements": "experiments",
    "results": "output",
    "robots": "mechanics",
    "sweep": "studies",
    "units": "ground",
    "viewer": "output",
}


class MovedModules(MetaPathFinder):
    """Finder of modules that no other finder has found: it says the new place of a moved one."""

    def find_spec(self, fullname: str, path: Sequence[str] | None, target: object = None) -> None:
        """Refuse a module that has moved.

        Raises:
            ModuleNotFoundError: If it has, with its new name.
        """
        package, _, name = fullname.partition(".")
        if package == "grosmc_mj" and name in _DOORS:
            place = f"grosmc_mj.{_DOORS[name]}.{name}"
            raise ModuleNotFoundError(f"{fullname} is {place} now", name=fullname)
