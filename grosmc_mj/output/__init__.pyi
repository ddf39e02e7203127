from . import films, results

__all__ = ["films", "results"]
