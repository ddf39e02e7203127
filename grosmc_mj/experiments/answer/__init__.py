"""Answer of a run: its tables, its curves, its JSON document."""
