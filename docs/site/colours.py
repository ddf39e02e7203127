"""The site has the colours of the figures, in light and in dark."""

from __future__ import annotations

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from grosmc_mj.output import palette


def style() -> str:
    """The style sheet: figures are drawn on white, and stay so on dark pages."""
    return f"""\
:root, [data-md-color-scheme] {{
  --md-primary-fg-color: {palette.BLUE};
  --md-accent-fg-color: {palette.VERMILION};
}}
[data-md-color-scheme="default"] {{
  --md-typeset-a-color: {palette.BLUE};
}}
[data-md-color-scheme="slate"] {{
  --md-hue: 210;
  --md-typeset-a-color: {palette.SKY};
  --md-accent-fg-color: {palette.ORANGE};
}}
.md-grid {{
  max-width: 76rem;
}}
.md-typeset img {{
  background: white;
}}
.md-typeset table:not([class]) {{
  font-size: 0.62rem;
}}
.md-typeset table:not([class]) th, .md-typeset table:not([class]) td {{
  min-width: 0;
  padding: 0.4em 0.7em;
}}
/* Paths and names in a table: on a telephone it scrolls sooner than it breaks them in pieces. */
.md-typeset table:not([class]) td:has(a > code) {{
  min-width: 9.5rem;
}}
"""


def icon() -> str:
    """The site's icon: a trajectory that slides along its optimum."""
    return f"""\
<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32">
<rect width="32" height="32" rx="6" fill="{palette.BLUE}"/>
<path d="M4 25C10 25 11 8 28 8" fill="none" stroke="white" stroke-width="4"/>
<path d="M4 25C12 25 12 3 19 5S25 8 28 8" fill="none" stroke="{palette.ORANGE}" stroke-width="2"/>
</svg>
"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the style sheet and the icon."""
    files.append(File.generated(config, "colours.css", content=style()))
    files.append(File.generated(config, "favicon.svg", content=icon()))
    return files
