"""The folder with logs of real machines, which the package does not contain."""

from __future__ import annotations

import os
from pathlib import Path

BESIDE = Path(__file__).parents[2] / "shared" / "data"
DATA = Path(os.environ.get("GROSMC_DATA", BESIDE))
MISSING = f"the logs of real machines are not in {DATA}: set GROSMC_DATA"
