"""The theory, without MuJoCo: from a task (plant, error coordinates, weights) to a law.

``design`` makes controllers, ``laws`` has their equations, ``switching`` and ``surface`` the
sliding mode, ``uncertainty`` the gains that hold a declared family of plants, ``reaching`` the
condition behind them, ``coordinates`` the error state z.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
