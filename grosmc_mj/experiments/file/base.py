"""What a case file takes from another one: ``extends = "base.toml"``.

Tables are merged key by key, and the file's own values count; everything else, arrays of tables
too, is the file's own or, if it has none, the base's. A file on a system of the package takes the
rest from the base file of that system, so its laws have their numbers everywhere.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from grosmc_mj.errors import ArgumentError, shown
from grosmc_mj.experiments.file.shipped import base_file

Content = dict[str, Any]
_EXTENDS = "extends"
# Files that extend each other, at most.
_DEEPEST = 5


def resolved(text: str, path: Path, read: Callable[[Path], str], above: tuple[Path, ...]) -> str:
    """The text of a case file with all that it takes from others, and without ``extends``.

    Comments stay where no table is merged.

    Args:
        text: The file's own, valid TOML.
        path: The file.
        read: Reads the text of another one, after checking it.
        above: The files that extend this one.

    Raises:
        ArgumentError: If the base cannot be read, lies elsewhere, or extends the file.
    """
    content: Content = tomllib.loads(text)
    if _EXTENDS in content:
        base = _beside(content.pop(_EXTENDS), path)
        if base in (path, *above):
            raise ArgumentError(f"{path}: extends: {base.name} extends this file in turn")
        if len(above) >= _DEEPEST:
            raise ArgumentError(f"{path}: extends: more than {_DEEPEST} files extend each other")
        text = _joined(text, content, resolved(read(base), base, read, (path, *above)))
        content = tomllib.loads(text)
    return with_system_base(text, content)


def with_system_base(text: str, content: Content) -> str:
    """The text with what it does not say from the base file of its system, if there is one."""
    plant = content.get("plant")
    system = plant.get("system") if isinstance(plant, dict) else None
    base = base_file(system) if isinstance(system, str) else None
    return text if base is None else _joined(text, content, base.read_text(encoding="utf-8"))


def _beside(name: Any, path: Path) -> Path:
    """The file that is extended."""
    if not isinstance(name, str) or Path(name).name != name or not name.endswith(".toml"):
        raise ArgumentError(
            f'{path}: extends = {shown(name)} must be a file beside it, such as "base.toml"'
        )
    return path.parent / name


def _merged(base: Content, own: Content) -> Content:
    """Tables key by key; what is no table as the file itself has it."""
    both = dict(base)
    for key, value in own.items():
        known = both.get(key)
        if isinstance(known, dict) and isinstance(value, dict):
            value = _merged(known, value)
        both[key] = value
    return both


def _joined(text: str, content: Content, base: str) -> str:
    """One text of a file and its base."""
    # A name is nobody else's: results are kept under it.
    shared = {key: value for key, value in tomllib.loads(base).items() if key != "name"}
    wanted = _merged(shared, content)
    if wanted == tomllib.loads(text):
        return text
    (head, *own), (_, *others) = _sections(text), _sections(base)
    kept = [line for line in head[1].splitlines() if not line.startswith(_EXTENDS)]
    named = {name for name, _ in own}
    more = [section for name, section in others if name not in named]
    joined = "\n\n".join(part.strip() for part in ("\n".join(kept), *more, *(s for _, s in own)))
    joined = joined.lstrip() + "\n"
    try:
        if tomllib.loads(joined) == wanted:
            return joined
    except ValueError:
        pass
    return _written(wanted)


def _sections(text: str) -> list[tuple[str, str]]:
    """A text's tables by their headers, each with the comments above it; first what has none."""
    found: list[tuple[str, list[str]]] = [("", [])]
    for line in text.splitlines():
        if line.startswith("["):
            last, above = found[-1][1], []
            while last and last[-1].startswith("#"):
                above.insert(0, last.pop())
            found.append((line.split("#")[0].strip(), above))
        found[-1][1].append(line)
    return [(name, "\n".join(lines)) for name, lines in found]


def _written(content: Content) -> str:
    """Plain values as TOML."""
    blocks = [[f"{_value(key)} = {_value(value)}" for key, value in _plain(content)]]
    for key, value in content.items():
        rows = value if _is_tables(value) else [value] if isinstance(value, dict) else []
        header = f"[[{_value(key)}]]" if isinstance(value, list) else f"[{_value(key)}]"
        blocks += [
            [header, *(f"{_value(k)} = {_value(v)}" for k, v in row.items())] for row in rows
        ]
    return "\n\n".join("\n".join(lines) for lines in blocks if lines) + "\n"


def _plain(content: Content) -> list[tuple[str, Any]]:
    return [(k, v) for k, v in content.items() if not isinstance(v, dict) and not _is_tables(v)]


def _is_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(row, dict) for row in value)


def _value(value: Any) -> str:
    """One value of TOML; a text as a key is the same."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{_value(k)} = {_value(v)}' for k, v in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return str(value)
