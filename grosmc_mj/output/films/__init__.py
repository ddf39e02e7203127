"""Recorded runs as films: the scene with its marks and camera, the curves, the encoder."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
