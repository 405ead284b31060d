"""Calibration files: reading, problems, and the default calibration."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insole_daemon.config import Board
from insole_daemon.config import load as load_config
from insole_daemon.errors import DocumentError, InsoleError
from insole_daemon.physics.calibration import default, load, valid_up_to
from insole_daemon.skin import layout as layouts
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.layout import Layout, builtin

EXAMPLES = Path(__file__).parents[1] / "data" / "examples"
LAYOUT = builtin("left", (5, 6, 7))
BOARD, TRIANGLE = LAYOUT.triangles[1].board, LAYOUT.triangles[1].triangle

Write = Callable[..., Path]


def taxel(number: int = 0, triangle: int = TRIANGLE, board: int = BOARD, **more: Any) -> dict[str, Any]:
    values = {"baseline_count": 240.5, "coefficients_pa": [0.0, 7900.0, 12.0, 0.11]}
    return {"board": board, "triangle": triangle, "taxel": number, **values, **more}


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Return a function that writes one taxel per line, the first on line 3."""

    def write(*taxels: dict[str, Any], **more: Any) -> Path:
        """One taxel a line, the first on line 3."""
        path = tmp_path / "calibration.json"
        head = {"format": "insole-calibration/1", "foot": "left", **more}
        rows = ",\n".join(json.dumps(row) for row in taxels)
        path.write_text(json.dumps(head)[:-1] + ',\n"taxels": [\n' + rows + "]}\n")
        return path

    return write


def problems(path: Path, layout: Layout = LAYOUT) -> list[tuple[int | None, str, str]]:
    with pytest.raises(DocumentError) as caught:
        load(path, layout)
    return [(problem.line, problem.key, problem.message) for problem in caught.value.problems]


def only(path: Path, layout: Layout = LAYOUT) -> tuple[int | None, str, str]:
    (problem,) = problems(path, layout)
    return problem


def test_taxels_load_in_layout_order(write: Write) -> None:
    last = LAYOUT.triangles[-1]
    rows = [taxel(9, last.triangle, last.board, baseline_count=200), taxel(0)]
    calibration = load(write(*rows, provenance={"by": "a test"}, effects=[], extensions={"x": 1}), LAYOUT)
    assert (calibration.foot, calibration.builtin, calibration.effects) == ("left", False, ())
    assert calibration.provenance == {"by": "a test"}
    assert calibration.extensions == {"x": 1}
    assert calibration.baseline_count.shape == (28, 12)
    assert calibration.coefficients_pa.shape == (28, 12, 4)
    assert calibration.covariance_pa2 is None
    assert np.argwhere(calibration.usable).tolist() == [[1, 0], [27, 9]]
    assert (calibration.baseline_count[1, 0], calibration.baseline_count[27, 9]) == (240.5, 200.0)
    assert calibration.coefficients_pa[1, 0].tolist() == [0.0, 7900.0, 12.0, 0.11]
    assert np.isnan(calibration.baseline_count[~calibration.usable]).all()
    assert np.isnan(calibration.coefficients_pa[~calibration.usable]).all()
    assert not calibration.usable.flags.writeable


def test_shorter_lists_of_coefficients_are_filled_with_zeros(write: Write) -> None:
    calibration = load(write(taxel(0), taxel(1, coefficients_pa=[1.0, 8000])), LAYOUT)
    assert calibration.coefficients_pa[1, 1].tolist() == [1.0, 8000.0, 0.0, 0.0]


def test_yaml_is_read_too(tmp_path: Path) -> None:
    path = tmp_path / "calibration.yaml"
    head = "format: insole-calibration/1\nfoot: left\ntaxels:\n"
    path.write_text(f"{head}- {json.dumps(taxel(2))}\n")
    assert np.argwhere(load(path, LAYOUT).usable).tolist() == [[1, 2]]


@pytest.mark.parametrize("pad", [6, 10])
def test_a_thermal_pad_is_refused(write: Write, pad: int) -> None:
    line, key, message = only(write(taxel(0), taxel(pad)))
    assert (line, key) == (4, "taxels[1].taxel")
    assert f"taxel {pad} is a thermal pad" in message


def test_a_duplicate_taxel_is_refused(write: Write) -> None:
    line, key, message = only(write(taxel(0), taxel(1), taxel(0)))
    assert (line, key) == (5, "taxels[2]")
    assert message == f"taxel 0 of triangle {TRIANGLE} of board {BOARD} is listed twice, first in taxels[0]"


def test_a_triangle_outside_the_layout_is_refused(write: Write) -> None:
    missing = min(set(range(16)) - {t.triangle for t in LAYOUT.triangles if t.board == BOARD})
    line, key, message = only(write(taxel(0), taxel(0, missing), taxel(1, missing)))
    assert (line, key) == (4, "taxels[1]")
    assert f"triangle {missing} of board {BOARD} is not in the layout" in message


