"""Metrics: their folds, the recorded run beside its optimum, and all that is measured on it."""
