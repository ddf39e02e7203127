"""Contest: laws tuned alike by one budget, then judged alike on draws of no search."""
