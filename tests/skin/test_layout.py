from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from insole_daemon.errors import DocumentError
from insole_daemon.skin import geometry
from insole_daemon.skin.geometry import NEIGHBOUR_MM, PRESSURE_TAXELS, place_points
from insole_daemon.skin.layout import OUTLINE_MM, Foot, Layout, builtin, load

EXAMPLES = Path(__file__).parents[1] / "data" / "examples"
HEAD = "format: insole-layout/1\nfoot: left\ntaxel_area_mm2: 32.4\ntriangles:\n"
GOOD = (
    "  - {board: 5, triangle: 0, patch: front, x_mm: 200, y_mm: -10.5, rotation_deg: 180, mirrored: false}\n"
    "  - {board: 6, triangle: 15, patch: middle, x_mm: 120, y_mm: 20, rotation_deg: 0}\n"
)

Write = Callable[[str], Path]
FEET: list[Foot] = ["left", "right"]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(text: str) -> Path:
        path = tmp_path / "layout.yaml"
        path.write_text(text)
        return path

    return write


def triangle(board: int = 7, triangle: int = 3, x_mm: object = 10, more: str = "") -> str:
    rest = f"patch: rear, x_mm: {x_mm}, y_mm: 0, rotation_deg: 0{more}"
    return f"  - {{board: {board}, triangle: {triangle}, {rest}}}\n"


def problems(path: Path, **expected: object) -> list[tuple[int | None, str, str]]:
    with pytest.raises(DocumentError) as caught:
        load(path, **expected)  # type: ignore[arg-type]
    return [(problem.line, problem.key, problem.message) for problem in caught.value.problems]


def only(path: Path, **expected: object) -> tuple[int | None, str, str]:
    (problem,) = problems(path, **expected)
    return problem


def test_load(write: Write) -> None:
    layout = load(write(HEAD + GOOD), foot="left", addresses=(5, 6, 7))
    assert (layout.foot, layout.area_meaning, layout.builtin, len(layout)) == ("left", None, False, 2)
    assert layout.taxel_area_m2 == pytest.approx(32.4e-6)
    assert layout.xy_m.shape == (2, 12, 2)
    assert layout.xy_m.dtype == np.float64
    np.testing.assert_allclose(layout.xy_m[:, 3], [[0.2, -0.0105], [0.12, 0.02]])
    np.testing.assert_allclose(layout.xy_m[0, 0], [0.2 - 0.006533, -0.0105], atol=1e-12)
    assert layout.rows == {(5, 0): 0, (6, 15): 1}
    assert layout.identities.tolist() == [[5, 0], [6, 15]]
    assert (layout.triangles[0].patch, layout.triangles[1].mirrored) == ("front", False)
    assert not layout.xy_m.flags.writeable


def test_extensions_are_kept(write: Write) -> None:
    layout = load(write(HEAD + triangle(more=", extensions: {a: 1}") + "area_meaning: text\nextensions: {b: 2}\n"))
    assert (layout.extensions, layout.triangles[0].extensions) == ({"b": 2}, {"a": 1})
    assert layout.area_meaning == "text"


def test_mirrored_flips_x(write: Write) -> None:
    layout = load(write(HEAD + triangle(x_mm=0, more=", mirrored: true")))
    np.testing.assert_allclose(layout.xy_m[0, 0], [-0.006533, 0])


def test_a_triangle_twice(write: Write) -> None:
    line, key, message = only(write(HEAD + GOOD + triangle() + triangle(x_mm=90)))
    assert (line, key) == (8, "triangles[3]")
    assert message == "triangle 3 of board 7 is listed twice, first in triangles[2]"


def test_the_same_number_on_another_board_is_another_triangle(write: Write) -> None:
    assert len(load(write(HEAD + GOOD + triangle(7, 3) + triangle(6, 3)))) == 4


@pytest.mark.parametrize(
    ("text", "key", "message"),
    [
        (triangle(triangle=16), "triangle", "from 0 to 15, found 16"),
        (triangle(board=0), "board", "from 1 to 14, found 0"),
        (triangle(x_mm=".nan"), "x_mm", "found nan"),
        (triangle(x_mm=501), "x_mm", "from -500 to 500, found 501"),
        (triangle(x_mm="ten"), "x_mm", 'found the text "ten"'),
        (
            triangle().replace("x_mm", "x_m"),
            "x_m",
            'did you mean "x_mm"? The unit is part of the name: give it in mm',
        ),
        (triangle().replace("rotation_deg", "rotation"), "rotation", "give it in deg"),
        (triangle(more=", mirored: true"), "mirored", 'did you mean "mirrored"?'),
        (triangle(more=", mirrored: 1"), "mirrored", "expected true or false, found 1"),
        (triangle().replace(", patch: rear", ""), "patch", "missing key: expected text"),
    ],
)
def test_wrong_triangles(write: Write, text: str, key: str, message: str) -> None:
    line, found_key, text_found = only(write(HEAD + GOOD + text))
    assert (line, found_key) == (7, f"triangles[2].{key}")
    assert message in text_found


