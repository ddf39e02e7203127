"""Constraints as stiff as MuJoCo has them."""

from __future__ import annotations

# ``solimp`` with MuJoCo's largest impedance at every depth: a constraint moves as its spring and
# damper say.
STIFFEST = (0.9999, 0.9999, 0.001, 0.5, 2.0)
