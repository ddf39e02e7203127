"""Equations as MathML, which browsers draw without a script or a font from elsewhere."""

from __future__ import annotations

from xml.etree import ElementTree as ET

_MATHML = "http://www.w3.org/1998/Math/MathML"
# What an equation needs; nothing that leads elsewhere or carries a script.
_ATTRIBUTES = (
    "accent", "close", "columnalign", "columnspacing", "display", "displaystyle", "fence", "form",
    "linethickness", "lspace", "mathvariant", "maxsize", "minsize", "movablelimits", "open",
    "rowspacing", "rspace", "scriptlevel", "separator", "stretchy", "symmetric", "width",
)  # fmt: skip
_LONGEST = 2000


def mathml(formula: str) -> str:
    """A formula in LaTeX as MathML, or nothing if it cannot be read."""
    from latex2mathml.converter import convert

    if not formula or len(formula) > _LONGEST:
        return ""
    try:
        root = ET.fromstring(convert(formula, display="block"))
    # A converter of other people's texts has errors of every kind.
    except Exception:
        return ""
    for element in root.iter():
        if not element.tag.startswith(f"{{{_MATHML}}}m"):
            return ""
        element.tag = element.tag.removeprefix(f"{{{_MATHML}}}")
        for name in [attribute for attribute in element.attrib if attribute not in _ATTRIBUTES]:
            del element.attrib[name]
    return ET.tostring(root, encoding="unicode")
