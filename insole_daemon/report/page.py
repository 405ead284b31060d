"""Build an HTML page in one file: no scripts, no external resources, light or dark mode as the reader prefers."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from html import escape

from .. import __version__
from ..extras import extra_of, install_command
from . import figure_files
from .colours import LIGHT

_STYLE = (
    f"""
:root {{ {" ".join(f"--{name}: {colour};" for name, colour in LIGHT.items())} }}
{figure_files.STYLE}"""
    """
@media (prefers-color-scheme: dark) {
  :root { --paper: #12161c; --ink: #e4e9f0; --soft: #9aa6b5; --rule: #2c3541; --quiet: #55606f; --panel: #1a2029;
    --c0: #5ab4ee; --c1: #ff8f4a; --c2: #2fcfa0; --c3: #e59ac4; --c4: #8fd0f5; --c5: #f5b942; }
}
body { margin: 0; background: var(--paper); color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }
main { max-width: 1080px; margin: 0 auto; padding: 24px 20px 64px; }
h1 { font-size: 1.7em; margin: 0 0 .2em; } h2 { font-size: 1.2em; margin: 2em 0 .4em; }
p, li { margin: .4em 0 .8em; max-width: 72ch; } .lead { color: var(--soft); }
figure { margin: 0; padding: 12px; background: var(--panel); border: 1px solid var(--rule); border-radius: 8px; }
section > figure + figure { margin-top: 16px; }
figure { overflow-x: auto; } figcaption { color: var(--soft); font-size: .88em; margin-top: 6px; }
.row { display: grid; gap: 16px; margin: 12px 0; }
.row { grid-template-columns: repeat(auto-fit, minmax(min(100%, 506px), 1fr)); }
.facts { display: flex; flex-wrap: wrap; gap: 10px; margin: 16px 0; }
.facts div { background: var(--panel); border: 1px solid var(--rule); border-radius: 8px; padding: 8px 14px; }
.facts b { display: block; font-size: 1.3em; } .facts span { color: var(--soft); font-size: .86em; }
.wide { overflow-x: auto; } table { border-collapse: collapse; font-size: .9em; font-variant-numeric: tabular-nums; }
th, td { padding: 4px 10px 4px 0; text-align: right; border-bottom: 1px solid var(--rule); white-space: nowrap; }
th { color: var(--soft); font-weight: 600; white-space: normal; vertical-align: bottom; }
th:first-child, td:first-child { text-align: left; }
td.text, th.text { text-align: left; white-space: normal; }
svg { display: block; } .files { margin: 4px 0 0; font-size: .8em; } a { color: var(--soft); }
footer { margin-top: 3em; border-top: 1px solid var(--rule); color: var(--soft); font-size: .88em; }
@media print { .files { display: none; } figure { break-inside: avoid; } }
dt { font-weight: 600; } dd { margin: 0 0 .6em; color: var(--soft); max-width: 80ch; }
"""
)


def page(title: str, lead: str, parts: Sequence[str], about: Sequence[str] = ()) -> str:
    """Return the whole page; `parts` are HTML, `about` names insole, recording and calibration in the footer."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>\n<body><main>"
        f'<h1>{escape(title)}</h1><p class="lead">{escape(lead)}</p>\n'
        + "\n".join(parts)
        + f"\n{_footer(about)}</main></body></html>\n"
    )


def _footer(about: Sequence[str]) -> str:
    words = [f"insole-daemon {__version__}", f"written {time.strftime('%Y-%m-%d')}", *about]
    extra = None if figure_files.has_pdf() else extra_of(figure_files.PDF_PACKAGE)
    missing = "" if extra is None else paragraph(f"Figures are here as PDF, too, after: {install_command(extra)}")
    return f"<footer>{paragraph('; '.join(words))}{missing}</footer>"


def insole_label(foot: str, boards: Iterable[int]) -> str:
    """Return a label of the insole for the footer: its foot and the addresses of its boards."""
    return f"{foot}: boards {', '.join(map(str, sorted(set(boards))))}"


def section(heading: str, *parts: str) -> str:
    """Return a heading with HTML below it."""
    return f"<section><h2>{escape(heading)}</h2>{''.join(parts)}</section>"


def paragraph(text: str) -> str:
    """Return plain text as a paragraph."""
    return f"<p>{escape(text)}</p>"


def items(texts: Iterable[str]) -> str:
    """Return plain texts as a list."""
    return f"<ul>{''.join(f'<li>{escape(text)}</li>' for text in texts)}</ul>"


def figure(svg: str, caption: str) -> str:
    """Return drawings with a caption, and links to each as a file."""
    files = figure_files.download_links(svg)
    return f"<figure>{svg}<figcaption>{escape(caption)}</figcaption>{files}</figure>"


def row(*figures: str) -> str:
    """Return figures side by side, if there is room."""
    return f'<div class="row">{"".join(figures)}</div>'


def facts(*pairs: tuple[str, str]) -> str:
    """Return large figures, each with its label."""
    return (
        '<div class="facts">'
        + "".join(f"<div><b>{escape(value)}</b><span>{escape(label)}</span></div>" for value, label in pairs)
        + "</div>"
    )


def table(columns: Sequence[str], rows: Sequence[Sequence[str]], text_columns: Sequence[int] = (0,)) -> str:
    """Return a table with a header; `text_columns` are aligned left, the others right."""

    def cells(tag: str, values: Sequence[str]) -> str:
        kinds = (' class="text"' if column in text_columns else "" for column in range(len(values)))
        return "".join(f"<{tag}{kind}>{escape(value)}</{tag}>" for kind, value in zip(kinds, values, strict=True))

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f'<div class="wide"><table><thead><tr>{cells("th", columns)}</tr></thead><tbody>{body}</tbody></table></div>'


def definitions(meanings: dict[str, str]) -> str:
    """Return terms and their meanings as a definition list."""
    return (
        "<dl>" + "".join(f"<dt>{escape(word)}</dt><dd>{escape(text)}</dd>" for word, text in meanings.items()) + "</dl>"
    )
