"""Drawings are well-formed, keep the essential data, and need no external resources."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from insole_daemon.report import page
from insole_daemon.report.colours import magnitude
from insole_daemon.report.foot_outline import foot_outline_mm
from insole_daemon.report.insole_map import value_map, word_map
from insole_daemon.report.plot import Axis, Plot, axis
from insole_daemon.skin.layout import builtin

LAYOUT = builtin("left", (5, 6, 7))
SVG = "{http://www.w3.org/2000/svg}"


def paths(svg: str) -> list[str]:
    """Return the path data of what is drawn inside the axes."""
    inside = next(g for g in ElementTree.fromstring(svg).iter(f"{SVG}g") if "clip-path" in g.attrib)
    return [path.attrib["d"] for path in inside.iter(f"{SVG}path")]


def points(path: str) -> np.ndarray:
    return np.array([[float(n) for n in part.split()] for part in re.findall(r"[ML]([^ML]+)", path)])


def test_a_line_is_placed_by_its_axes() -> None:
    plot = Plot(Axis("x", 0.0, 10.0), Axis("y", 0.0, 100.0))
    plot.line(np.array([0.0, 10.0]), np.array([0.0, 100.0]), name="a & b")
    svg = plot.svg("rising")
    (low, high) = points(paths(svg)[0])
    frame = next(r for r in ElementTree.fromstring(svg).iter(f"{SVG}rect") if r.attrib.get("class") == "frame").attrib
    x, y, wide, tall = (float(frame[name]) for name in ("x", "y", "width", "height"))
    assert low.tolist() == [x, y + tall]
    assert high.tolist() == [x + wide, y]
    assert "a &amp; b" in svg


def test_a_shape_to_scale_keeps_its_angles() -> None:
    plot = Plot.to_scale(Axis("x", -20.0, 40.0), Axis("y", 0.0, 300.0), height=620)
    plot.outline(np.array([0.0, 10.0, 0.0]), np.array([0.0, 10.0, 20.0]))
    drawn = points(paths(plot.svg("triangle"))[0].rstrip("Z"))
    sides = np.linalg.norm(np.diff(drawn, axis=0, append=drawn[:1]), axis=1)
    np.testing.assert_allclose(sides / sides[0], [1.0, 1.0, 2**0.5], rtol=0.01)


@pytest.mark.parametrize("width", [320, 1012])
def test_text_size_does_not_depend_on_the_page_width(width: int) -> None:
    svg = ElementTree.fromstring(Plot(Axis("x", 0, 1), Axis("y", 0, 1), width).svg("plot"))
    assert svg.attrib["viewBox"].split()[2] == svg.attrib["width"] == str(width)
    drawn = ElementTree.fromstring(value_map(LAYOUT, np.zeros(len(LAYOUT) * 12), "kPa", "map"))
    assert drawn.attrib["viewBox"].split()[2:] == [drawn.attrib["width"], drawn.attrib["height"]]
    assert "svg { width" not in page.page("title", "lead", [])


def test_a_line_is_interrupted_at_nan() -> None:
    plot = Plot(Axis("x", 0, 4), Axis("y", 0, 4))
    plot.line(np.arange(5.0), np.array([0, 1, np.nan, 3, 4.0]))
    assert paths(plot.svg("gap"))[0].count("M") == 2


def test_a_spike_survives_in_a_line_of_many_points() -> None:
    y = np.zeros(100_000)
    y[54_321] = 1.0
    plot = Plot(Axis("x", 0, len(y)), Axis("y", 0, 1))
    plot.line(np.arange(len(y), dtype=float), y)
    drawn = points(paths(plot.svg("spike"))[0])
    assert len(drawn) < 4000
    assert drawn[:, 1].min() == pytest.approx(10.0), "the top of the frame"


def test_a_band_is_a_closed_area() -> None:
    plot = Plot(Axis("x", 0, 2), Axis("y", 0, 2))
    plot.band(np.arange(3.0), np.zeros(3), np.full(3, 2.0))
    (path,) = paths(plot.svg("band"))
    assert path.endswith("Z")
    assert len(points(path.removesuffix("Z"))) == 6


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0, 10, ["0", "2", "4", "6", "8", "10"]),
        (-1, 1, ["−1.0", "−0.5", "0.0", "0.5", "1.0"]),
        (0, 0.03, ["0.000", "0.005"]),
    ],
)
def test_ticks_are_round(low: float, high: float, expected: list[str]) -> None:
    assert [text for _, text in Axis("", low, high).ticks()][: len(expected)] == expected


def test_a_logarithmic_axis() -> None:
    powers = Axis("", 1e-2, 1.0, logarithmic=True)
    assert [text for _, text in powers.ticks()] == ["10⁻²", "10⁻¹", "10⁰"]
    assert powers.fraction(np.array([0.1])).tolist() == pytest.approx([0.5])


def test_an_axis_contains_its_values() -> None:
    made_axis = axis("y", np.array([1.0, np.nan]), np.array([5.0, np.inf]))
    assert made_axis.low < 1
    assert made_axis.high > 5
    assert axis("y", np.zeros(3)).high > axis("y", np.zeros(3)).low, "also of what never changes"


def test_magnitudes_grow_brighter_step_by_step() -> None:
    def luminance(colour: str) -> float:
        parts = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    steps = np.diff([116 * luminance(magnitude(share)) ** (1 / 3) for share in np.linspace(0, 1, 9)])
    assert steps.min() > 0
    assert steps.max() < 3 * steps.min(), "as much for each step, to the eye"


def test_a_map_shows_pressure_taxels_toes_up() -> None:
    values = np.arange(len(LAYOUT) * 12.0)
    values[0] = np.nan
    svg = ElementTree.fromstring(value_map(LAYOUT, values, "kPa", "values"))
    circles = list(svg.iter(f"{SVG}circle"))
    assert len(circles) == 10 * len(LAYOUT)
    assert sum(c.attrib["fill"] == "none" for c in circles) == 1
    assert len(list(svg.iter(f"{SVG}polygon"))) == len(LAYOUT)
    heights = np.array([float(c.attrib["cy"]) for c in circles])
    x_m = LAYOUT.xy_m[:, [0, 1, 2, 3, 4, 5, 7, 8, 9, 11], 0].ravel()
    assert np.corrcoef(heights, x_m)[0, 1] < -0.999


@pytest.mark.parametrize("foot", ["left", "right"])
def test_the_outline_of_a_foot_encloses_its_taxels(foot) -> None:
    layout = builtin(foot, (5, 6, 7))
    xy_mm = layout.xy_m.reshape(-1, 2) * 1e3
    line = foot_outline_mm(xy_mm)
    steps = np.diff(line, axis=0, append=line[:1])
    assert np.linalg.norm(steps, axis=1).max() < 5.0, "closed"
    ahead = xy_mm[:, None] - line
    turned = np.arctan2(ahead[..., 0], ahead[..., 1])
    winding = np.sum((np.diff(turned, axis=1, append=turned[:, :1]) + np.pi) % (2 * np.pi) - np.pi, axis=1)
    assert np.allclose(np.abs(winding), 2 * np.pi), "every taxel lies inside"
    assert np.linalg.norm(ahead, axis=-1).min(axis=0).max() < 40.0, "near to them, also where patches leave gaps"
    drawn = ElementTree.fromstring(value_map(layout, np.zeros(len(layout) * 12), "kPa", "map"))
    assert len([p for p in drawn.iter(f"{SVG}path") if p.attrib.get("class") == "frame"]) == 1


def test_maps_with_one_scale_share_their_ends() -> None:
    maps = [value_map(LAYOUT, np.full(len(LAYOUT) * 12, value), "kPa", "map", 80.0) for value in (20.0, 80.0)]
    scales = [[t.text for t in ElementTree.fromstring(svg).iter(f"{SVG}text")][:3] for svg in maps]
    assert scales == [["80", "40", "0"]] * 2
    fills = [next(ElementTree.fromstring(svg).iter(f"{SVG}circle")).attrib["fill"] for svg in maps]
    assert fills == [magnitude(0.25), magnitude(1.0)]


def test_a_map_of_words_counts_them() -> None:
    slots = [row * 12 + taxel for row in range(len(LAYOUT)) for taxel in (0, 1, 2, 3, 4, 5, 7, 8, 9, 11)]
    words = dict.fromkeys(slots, "healthy") | {slots[3]: "stuck"}
    svg = word_map(LAYOUT, words, "healthy", "health")
    ElementTree.fromstring(svg)
    assert "healthy 279" in svg
    assert "stuck 1" in svg


def test_a_page_is_self_contained() -> None:
    text = page.page(
        "A <title>", "lead", [
            page.section("x", page.facts(("1 < 2", "a fact")), page.table(("a", "b"), [("<b>", "2")])),
            page.row(page.figure(Plot(Axis("x", 0, 1), Axis("y", 0, 1)).svg("empty"), "caption")),
            page.definitions({"word": "meaning"}), page.paragraph("5 > 3"),
        ],
    )  # fmt: skip
    assert "<title>A &lt;title&gt;</title>" in text
    assert "&lt;b&gt;" in text
    assert "prefers-color-scheme: dark" in text
    outside = re.findall(r"""(?:src|href|url)\s*[=(]\s*["']?(?!#|data:)[a-z]+:""", text)
    assert not outside
    assert "<script" not in text
