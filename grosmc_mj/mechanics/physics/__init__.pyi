from .files import load_model
from .linearization import linearize

__all__ = ["linearize", "load_model"]
