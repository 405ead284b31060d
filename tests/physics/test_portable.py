"""Functions with the same bits on every machine are compared with numpy."""

import numpy as np
import pytest

from insole_daemon.physics import portable


def test_exp_and_sine_are_those_of_numpy_to_the_last_bits():
    x = np.linspace(-690, 690, 100_001)
    assert np.abs(portable.exp(x) / np.exp(x) - 1).max() < 3e-16
    turns = np.linspace(-40, 40, 100_001)
    assert np.abs(portable.sin_turns(turns) - np.sin(2 * np.pi * (turns - np.rint(turns)))).max() < 5e-16


def test_exp_minus_one_is_accurate_near_0():
    x = np.concatenate([-np.geomspace(1e-14, 700, 50_001), np.geomspace(1e-14, 600, 50_001)])
    assert np.abs(portable.exp_minus_one(x) / np.expm1(x) - 1).max() < 1e-15
    assert portable.exp_minus_one([0.0, -1e5]).tolist() == [0.0, -1.0]


def test_logarithms_and_powers_are_those_of_numpy():
    x = np.geomspace(1e-300, 1e300, 100_001)
    assert np.abs(portable.ln(x) - np.log(x)).max() < 3e-13
    near = np.linspace(0.5, 2.0, 10_000)
    assert np.abs(portable.ln(near) - np.log(near)).max() < 3e-16
    assert portable.power(np.geomspace(1e-6, 1e6, 99), 0.3) == pytest.approx(
        np.geomspace(1e-6, 1e6, 99) ** 0.3, rel=1e-14
    )


def test_known_values_are_exact():
    assert portable.exp([0.0, -1e4, -800.0]).tolist() == [1.0, 0.0, 0.0]
    assert portable.sin_turns([0.0, 0.5, 7.0, -3.5]).tolist() == [0.0, 0.0, 0.0, 0.0]
    assert portable.sin_turns([0.25, -0.25, 0.75]) == pytest.approx([1.0, -1.0, -1.0], abs=1e-15)


def test_interpolation_equals_numpy():
    draw = np.random.default_rng(2)
    for k in (1, 2, 7):
        knots, values = np.cumsum(draw.random(k) + 0.1), draw.random(k)
        x = np.concatenate([draw.uniform(-1, 8, 500), knots])
        assert portable.interpolate(x, knots, values) == pytest.approx(np.interp(x, knots, values), abs=1e-14)
        assert portable.interpolate(knots, knots, values) == pytest.approx(values, abs=1e-15)


def test_weighted_sum_equals_tensordot():
    draw = np.random.default_rng(1)
    shares, patterns = draw.random((5, 3)), draw.random((3, 2, 4))
    assert portable.weighted_sum(shares, patterns) == pytest.approx(np.tensordot(shares, patterns, axes=1))
    assert portable.weighted_sum(shares, np.ones(3)) == pytest.approx(shares.sum(axis=1))


def test_scalar_and_array_paths_have_the_same_bits() -> None:
    x = np.concatenate([-np.geomspace(1e-12, 700, 300), np.geomspace(1e-12, 50, 100), [0.0, -1000.0]])
    one_by_one = np.array([portable.exp_minus_one(value)[()] for value in x])
    assert one_by_one.tobytes() == portable.exp_minus_one(x).tobytes()
