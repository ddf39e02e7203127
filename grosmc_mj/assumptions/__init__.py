"""The assumptions of the theorems, checked along a run and over an operating region.

``audit`` is for systems with equations, ``robot`` for MuJoCo's own dynamics, ``balance`` for both.
"""
