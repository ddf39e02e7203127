"""One case as one object: its file, plants, laws, runs, metrics and requirements.

``file`` reads TOML, ``experiment`` makes of it what is run and judged, ``requirements`` are what
runs are judged by, ``assumptions`` are those of the theorems, ``logs`` are read as runs of a
machine; ``cases`` has the shipped files. It offers ``Experiment``, ``judge`` and ``run_many``, and
imports output and below.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
