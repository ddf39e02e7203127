"""What the theorems ask for, on a run and over a region.

``audit`` for the systems in symbols, ``robot`` for MuJoCo's own dynamics, ``balance`` for both.
"""
