"""How near to a limit a margin by the equations is not believed, in parts of the limit."""

from __future__ import annotations

# It is confirmed in MuJoCo within this many times the largest difference found...
FACTOR = 10.0
# ...and within what rounding may come to on another machine.
LEAST_BAND = 1e-9
