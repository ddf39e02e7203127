"""Many runs as one table: a design has a row a run, the result adds metrics, margins, status."""

import lazy_loader

__getattr__, __dir__, _ = lazy_loader.attach_stub(__name__, __file__)
__all__ = ["Findings", "Specification", "run_campaign"]  # pyright: ignore
