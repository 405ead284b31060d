"""Effects without memory, of places, and of time: each against its law, computed another way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from insole_daemon.config import Config
from insole_daemon.errors import EffectError
from insole_daemon.physics.calibration import default
from insole_daemon.physics.chain import Chain
from insole_daemon.physics.effect import Effect, Where, effect
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.layout import builtin

Array = NDArray[np.float64]

LAYOUT = builtin("left", (5, 6, 7))
BOARDS = Config().insoles[0].boards
LINE = default(LAYOUT, BOARDS)
PA_PER_COUNT = 8000.0
REST = LINE.baseline_count[0, 0]
N = 40
T_S = np.arange(N) * 0.05
LOAD = np.random.default_rng(0).uniform(0, 3.4e5, (N, 28, 12))
ACTIVATION = LOAD / PA_PER_COUNT


def counts(effects: list[Effect], **more: object) -> Array:
    """(N, 28, 10) of LOAD, the pads left out."""
    return Chain(effects, LAYOUT, LINE, BOARDS).forward()(LOAD, T_S, **more)[..., PRESSURE_TAXELS]  # type: ignore[arg-type]


def assert_counts(found: Array, activation: Array) -> None:
    np.testing.assert_allclose(found, REST - activation[..., PRESSURE_TAXELS], rtol=0, atol=1e-9)


def test_no_effect_is_the_static_curve() -> None:
    assert_counts(counts([]), ACTIVATION)


def test_preload() -> None:
    assert_counts(counts([effect("preload", p0_pa=4000.0)]), ACTIVATION + 0.5)


def test_gain_scales_the_activation() -> None:
    assert_counts(counts([effect("gain", gain=1.7)]), 1.7 * ACTIVATION)


def test_baseline_shifts_the_count() -> None:
    assert_counts(counts([effect("baseline", shift_count=3.5)]), ACTIVATION - 3.5)


def test_temperature() -> None:
    warm = 20.0 + T_S * 4
    found = counts([effect("temperature", count_per_k=0.3, gain_per_k=-0.01, t0_c=22.0)], temperature_c=warm)
    over = (warm - 22.0)[:, None, None]
    assert_counts(found, ACTIVATION * (1 - 0.01 * over) - 0.3 * over)


def test_temperature_of_each_taxel() -> None:
    warm = np.random.default_rng(1).uniform(15, 35, LOAD.shape)
    some = Where("board", ((6,),))
    found = counts([effect("temperature", some, count_per_k=0.3, gain_per_k=0.0, t0_c=25.0)], temperature_c=warm)
    there = (LAYOUT.identities[:, 0] == 6)[:, None]
    assert_counts(found, ACTIVATION - 0.3 * (warm - 25.0) * there)


def test_temperature_without_one_is_said() -> None:
    with pytest.raises(EffectError, match="temperature needs temperature_c"):
        counts([effect("temperature", count_per_k=0.3, gain_per_k=0.0, t0_c=22.0)])


def test_drift_is_linear_between_its_knots_and_constant_outside() -> None:
    found = counts([effect("drift", t_s=[0.5, 1.0, 1.5], shift_count=[2.0, 4.0, -1.0])])
    expected = np.piecewise(
        T_S,
        [T_S < 0.5, (T_S >= 0.5) & (T_S < 1.0), (T_S >= 1.0) & (T_S < 1.5), T_S >= 1.5],
        [2.0, lambda t: 2 + 4 * (t - 0.5), lambda t: 4 - 10 * (t - 1.0), -1.0],
    )
    assert_counts(found, ACTIVATION - expected[:, None, None])


def test_rezero_from_its_moment_on() -> None:
    found = counts([effect("rezero", Where("board", ((7,),)), t_s=1.0, shift_count=12.0)])
    board = LAYOUT.identities[:, 0] == 7
    assert_counts(found, ACTIVATION - 12.0 * ((T_S >= 1.0)[:, None] & board)[..., None])


def test_stiffening_is_bottoming_beyond_the_knee() -> None:
    knee, span = 1e5, 4e5
    found = Chain([effect("stiffening", knee_pa=knee, span_pa=span)], LAYOUT).forward()(LOAD, T_S)
    for place in ((0, 0, 0), (3, 7, 5), (20, 1, 9), (39, 27, 11)):
        load = LOAD[place]
        # P − knee = p_h·s/(s_max − s) with p_h = s_max = span: solved for s
        over = load - knee
        s = brentq(lambda s, over=over: span * s / (span - s) - over, 0, span * (1 - 1e-9), xtol=1e-9)
        assert found[place] == pytest.approx(load if load < knee else knee + s, abs=1e-6 * 3.4e5)


def test_stiffening_beyond_the_end_of_its_span_stays_finite() -> None:
    chain = Chain([effect("stiffening", knee_pa=1e5, span_pa=1e5)], LAYOUT)
    found = chain.inverse()(np.full((1, 28, 12), 3e5), [0.0])
    assert np.isfinite(found).all()
    assert (found > 1e9).all()


# ---- crosstalk


def by_distance(k: float) -> Array:
    """(28 · 12, 28 · 12) q = matrix · P, taxel by taxel."""
    xy = LAYOUT.xy_m.reshape(-1, 2).tolist()
    matrix = np.eye(len(xy))
    for i, place in enumerate(xy):
        near = [
            j
            for j, other in enumerate(xy)
            if j != i and j % 12 not in (6, 10) and i % 12 not in (6, 10) and math.dist(place, other) < 9e-3
        ]
        if near:
            matrix[i, i] = 1 - k
            matrix[i, near] = k / len(near)
    return matrix


def test_crosstalk_is_the_mean_of_the_neighbours() -> None:
    found = Chain([effect("crosstalk", k=0.3)], LAYOUT).forward()(LOAD, T_S)
    expected = LOAD.reshape(N, -1) @ by_distance(0.3).T
    np.testing.assert_allclose(found.reshape(N, -1), expected, rtol=0, atol=1e-9 * 3.4e5)


def test_crosstalk_of_a_uniform_load_is_nothing() -> None:
    uniform = np.full((1, 28, 12), 5e4)
    np.testing.assert_allclose(Chain([effect("crosstalk", k=0.4)], LAYOUT).forward()(uniform, [0.0]), uniform)


def test_neighbours_are_those_on_the_lattice_and_across_edges() -> None:
    centre = by_distance(0.3)[LAYOUT.rows[5, 0] * 12 + 3]
    assert (centre > 0).sum() == 1 + 6, "the middle of the lattice has six"
    assert centre[LAYOUT.rows[5, 0] * 12 + 6] == 0, "a thermal pad is none"


def test_crosstalk_of_a_part_only() -> None:
    found = Chain([effect("crosstalk", Where("board", ((6,),)), k=0.3)], LAYOUT).forward()(LOAD, T_S)
    board = LAYOUT.identities[:, 0] == 6
    expected = (LOAD.reshape(N, -1) @ by_distance(0.3).T).reshape(LOAD.shape)
    np.testing.assert_allclose(found[:, board], expected[:, board], rtol=1e-12)
    assert (found[:, ~board] == LOAD[:, ~board]).all()


def test_neighbours_are_real_ones_when_triangles_are_swapped() -> None:
    first, second = LAYOUT.rows[5, 0], LAYOUT.rows[7, 0]
    swapped = effect("swapped_triangles", Where("triangle", ((5, 0), (7, 0))), pair=[[5, 0], [7, 0]])
    spread = effect("crosstalk", k=0.3)
    found = Chain([swapped, spread], LAYOUT).forward()(LOAD, T_S)
    expected = Chain([spread], LAYOUT).forward()(LOAD, T_S)
    expected[:, [first, second]] = expected[:, [second, first]]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


# ---- places and identities


def test_swapped_triangles_report_each_others_load() -> None:
    made = effect("swapped_triangles", Where("triangle", ((5, 0), (7, 1))), pair=[[5, 0], [7, 1]])
    found = Chain([made], LAYOUT).forward()(LOAD, T_S)
    first, second = LAYOUT.rows[5, 0], LAYOUT.rows[7, 1]
    assert (found[:, first] == LOAD[:, second]).all()
    assert (found[:, second] == LOAD[:, first]).all()
    others = ~np.isin(np.arange(28), [first, second])
    assert (found[:, others] == LOAD[:, others]).all()


def test_map_transform_turns_and_scales_about_the_mean_of_the_centres_then_shifts() -> None:
    made = effect("map_transform", x_mm=4.0, y_mm=-2.0, rotation_deg=3.0, scale=1.05)
    chain = Chain([made], LAYOUT)
    plane = LAYOUT.xy_m @ np.array([1, 1j])
    centre = np.mean([t.x_mm + 1j * t.y_mm for t in LAYOUT.triangles]) * 1e-3
    expected = (plane - centre) * 1.05 * np.exp(1j * np.deg2rad(3.0)) + centre + (4 - 2j) * 1e-3
    np.testing.assert_allclose(chain.xy_m @ np.array([1, 1j]), expected, atol=1e-12)
    assert (chain.forward()(LOAD, T_S) == LOAD).all()
    assert (Chain([], LAYOUT).xy_m == LAYOUT.xy_m).all()


def test_clock() -> None:
    chain = Chain([effect("clock", offset_s=0.4, rate=1e-4)], LAYOUT)
    assert chain.reference_s(np.array([0.0, 1000.0])).tolist() == [0.4, pytest.approx(1000.5)]
    assert (chain.forward()(LOAD, T_S) == LOAD).all()


# ---- count to count


def test_a_wrong_shift_is_what_the_firmware_makes_of_the_same_codes() -> None:
    found = counts([effect("bit_shift", shift=5)])
    for place in ((0, 0, 0), (11, 4, 8), (39, 27, 9)):
        codes = round((240 - (REST - ACTIVATION[..., PRESSURE_TAXELS][place])) * 8 + 3.5)
        assert found[place] == min(255, max(0, 240 - math.floor(codes / 32)))


def test_the_right_shift_is_a_floor_that_reads_right_on_average() -> None:
    load = np.random.default_rng(1).uniform(0, 8000 * 200, (2000, 28, 12))
    t_s = np.arange(2000) * 0.02
    exact = Chain([], LAYOUT, LINE).forward()(load, t_s)[..., PRESSURE_TAXELS]
    whole = Chain([effect("bit_shift", shift=3)], LAYOUT, LINE, BOARDS).forward()(load, t_s)[..., PRESSURE_TAXELS]
    assert (whole == np.rint(whole)).all()
    assert np.abs(whole - exact).max() <= 0.5 + 1 / 16
    assert abs((whole - exact).mean()) < 1e-3


@pytest.mark.parametrize("shift", [0, 2, 3, 4, 7])
def test_the_inverse_of_a_shift_is_right_to_half_a_step(shift: int) -> None:
    load = np.random.default_rng(2).uniform(0, 8000 * (25 if shift == 0 else 100), (50, 28, 12))
    t_s = np.arange(50) * 0.02
    chain = Chain([effect("bit_shift", shift=shift)], LAYOUT, LINE, BOARDS)
    found = chain.inverse()(chain.forward()(load, t_s), t_s)[..., PRESSURE_TAXELS]
    step = 8000 * 2.0 ** (shift - 3)
    assert np.abs(found - load[..., PRESSURE_TAXELS]).max() <= step / 2 + 8000 / 16


def test_a_shift_needs_the_boards_settings() -> None:
    with pytest.raises(EffectError, match="bit_shift needs the boards' settings"):
        Chain([effect("bit_shift", shift=3)], LAYOUT, LINE, BOARDS[:2]).forward()


@pytest.mark.parametrize("delay_s", [0.0, 0.013, 0.05, 0.2, 5.0])
def test_delay_is_the_line_of_before(delay_s: float) -> None:
    rng = np.random.default_rng(3)
    t_s = np.cumsum(rng.uniform(0.002, 0.06, 200))
    load = rng.uniform(0, 3.4e5, (200, 28, 12))
    chain = Chain([effect("delay", delay_s=delay_s)], LAYOUT, LINE)
    found = chain.forward()(load, t_s)
    for row, taxel in ((0, 0), (13, 8), (27, 11)):
        expected = np.interp(t_s - delay_s, t_s, REST - load[:, row, taxel] / PA_PER_COUNT)
        np.testing.assert_allclose(found[:, row, taxel], expected, rtol=0, atol=1e-9)


def test_boards_have_delays_of_their_own() -> None:
    made = [effect("delay", Where("board", ((board,),)), delay_s=0.05 * i) for i, board in enumerate((5, 6, 7))]
    found = Chain(made, LAYOUT, LINE).forward()(LOAD, T_S)
    for i, board in enumerate((5, 6, 7)):
        rows = LAYOUT.identities[:, 0] == board
        expected = np.concatenate([np.repeat(LOAD[:1], i, axis=0), LOAD])[:N]
        np.testing.assert_allclose(
            found[:, rows][..., PRESSURE_TAXELS],
            (REST - expected / PA_PER_COUNT)[:, rows][..., PRESSURE_TAXELS],
            atol=1e-9,
        )


# ---- inverses


@pytest.mark.parametrize(
    "made",
    [
        effect("preload", p0_pa=4e3),
        effect("crosstalk", k=0.45),
        effect("crosstalk", Where("board", ((5,), (7,))), k=0.2),
        effect("swapped_triangles", Where("triangle", ((5, 0), (7, 1))), pair=[[5, 0], [7, 1]]),
        effect("stiffening", knee_pa=1e5, span_pa=2e5),
        effect("gain", gain=0.6),
        effect("baseline", shift_count=-4.0),
        effect("temperature", count_per_k=-0.4, gain_per_k=0.012, t0_c=30.0),
        effect("drift", t_s=[0.0, 2.0], shift_count=[0.0, 5.0]),
        effect("rezero", t_s=1.0, shift_count=20.0),
    ],
    ids=lambda made: made.law.word,
)
def test_inverses_are_exact(made: Effect) -> None:
    chain = Chain([made], LAYOUT, LINE)
    warm = 20.0 + T_S * 3
    found = chain.inverse()(chain.forward()(LOAD, T_S, warm), T_S, warm)
    np.testing.assert_allclose(found[..., PRESSURE_TAXELS], LOAD[..., PRESSURE_TAXELS], rtol=0, atol=1e-9 * 3.4e5)
    assert np.isnan(found[..., ~PRESSURE_TAXELS]).all()
