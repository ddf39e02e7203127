"""The command line: the only place that prints, picks paths and exits."""

from grosmc_mj.cli.program import main
from grosmc_mj.cli.screen import DIFFERS, DONE, WRONG

__all__ = ["DIFFERS", "DONE", "WRONG", "main"]
