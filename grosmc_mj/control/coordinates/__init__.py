"""The error state z and v = y^(r), of equations in symbols and of states that are read off."""
