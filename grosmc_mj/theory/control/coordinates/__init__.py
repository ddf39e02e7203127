"""Error coordinates z and v = y^(r), of outputs in symbols and of the whole state."""
