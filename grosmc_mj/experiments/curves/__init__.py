"""What runs of a case do over time: panels of curves, as a figure and as a document."""
