"""Commands of the command line: a module for each, with its options and its work."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple


class Entry(NamedTuple):
    """A command in the overview.

    Attributes:
        path: Its module in this package, and its class; imported when the command is named.
        summary: Its line in the overview.
    """

    path: str
    summary: str


Subcommands = Mapping[str, Entry]

CLAIMS: Subcommands = {
    "judge": Entry("claims:JudgeCommand", "Judge the claims; claims alone does it, too."),
    "sweep": Entry("claims:SweepCommand", "Show where the answers turn as choices vary."),
    "premises": Entry("claims:PremisesCommand", "Check the premises of the theorems in each case."),
}


def _studies() -> Subcommands:
    """Return the studies: each module of ``study`` is one.

    Its first line is read, not its module imported: an overview of the commands is quick.
    """
    studies = {}
    for path in sorted(Path(__file__).with_name("study").glob("[a-z]*.py")):
        name = path.stem
        summary = path.read_text(encoding="utf-8").partition("\n")[0].strip('"')
        studies[name] = Entry(f"study.{name}:{name.title()}Command", summary)
    return studies


STUDIES = _studies()
COMMANDS: Mapping[str, Entry | Subcommands] = {
    "new": Entry("new:NewCommand", "Write a case file to begin with, every key explained."),
    "run": Entry("run:RunCommand", "Run an experiment: does it keep what it requires?"),
    "campaign": Entry(
        "campaign.command:CampaignCommand",
        "Run thousands of uncertain plants: on what share do laws hold?",
    ),
    "film": Entry("film:FilmCommand", "Film a case: laws side by side in MuJoCo."),
    "view": Entry("view:ViewCommand", "Watch a case in MuJoCo's window, and pull at it."),
    "validate": Entry(
        "validate:ValidateCommand",
        "Run the book chapter's cases: do they come out as recorded?",
    ),
    "claims": CLAIMS,
    "study": STUDIES,
    "tune": Entry("tune:TuneCommand", "Find numbers with which a law keeps what is required."),
    "identify": Entry(
        "identify:IdentifyCommand",
        "Fit a case's parameters to a log of the machine.",
    ),
    "compare": Entry("identify:CompareCommand", "Which model explains a log of the machine?"),
    "predict": Entry(
        "predict:PredictCommand",
        "Does the fitted machine do what the real one did under its law?",
    ),
    "export": Entry("export:ExportCommand", "Write a law as C, proven to be the same."),
    "report": Entry("report:ReportCommand", "Write one HTML page of results."),
    "diff": Entry("diff:DiffCommand", "Compare two results: what got worse beyond noise?"),
    "list": Entry("list:ListCommand", "List systems, cases, laws and case files."),
}
# Summaries of the groups of commands.
GROUPS = {
    "claims": "Judge the book chapter's claims, or check its premises.",
    "study": "Measure tolerances, margins, the worst disturbance ...",
}

ABOUT = (
    "Check whether a robust controller meets its specification: on equations, in MuJoCo, on models "
    "of real machines. Where it fails, it names the cause.\n\n"
    "It applies to mechanisms of hinges and slides that torques or forces drive: the package's "
    "servo, cart_pendulum, arm and two_link_arm, each as equations, in MuJoCo and as a machine; "
    "your own robot (MJCF); equations that are affine in the input; logs of a machine. Laws: LQR, "
    "LQI, PID, ADRC, adaptive control, GROSMC (LQR made robust by an integral sliding surface; "
    "from a book chapter, which validate and claims check), or your own Python. It does not apply "
    "to tasks in contact, wheeled or flying robots, or links that bend.\n\n"
    "Try first:\n"
    "  grosmc-mj run cart_pendulum/case1   does this case meet its requirements?\n"
    "  grosmc-mj new mine                  write a case file to change\n"
    "  grosmc-mj study ladder servo        at which step does each law fail?\n\n"
    "The target of a command is a SYSTEM, one of its cases (SYSTEM/CASE) or a case file of your "
    "own (FILE.toml); grosmc-mj list names them. The answer comes first and fits on a screen; "
    "--verbose prints all tables.\n\n"
    "Exit codes: 0 done and kept, 1 something is not kept or not as recorded, 2 anything else that "
    "is wrong, 130 interrupted by Ctrl-C or SIGTERM. --debug adds the traceback of an error."
)
