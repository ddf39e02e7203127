"""The command line: the only place that prints, picks paths and exits.

``program`` finds a command among ``commands``, ``screen`` says its answer, ``streams`` survive a
reader that has gone. It offers ``main`` and the exit codes. It imports every door.
"""

from grosmc_mj.cli.entry import main
from grosmc_mj.cli.exit_codes import DIFFERS, DONE, INTERRUPTED, WRONG

__all__ = ["DIFFERS", "DONE", "INTERRUPTED", "WRONG", "main"]
