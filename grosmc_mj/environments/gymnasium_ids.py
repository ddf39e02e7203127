"""Importing this module registers the environments.

Gymnasium 1.0 asks no installed package for its environments any more; it imports the module that
an id names: ``gymnasium.make("grosmc_mj.environments.gymnasium_ids:grosmc_mj/Servo-v0")``.
"""

from __future__ import annotations

from grosmc_mj.environments.registration import register

register()
