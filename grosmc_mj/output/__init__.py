"""Form of answers, whatever they say: ``results``, ``films``, one HTML ``page``, a ``viewer``.

``results`` has tables, charts and typed documents, ``page`` shows documents offline, ``films``
draws recorded runs, ``viewer`` a running loop. It offers films and the style of figures. It imports
simulation and below: it knows no case and no verdict.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
