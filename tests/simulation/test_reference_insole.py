"""The constants and curves of the simulated insole."""

import numpy as np
import pytest

from insole_daemon.config import Config
from insole_daemon.errors import DocumentError
from insole_daemon.physics.curve_inverse import CurveInverse
from insole_daemon.simulation.reference_insole import FILE, load, reference_insole
from insole_daemon.skin import layout as layouts

LEFT = layouts.builtin("left", (5, 6, 7))
BOARDS = Config().insoles[0].boards


def test_constants_match_the_real_insole():
    """12 counts per bar, 28 to 63 counts at 3.4 bar, noise of one count, 8 bit."""
    made = reference_insole()
    assert made.noise_count >= 1.0
    assert made.count_bits == 8
    curves = made.calibration(LEFT, BOARDS, seed=0)
    coefficients = curves.coefficients_pa[curves.usable]
    one_bar = CurveInverse(coefficients)(np.full((1, len(coefficients)), 1e5))[0]
    assert one_bar.mean() == pytest.approx(12.0, abs=0.7)
    at_most = CurveInverse(coefficients)(np.full((1, len(coefficients)), 3.4e5))[0]
    low, high = np.percentile(at_most, [1, 99])
    assert 23 < low < 33
    assert 50 < high < 68


def test_the_same_seed_gives_the_same_insole_and_boards_differ():
    made = reference_insole()
    one, again, other = (made.calibration(LEFT, BOARDS, seed).coefficients_pa for seed in (1, 1, 2))
    assert np.array_equal(one, again, equal_nan=True)
    assert not np.array_equal(one, other, equal_nan=True)
    rear = [row for row, triangle in enumerate(LEFT.triangles) if triangle.board == 7]
    alone = layouts.assigned(LEFT, tuple(LEFT.triangles[row] for row in rear))
    assert np.array_equal(made.calibration(alone, BOARDS, 1).coefficients_pa, one[rear], equal_nan=True)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("value: 8000.0", "value: 8.0", r"constants.pa_per_count.value: expected a number from 100 to 1e\+06 Pa"),
        ("unit: count/K", "unit: K", 'constants.pad_count_per_k.unit: expected the unit "count/K", found "K"'),
        ("  count_bits:", "  bits:", "constants.count_bits: missing key: expected a number from 8 to 8"),
        ("  count_bits:", "  bits:", "constants.bits: unknown constant"),
        ("value: 0.3", "value: low", "pad_noise_count.value: expected a finite number"),
        ("insole-reference/1", "insole-reference/2", "format"),
    ],
)
def test_an_invalid_file_is_refused_with_key_and_range(tmp_path, old, new, message):
    path = tmp_path / "reference.yaml"
    text = FILE.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(DocumentError, match=message):
        load(path)
