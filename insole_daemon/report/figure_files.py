"""The drawings of a page as files of their own: SVG that any program draws, and PDF, for a paper or a talk."""

from __future__ import annotations

import importlib.util
import re
from base64 import b64encode
from dataclasses import dataclass
from html import escape, unescape

from .colours import CATEGORIES, LIGHT

# Of drawings on a page and on their own. A page replaces the variables where its reader wants it dark.
STYLE = """\
svg { font-family: system-ui, "DejaVu Sans", "Liberation Sans", sans-serif; font-size: 12px; fill: var(--ink); }
.tick { font-size: 11px; fill: var(--soft); }
.frame { fill: none; stroke: var(--quiet); } .grid { stroke: var(--rule); fill: none; }
"""
_LITERAL = LIGHT | {f"c{at}": colour for at, colour in enumerate(CATEGORIES)}
_ONE_PAGE = b"""\
#set document(date: none)
#set page(width: auto, height: auto, margin: 0pt)
#image(bytes(sys.inputs.drawing), format: "svg")
"""
PDF_PACKAGE = "typst"


@dataclass(frozen=True, slots=True)
class Drawing:
    """A drawing that a notebook shows."""

    svg: str

    def _repr_svg_(self) -> str:
        return standalone(self.svg)


def download_links(drawings: str) -> str:
    """Return HTML: a link to each SVG in `drawings` as a file, and to its PDF where `has_pdf()`; both in the page."""
    links = []
    for svg in re.findall(r"<svg .*?</svg>", drawings, re.DOTALL):
        title = re.search(r"<title>(.*?)</title>", svg)
        name = re.sub(r"\W+", "-", unescape(title[1]) if title else "figure", flags=re.ASCII).strip("-").lower()
        alone = standalone(svg)
        links.append(_link(f"{name}.svg", "image/svg+xml", alone.encode()))
        if has_pdf():
            links.append(_link(f"{name}.pdf", "application/pdf", to_pdf(alone)))
    return f'<p class="files">{" ".join(links)}</p>' if links else ""


def standalone(svg: str) -> str:
    """Return `svg` with its style in it, in light colours, and without variables, which few programs know."""
    opened = svg.index(">") + 1
    styled = f"{svg[:opened]}<style>{STYLE}</style>{svg[opened:]}"
    return re.sub(r"var\(--(\w+)[^)]*\)", lambda found: _LITERAL[found[1]], styled)


def has_pdf() -> bool:
    """Whether the package is installed that makes PDF of SVG."""
    return importlib.util.find_spec(PDF_PACKAGE) is not None


def to_pdf(svg: str) -> bytes:
    """Return a standalone SVG as a PDF of one page of its size, its letters as text: the same bytes at any time."""
    import typst

    document: bytes = typst.compile(_ONE_PAGE, sys_inputs={"drawing": svg})
    return document


def _link(name: str, kind: str, content: bytes) -> str:
    data = b64encode(content).decode()
    return f'<a download="{escape(name)}" href="data:{kind};base64,{data}">{name.rpartition(".")[2].upper()}</a>'
