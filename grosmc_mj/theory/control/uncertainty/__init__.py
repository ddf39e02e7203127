"""Declared uncertainties, and switching gains that withstand them, which the chapter leaves open.

``family`` is the family of plants that an uncertainty declares, with the gains that hold all of
them; ``outputs`` and ``states`` are the two kinds of it.
"""
