"""Commands and options of earlier versions, and what takes their place."""

from __future__ import annotations

from collections.abc import Sequence

# A command, and the advice that follows its name.
_COMMANDS = {
    "doctor": "film says what a machine lacks for films, and which command installs it",
}

# A command and one of its options, and the advice that follows their names.
_OPTIONS = {
    ("view", "--replay"): "view runs the case as you watch, and film shows a recorded run",
}


def advice_on_removed(words: Sequence[str]) -> str:
    """Return one line about the first word that was a command or an option; empty if none was.

    Args:
        words: The arguments of the program.
    """
    command = words[0]
    if command in _COMMANDS:
        return f"the command {command} was removed: {_COMMANDS[command]}"

    for word in words[1:]:
        option = word.partition("=")[0]
        if (command, option) in _OPTIONS:
            return f"{option} of {command} was removed: {_OPTIONS[command, option]}"
    return ""
