"""The live window: watch a case, push it, or replay a recorded run."""
