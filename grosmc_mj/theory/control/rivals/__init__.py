"""Rivals of GROSMC: the usual laws for unknown loads and unknown parameters.

``lqi``, ``pid`` and ``adrc`` are linear feedback with dynamics (``dynamic_feedback``), on the same
error coordinates as the chapter's laws; ``adaptive`` is Slotine and Li's for a mechanical system.
"""
