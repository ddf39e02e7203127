"""Tuning: numbers of a law that keep what a case requires, searched in its loop as built."""
