"""Margins of a loop as it runs: of its task by search, of its sensitivity by injected signals."""
