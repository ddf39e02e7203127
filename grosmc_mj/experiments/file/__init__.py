"""Case files: their tables, units, formulas and the user's Python, and how they are read."""
