"""Texts of case files: one with all that a file takes from others, and of written content."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from grosmc_mj.experiments.file.content import EXTENDS, layers_of, read_content, read_text

# A list of plain values over several lines, and what separates them.
_LIST = re.compile(r"\[\n((?: +[^\[\]{}\n]+,\n)+)\]")
_SEPARATOR = re.compile(r",\n *")
# Longest list that is written in one line.
_WIDTH = 80


def text_of(content: Mapping[str, Any]) -> str:
    """Return the text of content that a program has made, with short lists in one line."""
    return _LIST.sub(_in_one_line, tomli_w.dumps(content))


def _in_one_line(match: re.Match[str]) -> str:
    """A list in one line; as it is if that is too long."""
    values = _SEPARATOR.sub(", ", match[1].strip().removesuffix(","))
    return f"[{values}]" if len(values) <= _WIDTH else match[0]


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
    return text_of(content)


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
