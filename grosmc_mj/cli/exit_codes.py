"""What the command line's exit codes mean."""

from __future__ import annotations

# Kept; a verdict that something is not kept; anything else that is wrong; stopped by Ctrl-C or
# SIGTERM.
DONE, DIFFERS, WRONG, INTERRUPTED = 0, 1, 2, 130
