"""What the chapter claims, a file of data a system, and how each claim is measured.

``ledger`` offers all claims and judges them; the systems' modules, ``theory``, ``cart`` and
``measures`` have the functions that the files name.
"""
