"""The assumptions of the theorems, checked along a run and over an operating region.

``audit`` is for systems with equations, ``robot`` for MuJoCo's own dynamics, ``balance`` for both.
``notes`` says in a line each what a verdict leaves out: ``loads`` that move nothing, and what is
not ``matching``.
"""
