"""Convert the drawings of a page to files: SVG for any program, and PDF for a paper or a talk."""

from __future__ import annotations

import importlib.util
import re
import threading
from base64 import b64encode
from dataclasses import dataclass
from html import escape, unescape
from typing import Any

from .colours import CATEGORIES, LIGHT

# Style of drawings on a page and in files. A page redefines the variables for dark mode.
STYLE = """\
svg { font-family: system-ui, "DejaVu Sans", "Liberation Sans", sans-serif; font-size: 12px; fill: var(--ink); }
.tick { font-size: 11px; fill: var(--soft); }
.frame { fill: none; stroke: var(--quiet); } .grid { stroke: var(--rule); fill: none; }
"""
_LITERAL = LIGHT | {f"c{number}": colour for number, colour in enumerate(CATEGORIES)}
_ONE_PAGE = b"""\
#set document(date: none)
#set page(width: auto, height: auto, margin: 0pt)
#image(bytes(sys.inputs.drawing), format: "svg")
"""
PDF_PACKAGE = "typst"
_of_thread = threading.local()


@dataclass(frozen=True, slots=True)
class Drawing:
    """A drawing for display in a notebook."""

    svg: str

    def _repr_svg_(self) -> str:
        return standalone(self.svg)


def download_links(drawings: str) -> str:
    """Return HTML links that contain each SVG in `drawings` as a file, and as PDF if `has_pdf()`."""
    links = []
    for svg in re.findall(r"<svg .*?</svg>", drawings, re.DOTALL):
        title = re.search(r"<title>(.*?)</title>", svg)
        name = re.sub(r"\W+", "-", unescape(title[1]) if title else "figure", flags=re.ASCII).strip("-").lower()
        file_svg = standalone(svg)
        links.append(_link(f"{name}.svg", "image/svg+xml", file_svg.encode()))
        if has_pdf():
            links.append(_link(f"{name}.pdf", "application/pdf", to_pdf(file_svg)))
    return f'<p class="files">{" ".join(links)}</p>' if links else ""


def standalone(svg: str) -> str:
    """Return `svg` with its style included, in light colours, and without CSS variables, which few programs support."""
    opened = svg.index(">") + 1
    styled = f"{svg[:opened]}<style>{STYLE}</style>{svg[opened:]}"
    return re.sub(r"var\(--(\w+)[^)]*\)", lambda match: _LITERAL[match[1]], styled)


def has_pdf() -> bool:
    """Return whether the package that converts SVG to PDF is installed."""
    return importlib.util.find_spec(PDF_PACKAGE) is not None


def to_pdf(svg: str) -> bytes:
    """Return a standalone SVG as a PDF of one page, with text as text; the same SVG always gives the same bytes."""
    document: bytes = _compiler().compile(_ONE_PAGE, sys_inputs={"drawing": svg})
    return document


def _compiler() -> Any:
    """Return the compiler of this thread: it searches the fonts once, which takes twice as long as a figure."""
    import typst

    if not hasattr(_of_thread, "compiler"):
        _of_thread.compiler = typst.Compiler()
    return _of_thread.compiler


def _link(name: str, kind: str, content: bytes) -> str:
    data = b64encode(content).decode()
    return f'<a download="{escape(name)}" href="data:{kind};base64,{data}">{name.rpartition(".")[2].upper()}</a>'
