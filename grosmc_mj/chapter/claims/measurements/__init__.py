"""Measurements of the claims: a module for each system, and modules that several systems share."""
