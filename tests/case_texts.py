"""Name of the leg's model for tests that have not moved to ``own_files``."""

from own_files import LEG as LEG_MODEL

__all__ = ["LEG_MODEL"]
