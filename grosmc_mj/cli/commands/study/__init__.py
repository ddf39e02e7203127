"""Studies: a module for each, whose first line is its line in the overview.

The module ``NAME`` has the class ``NameCommand``; no list names it.
"""
