"""One text of a case file and the files that it takes from, with their comments."""

from __future__ import annotations

import tomllib
from pathlib import Path

import tomli_w

from grosmc_mj.experiments.file.content import EXTENDS, layers_of, read_content, read_text


def complete_text(path: Path) -> str:
    """Return the text of a case file with all that it takes from other files.

    Comments are kept unless a table stands in several of the files.

    Raises:
        ArgumentError: If one of the files cannot be read, is no TOML, lies elsewhere, or extends
            itself.
    """
    content = read_content(path)
    text = ""
    for file in reversed(layers_of(path)):
        text = _joined(read_text(file), text)
    try:
        if tomllib.loads(text) == content:
            return text
    # A table that stands in two of the texts is no valid TOML.
    except ValueError:
        pass
    return tomli_w.dumps(content)


def _joined(text: str, base: str) -> str:
    """Return the text with the tables of the base that it does not have."""
    (_, top), *sections = _sections(text)
    headers = [header for header, _ in sections]
    top_lines = [line for line in top.splitlines() if not line.startswith(EXTENDS)]

    parts = ["\n".join(top_lines)]
    parts += [section for header, section in _sections(base)[1:] if header not in headers]
    parts += [section for _, section in sections]
    parts = [part.strip() for part in parts]
    return "\n\n".join(filter(None, parts)) + "\n"


def _sections(text: str) -> list[tuple[str, str]]:
    """Split a text into headers and tables with the comments above; the first has no header."""
    sections: list[tuple[str, list[str]]] = [("", [])]
    for line in text.splitlines():
        if line.startswith("["):
            previous = sections[-1][1]
            comments: list[str] = []
            while previous and previous[-1].startswith("#"):
                comments.insert(0, previous.pop())
            header = line.split("#")[0].strip()
            sections.append((header, comments))
        sections[-1][1].append(line)
    return [(header, "\n".join(lines)) for header, lines in sections]
