"""Ground that every other door stands on: no control theory, no physics.

``errors``, checked ``fields`` and ``arguments``, numbers with ``units``, ``files`` written whole or
not at all, ``versions``; ``compilation`` makes C functions of Python ones, ``executors`` do work in
processes. It offers the package's ``errors``, and imports nothing of the package.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
