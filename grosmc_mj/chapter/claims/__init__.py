"""The chapter's claims: a data file for each system, and the code that judges them.

``ledger`` reads the files, ``judging`` judges the claims, and ``measurements`` has the functions
that the files name.
"""
