"""From a log of a machine to its parameters with their uncertainty, and to a case of it.

``fit`` finds the parameters, ``case_file`` writes the case, ``predict`` compares a fitted machine
under a law with another log. It imports studies and below; logs are read by ``experiments.logs``.
"""
