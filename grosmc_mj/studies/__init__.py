"""Studies: questions that take many runs, a folder each.

``sweep`` runs them as one table, ``campaign`` asks on which plants a law holds, ``ladder`` at which
step of reality it fails, ``tolerance`` how much of an imperfection it stands, ``margins`` how much
gain and delay, ``region`` from which starts, ``disturbance`` which one is the worst, ``tune`` with
which numbers a law keeps all; ``comparison`` tells what changed between two results. They offer
``Campaign`` and its findings, and import experiments and below.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
