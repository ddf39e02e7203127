"""Form of answers, whatever they say: ``results``, ``charts``, ``films``, a ``page``, a ``viewer``.

``results`` has tables and typed documents, ``charts`` draws them, ``page`` shows them offline,
``films`` draws recorded runs, ``viewer`` a running loop. It offers films. It imports simulation and
below: it knows no case and no verdict.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
