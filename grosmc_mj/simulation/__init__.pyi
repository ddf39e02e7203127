from .disturbances import Constant, SineFrom
from .trajectory import Status

__all__ = ["Constant", "SineFrom", "Status"]
