"""Worst disturbance: the bounded signal that takes a law closest to its limits, or past them."""
