"""Links from pages to files of the repository outside docs/ work on the site, as they do on GitHub.

What is linked becomes a part of the site, below ``repository/``: Markdown as a page, images as they
are, anything else as a page of numbered lines. Places on the map of equations and in the
architecture become links to their lines.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[2]
WITHIN = "repository"
LISTED = {".py": "python", ".toml": "toml", ".xml": "xml", ".json": "json"}
# Pages that name places in the code.
WITH_PLACES = ("map.md", "architecture.md")
# On pages of the site that are not below docs/.
OUTSIDE = ("CHANGELOG.md", "CONTRIBUTING.md", "measured/README.md")

# A target of [text](target#anchor); a place, `file::name`, as it is written and shown.
_TARGET = re.compile(r"(?<=\]\()(?P<path>[^()\s#:]+)(?P<anchor>#[^()\s]*)?(?=\))")
_NAMED = r"(?P<path>[\w/]+\.(?:py|xml))(?:::(?P<name>\w+))?"
_PLACE, _SHOWN = re.compile(f"`{_NAMED}`"), re.compile(f"<code>{_NAMED}</code>")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what the pages link to outside docs/."""
    found: set[str] = set(OUTSIDE)
    for file in files.documentation_pages():
        text = file.content_string
        found.update(filter(None, (_repository_path(file.src_uri, m["path"]) for m in links(text))))
        if file.src_uri in WITH_PLACES:
            found.update(filter(None, (place_of(m["path"]) for m in _PLACE.finditer(text))))
    for path in sorted(found):
        files.append(_file_of(path, config))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lead a page's links to where the site has their targets."""
    here = page.file.src_uri
    if here.startswith(f"{WITHIN}/") and here.removeprefix(f"{WITHIN}/") not in OUTSIDE:
        return markdown

    def target(match: re.Match[str]) -> str:
        path = _repository_path(here, match["path"])
        if path is None:
            return match[0]
        return _relative(here, path) + (match["anchor"] or "")

    return _TARGET.sub(target, markdown)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lead the places on the map and in the architecture to their lines."""
    if page.file.src_uri not in WITH_PLACES:
        return html

    def place(match: re.Match[str]) -> str:
        path = place_of(match["path"])
        listing = path and files.get_file_from_path(_on_site(path))
        if not path or not listing:
            return match[0]
        line = line_of((ROOT / path).read_text(encoding="utf-8"), match["name"] or "")
        return f'<a href="{listing.url_relative_to(page.file)}#{_anchor(line)}">{match[0]}</a>'

    return _SHOWN.sub(place, html)


def links(text: str) -> list[re.Match[str]]:
    """The relative targets of a page's links."""
    return list(_TARGET.finditer(text))


def place_of(path: str) -> str | None:
    """The file of the repository that a place names, or None if there is none."""
    tried = (posixpath.join(folder, path) for folder in ("grosmc_mj", "tests", ""))
    return next((each for each in tried if (ROOT / each).is_file()), None)


def line_of(text: str, name: str) -> int:
    """Number of the line that defines a name, from one; of the first line without a name."""
    defined = re.compile(rf"^ *(?:(?:def|class) {name}\b)|^{name}\b")
    lines = enumerate(text.splitlines(), start=1)
    return next((number for number, line in lines if name and defined.match(line)), 1)


def _anchor(line: int) -> str:
    return f"__codelineno-0-{line}"


def _repository_path(page: str, target: str) -> str | None:
    """The file that a page's link leads to, from the top of the repository.

    Args:
        page: The page on the site.
        target: Relative, as it stands on the page.
    Returns:
        None if it is no file of the repository, or stays within docs/.
    """
    outside = page.startswith(f"{WITHIN}/")
    where = page.removeprefix(f"{WITHIN}/") if outside else f"docs/{page}"
    path = posixpath.normpath(posixpath.join(posixpath.dirname(where), target))
    if path.startswith("../") or not (ROOT / path).is_file():
        return None
    return path if outside or not path.startswith("docs/") else None


def _relative(page: str, path: str) -> str:
    """The target of a link from a page of the site to a file of the repository."""
    return posixpath.relpath(_on_site(path), posixpath.dirname(page) or ".")


def _on_site(path: str) -> str:
    """Where the site has a file of the repository."""
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    suffix = ".md" if Path(path).suffix in LISTED else ""
    return f"{WITHIN}/{path}{suffix}"


def _file_of(path: str, config: MkDocsConfig) -> File:
    """A file of the repository for the site."""
    language = LISTED.get(Path(path).suffix)
    if language is None:
        return File.generated(config, _on_site(path), abs_src_path=str(ROOT / path))
    return File.generated(config, _on_site(path), content=_listing(path, language))


def _listing(path: str, language: str) -> str:
    """A page that shows a file with the numbers of its lines, and that the search leaves out."""
    text = (ROOT / path).read_text(encoding="utf-8").rstrip()
    head = f"---\ntitle: {path}\nsearch:\n  exclude: true\n---\n\n# {path}\n\n"
    return f'{head}````{language} linenums="1"\n{text}\n````\n'