def test_a_board_outside_the_layout_is_refused(write: Write) -> None:
    line, key, message = only(write(taxel(board=9), taxel(board=9, triangle=4), taxel(1)))
    assert (line, key) == (3, "taxels[0]")
    assert message.startswith("board 9 is not in the layout")


def test_a_calibration_of_the_other_foot_is_refused(write: Write) -> None:
    line, key, message = only(write(taxel(), foot="right"))
    assert (line, key) == (1, "foot")
    assert message == "expected the calibration of the left foot, found that of the right foot"


def test_another_format_version_is_refused(write: Write) -> None:
    line, key, message = only(write(taxel(), format="insole-calibration/2"))
    assert (line, key) == (1, "format")
    assert "expected insole-calibration/1, found insole-calibration/2: this program reads version 1" in message


@pytest.mark.parametrize(
    ("row", "key", "message"),
    [
        (taxel(baseline_count=float("nan")), "baseline_count", "found nan"),
        (taxel(coefficients_pa=[0.0, float("inf")]), "coefficients_pa[1]", "found inf"),
        (taxel(coefficients_pa=[]), "coefficients_pa", "expected a list of 1 to 32"),
        (taxel(coefficients_pa=[0.0, 1e28]), "coefficients_pa", "expected a pressure below 1e+30 Pa at every count"),
        (taxel(coefficients_pa=[0.0] * 31 + [1e300]), "coefficients_pa", "expected a pressure below 1e+30 Pa"),
        (taxel(coefficients_pa=7900), "coefficients_pa", "expected a list of 1 to 32, found 7900"),
        (taxel(12), "taxel", "from 0 to 11, found 12"),
        (taxel(baseline_count=30000), "baseline_count", "from 0 to 510, found 30000"),
        (taxel(coefficients_kpa=[1]), "coefficients_kpa", "give it in pa"),
        (taxel(basline_count=1), "basline_count", 'did you mean "baseline_count"?'),
    ],
)
def test_invalid_taxels_are_refused(write: Write, row: dict[str, Any], key: str, message: str) -> None:
    line, reported_key, reported = only(write(taxel(1), row))
    assert (line, reported_key) == (4, f"taxels[1].{key}")
    assert message in reported


LAG = {"effect": "lag", "where": {"scope": "insole"}, "parameters": {"tau_s": {"value": 0.03, "unit": "s"}}}


def test_effects_are_read_with_the_curves(write: Write) -> None:
    calibration = load(write(taxel(), effects=[LAG]), LAYOUT)
    assert [effect.law.word for effect in calibration.effects] == ["lag"]
    assert calibration.effects[0].values["tau_s"] == 0.03


def test_unknown_or_invalid_effects_are_refused_by_name(write: Write) -> None:
    reported = problems(write(taxel(), effects=[LAG | {"effect": "hysteria"}, LAG | {"parameters": {}}, {}]))
    assert {key for _, key, _ in reported} == {
        "effects[0].effect", "effects[1].parameters.tau_s",
        "effects[2].effect", "effects[2].where", "effects[2].parameters",
    }  # fmt: skip
    assert 'unknown effect "hysteria": did you mean "hysteresis"?' in [message for *_, message in reported]


def test_all_problems_are_reported_together(write: Write) -> None:
    path = write(
        taxel(6), taxel(0), taxel(0), taxel(1, board=9), taxel(2, baseline_count=float("nan")), taxel(3, 16),
        foot="right", effects=[LAG | {"effect": "lagg"}], efects=[],
    )  # fmt: skip
    assert {(line, key) for line, key, _ in problems(path)} == {
        (1, "foot"),
        (1, "efects"),
        (1, "effects[0].effect"),
        (3, "taxels[0].taxel"),
        (5, "taxels[2]"),
        (6, "taxels[3]"),
        (7, "taxels[4].baseline_count"),
        (8, "taxels[5].triangle"),
    }


def covariance(matrix: object) -> dict[str, Any]:
    return {"extensions": {"coefficients_covariance_pa2": matrix}}


def test_covariance_is_read_from_the_extension(write: Write) -> None:
    matrix = [[4.0, 1.0], [1.0, 9e4]]
    rows = [taxel(0), taxel(1, coefficients_pa=[0.0, 8000.0], **covariance(matrix))]
    calibration = load(write(*rows), LAYOUT)
    assert calibration.covariance_pa2 is not None
    assert calibration.covariance_pa2.shape == (28, 12, 4, 4)
    np.testing.assert_array_equal(calibration.covariance_pa2[1, 1, :2, :2], matrix)
    assert not calibration.covariance_pa2[1, 1, 2:].any()
    assert np.isnan(calibration.covariance_pa2[1, 0]).all()  # nothing is said about this one


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        ([[1.0]], "expected 2 rows of 2 numbers, found the shape (1, 1)"),
        ([[1.0, 0.0], [0.0]], "expected 2 rows of 2 numbers"),
        ("none", "expected 2 rows of 2 numbers"),
        ({"a": 1}, "expected 2 rows of 2 numbers"),
        ([[1.0, 0.5], [0.0, 1.0]], "expected a symmetric matrix"),
        ([[1.0, 0.0], [0.0, float("nan")]], "found nan or inf"),
        ([[1.0, 0.0], [0.0, -1.0]], "negative eigenvalue"),
        ([[1.0, 2.0], [2.0, 1.0]], "negative eigenvalue"),
        ([[1.0, 0.0], [0.0, 1e300]], "expected standard deviations below 1e+30 Pa"),
    ],
)
def test_an_invalid_covariance_is_refused(write: Write, matrix: object, message: str) -> None:
    line, key, reported = only(write(taxel(coefficients_pa=[0, 8000], **covariance(matrix))))
    assert (line, key) == (3, "taxels[0].extensions.coefficients_covariance_pa2")
    assert message in reported