@pytest.mark.parametrize("area", ["32.4e-6", "0", "324"])
def test_an_area_in_another_unit(write: Write, area: str) -> None:
    line, key, message = only(write(HEAD.replace("32.4", area) + GOOD))
    assert (line, key) == (3, "taxel_area_mm2")
    assert "expected a finite number from 1 to 200" in message


@pytest.mark.parametrize("factor", [1e-3, 1 / 25.4])
def test_metres_or_inches_are_noticed(write: Write, factor: float) -> None:
    line, key, message = only(write(HEAD + triangle(x_mm=20 * factor) + triangle(triangle=4, x_mm=250 * factor)))
    assert (line, key) == (4, "triangles")
    assert "are these metres" in message


def test_one_triangle_has_no_span(write: Write) -> None:
    assert len(load(write(HEAD + triangle()))) == 1


def test_the_other_foot(write: Write) -> None:
    line, key, message = only(write(HEAD + GOOD), foot="right")
    assert (line, key) == (2, "foot")
    assert message == "expected the layout of the right foot, found that of the left foot"


def test_boards_that_the_insole_does_not_have(write: Write) -> None:
    text = HEAD + GOOD + triangle(9, 0) + triangle(9, 1)
    line, key, message = only(write(text), addresses=(5, 6, 7))
    assert (line, key) == (7, "triangles[2].board")
    assert message == "board 9 is not one of this insole's boards, which are: 5, 6, 7"


def test_another_version(write: Write) -> None:
    line, key, message = only(write(HEAD.replace("/1", "/2") + GOOD))
    assert (line, key) == (1, "format")
    assert "expected insole-layout/1, found insole-layout/2" in message


def test_everything_at_once(write: Write) -> None:
    text = HEAD.replace("foot: left", "foot: right") + GOOD + triangle(x_mm=".inf") + GOOD + triangle(8, 16)
    places = [(line, key) for line, key, _ in problems(write(text), foot="left", addresses=(5, 7))]
    assert places == [
        (2, "foot"),
        (6, "triangles[1].board"),
        (7, "triangles[2].x_mm"),
        (8, "triangles[3]"),
        (9, "triangles[4]"),
        (10, "triangles[5].triangle"),
    ]


@pytest.mark.parametrize("kind", ["chamber", "shoe"])
def test_examples(kind: str) -> None:
    layout = load(EXAMPLES / kind / "layout.yaml", foot="left", addresses=(5, 6, 7))
    assert layout.xy_m.shape == (28, 12, 2)


# ---- the built-in layout


def corners_m(layout: Layout, points_mm: NDArray[np.float64] = geometry.OUTLINE_MM) -> NDArray[np.float64]:
    """(n, k, 2) of every triangle."""
    t = layout.triangles
    return place_points(points_mm, [(a.x_mm, a.y_mm) for a in t], [a.rotation_deg for a in t], [a.mirrored for a in t])


