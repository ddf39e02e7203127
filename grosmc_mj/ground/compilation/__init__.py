"""Compilation: Python functions as C ones, and the records that both read.

``numba_internals`` has numba's private names, ``jitable`` marks functions for both engines,
``compiler`` keeps compiled ones on disk, ``codegen`` writes functions of sympy expressions.
"""
