"""Thousands of uncertain plants: what share of them keeps what is required."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