def gap_m(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Widest strip between two triangles along any of their edges; negative if they overlap."""
    widest = -np.inf
    for corners in (one, other):
        for edge in np.roll(corners, -1, axis=0) - corners:
            normal = np.array([edge[1], -edge[0]]) / np.hypot(*edge)
            a, b = one @ normal, other @ normal
            widest = max(widest, b.min() - a.max(), a.min() - b.max())
    return widest


def inside(points: NDArray[np.float64], outline: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(k,) bool: whether a ray along +x from each point crosses the outline an odd number of times."""
    odd = np.zeros(len(points), bool)
    for (x1, y1), (x2, y2) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        spans = (y1 > points[:, 1]) != (y2 > points[:, 1])
        if y1 != y2:
            odd ^= spans & (points[:, 0] < x1 + (x2 - x1) * (points[:, 1] - y1) / (y2 - y1))
    return odd


@pytest.mark.parametrize("foot", FEET)
def test_built_in_counts(foot: Foot) -> None:
    layout = builtin(foot, (11, 2, 7))
    assert (layout.foot, layout.builtin, len(layout)) == (foot, True, 28)
    assert layout.taxel_area_m2 == pytest.approx(32.4e-6)
    assert layout.area_meaning == "triangle/10"
    assert len(layout.rows) == 28
    patches = [(t.board, t.patch) for t in layout.triangles]
    assert [patches.count(p) for p in ((11, "front"), (2, "middle"), (7, "rear"))] == [12, 5, 11]
    for board in (11, 2, 7):  # sparse, and in ascending order, as the boards send them
        numbers = [t.triangle for t in layout.triangles if t.board == board]
        assert numbers == sorted(numbers) != list(range(len(numbers)))
        assert 0 <= numbers[0] <= numbers[-1] <= 15
    assert not any(t.mirrored for t in layout.triangles)


@pytest.mark.parametrize("foot", FEET)
def test_built_in_triangles_do_not_overlap(foot: Foot) -> None:
    assert min(gap_m(a, b) for a, b in combinations(corners_m(builtin(foot, (5, 6, 7))), 2)) > 0.5e-3


def test_overlap_is_noticed() -> None:
    corners = geometry.OUTLINE_MM * 1e-3
    assert gap_m(corners, corners + np.array([0.0, 0.020])) < 0
    assert gap_m(corners, corners + np.array([0.0, 0.025])) > 0


@pytest.mark.parametrize("foot", FEET)
def test_built_in_triangles_lie_in_the_foot(foot: Foot) -> None:
    outline = OUTLINE_MM * 1e-3 * ([1, 1] if foot == "left" else [1, -1])
    steps = np.linspace(0, 1, 12)[:, None]
    edges = np.concatenate(
        [a + (b - a) * steps for a, b in combinations(geometry.OUTLINE_MM, 2)]  # all three edges of a triangle
    )
    assert inside(corners_m(builtin(foot, (5, 6, 7)), edges).reshape(-1, 2), outline).all()


def test_built_in_foot_is_plausible() -> None:
    xy_m = builtin("left", (5, 6, 7)).xy_m
    assert 0.0 < xy_m[..., 0].min() < 0.02  # heel
    assert 0.24 < xy_m[..., 0].max() < 0.26  # toes
    midfoot = xy_m[(xy_m[..., 0] > 0.11) & (xy_m[..., 0] < 0.15)]
    assert midfoot[:, 1].mean() > 0  # the arch is medial: y < 0 on the left foot
    toes = xy_m[xy_m[..., 0] > 0.23]
    assert toes[:, 1].mean() < 0  # so is the big toe


def test_patches_are_tilings() -> None:
    layout = builtin("left", (5, 6, 7))
    for board in (5, 6, 7):
        centres = np.array([(t.x_mm, t.y_mm) for t in layout.triangles if t.board == board])
        distance = np.linalg.norm(centres[:, None] - centres, axis=-1) + 1e9 * np.eye(len(centres))
        np.testing.assert_allclose(distance.min(axis=1), NEIGHBOUR_MM, atol=2e-3)


def test_right_foot_mirrors_the_left() -> None:
    left, right = builtin("left", (5, 6, 7)), builtin("right", (5, 6, 7))
    flip = [1, -1]
    np.testing.assert_allclose(right.xy_m[:, 3], left.xy_m[:, 3] * flip, atol=1e-9)
    for a, b in zip(left.xy_m * flip, right.xy_m, strict=True):  # the places of taxels, in another order
        distance = np.linalg.norm(a[PRESSURE_TAXELS][:, None] - b[PRESSURE_TAXELS], axis=-1)
        np.testing.assert_allclose(distance.min(axis=0), 0, atol=1e-9)
        np.testing.assert_allclose(distance.min(axis=1), 0, atol=1e-9)


@pytest.mark.parametrize("foot", FEET)
def test_handedness_is_the_same_on_both_feet(foot: Foot) -> None:
    xy = builtin(foot, (5, 6, 7)).xy_m
    tip, corner = xy[:, 9] - xy[:, 3], xy[:, 1] - xy[:, 3]
    assert (tip[:, 0] * corner[:, 1] - tip[:, 1] * corner[:, 0] < 0).all()


def test_a_span_is_along_one_axis(write: Write) -> None:
    """Far from the origin, and next to each other all the same."""
    line, key, message = only(write(HEAD + triangle(x_mm=200) + triangle(triangle=4, x_mm=200.2)))
    assert (line, key) == (4, "triangles")
    assert "within 0.2 mm" in message
    assert len(load(write(HEAD + triangle(x_mm=0) + triangle(triangle=4, x_mm=50)))) == 2, "50 mm are enough"


def test_triangles_of_the_built_in_layout_point_up_or_down_their_rows() -> None:
    for foot, addresses in (("left", (5, 6, 7)), ("right", (8, 9, 10))):
        layout = builtin(foot, addresses)
        rotations = {
            patch: {t.rotation_deg for t in layout.triangles if t.patch == patch}
            for patch in ("front", "middle", "rear")
        }
        assert rotations == {"front": {0.0, 180.0}, "middle": {90.0, 270.0}, "rear": {0.0, 180.0}}
        assert all(t.x_mm == round(t.x_mm, 3) and t.y_mm == round(t.y_mm, 3) for t in layout.triangles), "micrometres"
