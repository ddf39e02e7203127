"""Declared uncertainties, and switching gains that withstand them, which the chapter leaves open.

``family`` is the family of plants that an uncertainty declares, ``outputs`` and ``states`` are the
two kinds of it; ``gain_suprema`` computes the gains.
"""
