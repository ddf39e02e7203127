"""What the words of the statements mean in numbers."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

# The limit of each, and why.
WORDS: dict[str, dict[str, Any]] = tomllib.loads(
    Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
)
