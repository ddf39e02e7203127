"""Thousands of uncertain plants: what share of them keeps what is required.

``family`` says which plants, ``runs`` runs them, ``findings`` says what the rows mean, ``report``
shows it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
