"""The command line: the only place that prints, picks paths and exits."""

from grosmc_mj.cli.entry import main
from grosmc_mj.cli.exit_codes import DIFFERS, DONE, INTERRUPTED, WRONG

__all__ = ["DIFFERS", "DONE", "INTERRUPTED", "WRONG", "main"]
