from .film import Film, Format, Take
from .write import write_film

__all__ = ["Film", "Format", "Take", "write_film"]
