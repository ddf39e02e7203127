"""Tolerance: the largest imperfection of a loop that each law stands."""
