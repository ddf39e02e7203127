"""Mechanics in MuJoCo: ``physics`` of models and their edits, the ``machine`` as built, ``robots``.

It offers models that are loaded, edited and linearized, parts of a machine such as friction and
backlash, and robots, whose dynamics are MuJoCo's own. It imports theory and ground.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
