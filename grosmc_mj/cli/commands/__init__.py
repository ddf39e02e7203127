"""Commands of the command line: a module for each, with its options and its work."""

from __future__ import annotations

from collections.abc import Mapping

from grosmc_mj.cli.command import Command
from grosmc_mj.cli.commands.campaign.command import CampaignCommand
from grosmc_mj.cli.commands.claims import CLAIMS
from grosmc_mj.cli.commands.diff import DiffCommand
from grosmc_mj.cli.commands.film import FilmCommand
from grosmc_mj.cli.commands.identify import CompareCommand, IdentifyCommand
from grosmc_mj.cli.commands.list import ListCommand
from grosmc_mj.cli.commands.new import NewCommand
from grosmc_mj.cli.commands.report import ReportCommand
from grosmc_mj.cli.commands.run import RunCommand
from grosmc_mj.cli.commands.study.ladder import LadderCommand
from grosmc_mj.cli.commands.study.region import RegionCommand
from grosmc_mj.cli.commands.study.tolerance import ToleranceCommand
from grosmc_mj.cli.commands.validate import ValidateCommand
from grosmc_mj.cli.commands.view import ViewCommand

Studies = Mapping[str, type[Command]]

STUDIES: Studies = {
    "region": RegionCommand,
    "tolerance": ToleranceCommand,
    "ladder": LadderCommand,
}
COMMANDS: Mapping[str, type[Command] | Studies] = {
    "new": NewCommand,
    "run": RunCommand,
    "campaign": CampaignCommand,
    "film": FilmCommand,
    "view": ViewCommand,
    "validate": ValidateCommand,
    "claims": CLAIMS,
    "study": STUDIES,
    "identify": IdentifyCommand,
    "compare": CompareCommand,
    "report": ReportCommand,
    "diff": DiffCommand,
    "list": ListCommand,
}
# Help of the groups of commands; ``claims`` alone is ``claims judge``.
_BESIDE_JUDGE = [name for name in CLAIMS if name != "judge"]
GROUPS = {
    "claims": f"Judge the chapter's claims; or {', '.join(_BESIDE_JUDGE)}.",
    "study": f"Measure one thing: {', '.join(STUDIES)}.",
}

ABOUT = (
    "Does a robust controller keep its promise, from equation to physics, and where does it break? "
    "GROSMC (LQR made robust by an integral sliding surface) on the servo rotor, the "
    "cart-pendulum, the 1-DOF arm and a two-link arm: printed equations, corrected ones and "
    "MuJoCo, side by side.\n\n"
    "What a command is about is a SYSTEM, one of its cases (SYSTEM/CASE) or a case file of your "
    "own (FILE.toml); grosmc-mj list names them, grosmc-mj new writes one. The answer comes first "
    "and fits on a screen; --verbose prints all tables.\n\n"
    "Exit codes: 0 done and kept, 1 something is not kept or not as recorded, 2 anything else that "
    "is wrong, 130 interrupted by Ctrl-C or SIGTERM. --debug adds the traceback of an error."
)
