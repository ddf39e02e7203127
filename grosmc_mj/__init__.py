"""Does a robust controller keep its promise, from equation to physics, and where does it break?

The stub beside this file lists the public names. They load on first use: importing the package is
quick and does not import MuJoCo. Further names are offered by the doors, the folders of this one.
"""

from __future__ import annotations

import sys

import lazy_loader

from grosmc_mj.ground.moved import MovedModules
from grosmc_mj.ground.versions import __version__ as __version__

sys.meta_path.append(MovedModules())

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
