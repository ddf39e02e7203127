"""The command line: the only place that prints, picks paths and exits."""

from grosmc_mj.cli.entry import DIFFERS, DONE, INTERRUPTED, WRONG, main

__all__ = ["DIFFERS", "DONE", "INTERRUPTED", "WRONG", "main"]
