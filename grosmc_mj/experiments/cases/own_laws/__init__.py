"""Laws of one's own, worked out: memory, tables, estimated rates, python-control."""
