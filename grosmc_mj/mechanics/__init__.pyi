from . import machine, physics, robots

__all__ = ["machine", "physics", "robots"]
