from . import control, plants

__all__ = ["control", "plants"]