def test_valid_range_is_read_from_the_extension(write: Write) -> None:
    ranged = taxel(extensions={"valid_range": {"activation_count": [0, 40.2]}})
    assert load(write(taxel()), LAYOUT).highest_count is None
    assert load(write(taxel()), LAYOUT).lowest_count is None
    calibration = load(write(ranged, taxel(1)), LAYOUT)
    row = LAYOUT.rows[BOARD, TRIANGLE]
    assert calibration.highest_count is not None
    assert calibration.lowest_count is not None
    assert calibration.highest_count[row, :2].tolist() == [40.2, np.inf]
    assert calibration.lowest_count[row, :2].tolist() == [201, 0], (
        "240.5 − 40.2 is 200.3; one without a range has no limit"
    )


@pytest.mark.parametrize(("fitted_to", "read"), [(40.217, 40.22), (-0.4, 0.0), (np.inf, np.inf)])
def test_a_stated_range_is_read_again(write: Write, fitted_to: float, read: float) -> None:
    """Also that of a taxel that was never loaded: its highest reading may be below its baseline."""
    stated = taxel(extensions=valid_up_to(fitted_to))
    ranged = taxel(1, extensions=valid_up_to(30.0))
    highest_count = load(write(stated, ranged), LAYOUT).highest_count
    assert highest_count is not None
    assert highest_count[LAYOUT.rows[BOARD, TRIANGLE], 0] == read


@pytest.mark.parametrize("value", [[0, 40], {"activation_count": [40, 0]}, {"activation_count": "all"}, {}])
def test_an_invalid_range_is_refused(write: Write, value: object) -> None:
    _, key, message = only(write(taxel(extensions={"valid_range": value})))
    assert key == "taxels[0].extensions.valid_range"
    assert "two numbers that ascend" in message


def test_default_is_a_line_from_the_unloaded_counts() -> None:
    boards = [Board(address=a, interface="can0", no_load=n) for a, n in ((5, 240), (6, 255), (7, 245))]
    calibration = default(LAYOUT, boards)
    assert (calibration.builtin, calibration.foot, calibration.covariance_pa2) == (True, "left", None)
    assert (calibration.usable == PRESSURE_TAXELS).all()
    rest = {5: 240.4375, 6: 255.4375, 7: 245.4375}  # shift 3: half of 1 − 1/8 above the no-load
    for row, triangle in enumerate(LAYOUT.triangles):
        assert (calibration.baseline_count[row, PRESSURE_TAXELS] == rest[triangle.board]).all()
    assert np.isnan(calibration.baseline_count[:, ~PRESSURE_TAXELS]).all()
    assert (calibration.coefficients_pa[:, PRESSURE_TAXELS] == [0.0, 8000.0]).all()


def test_default_needs_every_board_of_the_layout() -> None:
    with pytest.raises(InsoleError, match=r"board 7, expected only this insole's boards \(5, 6\)"):
        default(LAYOUT, load_config().insoles[0].boards[:2])


def test_280_taxels_are_read_as_fast_as_a_hundred_times_their_json(write: Write) -> None:
    rows = [taxel(k, t.triangle, t.board) for t in LAYOUT.triangles for k in np.flatnonzero(PRESSURE_TAXELS).tolist()]
    path = write(*rows)
    assert load(path, LAYOUT).usable.sum() == 280

    def cpu_s(read: Callable[[], object]) -> float:
        start = time.process_time()
        read()
        return time.process_time() - start

    of_json_s = min(cpu_s(lambda: json.loads(path.read_text())) for _ in range(9))
    assert min(cpu_s(lambda: load(path, LAYOUT)) for _ in range(9)) < 100 * of_json_s  # measured: 23


@pytest.mark.parametrize("kind", ["chamber", "shoe"])
def test_example_files_load(kind: str) -> None:
    layout = layouts.load(EXAMPLES / kind / "layout.yaml")
    calibration = load(EXAMPLES / kind / "calibration.json", layout)
    assert (calibration.usable == PRESSURE_TAXELS).all()
    assert np.isfinite(calibration.coefficients_pa[calibration.usable]).all()
