"""Laws as C99: written, compiled and compared with the Python law.

``law`` and ``program`` write the file, ``proof`` runs it beside the Python law on samples of a
case, ``fmu`` packs it for other simulators. It imports studies and below.
"""
