"""Exit codes of the command line."""

from __future__ import annotations

# Done, and everything that is required is kept.
DONE = 0
# A verdict: something is not kept, or not as recorded.
DIFFERS = 1
# Anything else that is wrong.
WRONG = 2
# Stopped by Ctrl-C or SIGTERM.
INTERRUPTED = 130
