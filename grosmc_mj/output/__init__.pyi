from . import films

__all__ = ["films"]
