"""Campaigns: a family of uncertain plants, what share of it keeps its promise, and its worst."""
