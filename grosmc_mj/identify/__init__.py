"""From a log of a machine to its parameters with their uncertainty, and to a case of it."""
