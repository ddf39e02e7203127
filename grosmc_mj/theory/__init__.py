"""Theory of the chapter: ``plants`` as equations, ``control`` from a task to a law.

It offers both folders, and each of them its names. It imports ground alone: no MuJoCo, so that the
theory stands without the engine that tests it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
