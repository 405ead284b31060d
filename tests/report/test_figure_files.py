"""Every figure of a page can be saved as SVG and PDF from the page itself."""

from __future__ import annotations

import base64
import importlib.util
import re
import zlib
from concurrent.futures import ThreadPoolExecutor
from xml.etree import ElementTree

import numpy as np

from insole_daemon.report import figure_files, page
from insole_daemon.report.insole_map import value_map, word_map
from insole_daemon.report.plot import Axis, Plot
from insole_daemon.skin.layout import builtin

LAYOUT = builtin("left", (5, 6, 7))
SVG = "{http://www.w3.org/2000/svg}"


def drawing(name: str) -> str:
    if name == "value map":
        return value_map(LAYOUT, np.arange(len(LAYOUT) * 12.0), "kPa", name)
    if name == "word map":
        return word_map(LAYOUT, {0: "healthy", 1: "stuck"}, "healthy", name)
    plot = Plot(Axis("time, s", 0, 1), Axis("f_z, N", 0, 600), 480, 200)
    plot.line(np.array([0.0, 1.0]), np.array([0.0, 600.0]), 5, "σ − 10⁻²")
    plot.band(np.array([0.0, 1.0]), np.zeros(2), np.ones(2), 1)
    return plot.svg(name)


def files(html: str) -> dict[str, bytes]:
    links = re.findall(r'<a download="([^"]+)" href="data:[a-z/+]+;base64,([^"]+)"', html)
    return {name: base64.b64decode(content, validate=True) for name, content in links}


def test_each_drawing_of_a_figure_is_linked_as_svg_and_pdf() -> None:
    html = page.figure(drawing("load & time") + drawing("error, left foot"), "caption")
    assert list(files(html)) == [
        "load-time.svg", "load-time.pdf", "error-left-foot.svg", "error-left-foot.pdf",
    ]  # fmt: skip


def test_a_standalone_svg_has_its_own_style() -> None:
    for name in ("plot", "value map", "word map"):
        alone = files(page.figure(drawing(name), ""))[f"{name.replace(' ', '-')}.svg"].decode()
        root = ElementTree.fromstring(alone)
        assert "var(" not in alone, "few programs know variables of CSS"
        style = root.findtext(f"{SVG}style") or ""
        for used in {part for element in root.iter() for part in element.attrib.get("class", "").split()} - {"map"}:
            assert f".{used} {{" in style, f"{name}: nothing says how .{used} looks"


def test_a_pdf_is_one_page_of_the_drawings_size_with_text() -> None:
    for name in ("plot", "value map", "word map"):
        svg = figure_files.standalone(drawing(name))
        pdf = figure_files.to_pdf(svg)
        assert pdf.startswith(b"%PDF-")
        assert b"/CreationDate" not in pdf, "a page of the same results has the same bytes at any time"
        assert len(re.findall(rb"/Type\s*/Page\b", pdf)) == 1
        root = ElementTree.fromstring(svg).attrib
        box = re.search(rb"/MediaBox\s*\[([\d. ]+)\]", pdf)
        assert box is not None
        _, _, width, height = map(float, box[1].split())
        assert abs(width / height - float(root["width"]) / float(root["height"])) < 0.01
        assert b"/Font" in pdf
        streams = re.findall(rb"stream\r?\n(.*?)endstream", pdf, re.DOTALL)
        drawn = b"".join(zlib.decompressobj().decompress(stream) for stream in streams if stream[:1] == b"\x78")
        assert b"Tf" in drawn, "text, not outlines of letters"
        assert not re.search(rb"/Subtype\s*/Image", pdf), "no pixels"


def test_figures_are_the_same_bytes_in_any_thread_and_in_any_order() -> None:
    drawings = [figure_files.standalone(drawing(name)) for name in ("plot", "value map", "word map")]
    expected = [figure_files.to_pdf(svg) for svg in drawings]
    with ThreadPoolExecutor(3) as threads:
        assert list(threads.map(figure_files.to_pdf, drawings[::-1] * 3)) == expected[::-1] * 3


def test_without_typst_a_page_has_svg_only_and_states_the_remedy(monkeypatch) -> None:
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "typst" else find_spec(name))
    assert list(files(page.figure(drawing("plot"), ""))) == ["plot.svg"]
    footer = page.page("title", "lead", []).partition("<footer>")[2]
    assert re.search(r"PDF.*install lab|PDF.*insole-daemon\[lab\]", footer)


def test_a_footer_has_version_date_insole_and_calibration() -> None:
    about = [page.insole_label("left", (7, 5, 5, 6)), "calibration mine.json"]
    footer = page.page("title", "lead", [], about).partition("<footer>")[2]
    assert re.search(
        r"insole-daemon [\d.]+\S*; written \d{4}-\d\d-\d\d; left: boards 5, 6, 7; calibration mine", footer
    )
    assert "PDF" not in footer
