"""Plants in MuJoCo: model files, edits of their bodies, parameters read back from them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
