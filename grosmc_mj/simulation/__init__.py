"""Closed loops on equations and in MuJoCo: ``simulate`` is the one entry.

``mujoco_plant``, ``edits`` and ``disturbances`` say what is simulated, ``trajectory`` what comes
back; ``engines`` step it, ``robots`` are models of several joints without equations in symbols.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
