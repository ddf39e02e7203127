from . import loop
from .disturbances import Constant, SineFrom, Table
from .trajectory import Status

__all__ = ["Constant", "SineFrom", "Status", "Table", "loop"]
