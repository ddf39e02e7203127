"""Controllers designed from the laws and numbers of a case file.

``design`` designs one: ``packaged`` a kind of law of the package (``theory.control.kinds``) for the
task in the file (``task``), ``own`` a law, a function or a linear system of the user's own.
"""
