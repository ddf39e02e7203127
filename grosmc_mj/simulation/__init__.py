"""Closed loops on equations and in MuJoCo: ``simulate`` is the one entry.

``prepare`` checks its arguments and makes a ``problem``; ``kernel`` is the closed loop, which two
engines run in one kind of memory, ``run_memory``: compiled, on many threads, and as plain Python.
``disturbances`` act on the plant, ``loop`` lies between law and plant, ``trajectory`` is the
result. It offers disturbances and the loop, and imports mechanics and below.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
