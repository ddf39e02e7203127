"""Comparison of old and new results: the changes, and which of them are more than noise."""
