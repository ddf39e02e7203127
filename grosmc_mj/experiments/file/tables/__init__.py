"""The tables of a case file but for those of ``schema``: laws, loop, machine, uncertain numbers."""
