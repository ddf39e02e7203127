from .disturbances import Constant, SineFrom
from .linearization import linearize
from .models import load_model
from .trajectory import Status

__all__ = ["Constant", "SineFrom", "Status", "linearize", "load_model"]
