"""Laws as C99: written, compiled and compared with the Python law."""
