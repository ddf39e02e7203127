"""Ladder of reality: the step at which each law fails, from equations to the machine as built."""
