"""Effects without memory, of positions, and of time are compared with their laws, computed in another way."""

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
from insole_daemon.physics.draws import Drawn, Draws
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
    """Return (N, 28, 10) counts for LOAD, without the pads."""
    return Chain(effects, LAYOUT, LINE, BOARDS).forward()(LOAD, T_S, **more)[..., PRESSURE_TAXELS]  # type: ignore[arg-type]


def assert_counts(output: Array, activation: Array) -> None:
    np.testing.assert_allclose(output, REST - activation[..., PRESSURE_TAXELS], rtol=0, atol=1e-9)


def test_without_effects_the_chain_is_the_static_curve() -> None:
    assert_counts(counts([]), ACTIVATION)


def test_preload_adds_a_pressure() -> None:
    assert_counts(counts([effect("preload", p0_pa=4000.0)]), ACTIVATION + 0.5)


def test_gain_scales_the_activation() -> None:
    assert_counts(counts([effect("gain", gain=1.7)]), 1.7 * ACTIVATION)


def test_baseline_shifts_the_count() -> None:
    assert_counts(counts([effect("baseline", shift_count=3.5)]), ACTIVATION - 3.5)


def test_temperature_changes_gain_and_offset() -> None:
    warm = 20.0 + T_S * 4
    output = counts([effect("temperature", count_per_k=0.3, gain_per_k=-0.01, t0_c=22.0)], temperature_c=warm)
    over = (warm - 22.0)[:, None, None]
    assert_counts(output, ACTIVATION * (1 - 0.01 * over) - 0.3 * over)


def test_temperature_may_differ_between_taxels() -> None:
    warm = np.random.default_rng(1).uniform(15, 35, LOAD.shape)
    some = Where("board", ((6,),))
    output = counts([effect("temperature", some, count_per_k=0.3, gain_per_k=0.0, t0_c=25.0)], temperature_c=warm)
    on_board = (LAYOUT.identities[:, 0] == 6)[:, None]
    assert_counts(output, ACTIVATION - 0.3 * (warm - 25.0) * on_board)


def test_a_missing_temperature_is_reported() -> None:
    with pytest.raises(EffectError, match="temperature needs temperature_c"):
        counts([effect("temperature", count_per_k=0.3, gain_per_k=0.0, t0_c=22.0)])


def test_drift_is_linear_between_its_knots_and_constant_outside() -> None:
    output = counts([effect("drift", t_s=[0.5, 1.0, 1.5], shift_count=[2.0, 4.0, -1.0])])
    expected = np.piecewise(
        T_S,
        [T_S < 0.5, (T_S >= 0.5) & (T_S < 1.0), (T_S >= 1.0) & (T_S < 1.5), T_S >= 1.5],
        [2.0, lambda t: 2 + 4 * (t - 0.5), lambda t: 4 - 10 * (t - 1.0), -1.0],
    )
    assert_counts(output, ACTIVATION - expected[:, None, None])


def test_rezero_shifts_counts_from_its_time_on() -> None:
    output = counts([effect("rezero", Where("board", ((7,),)), t_s=1.0, shift_count=12.0)])
    board = LAYOUT.identities[:, 0] == 7
    assert_counts(output, ACTIVATION - 12.0 * ((T_S >= 1.0)[:, None] & board)[..., None])


def test_stiffening_follows_its_equation_beyond_the_knee() -> None:
    knee, span = 1e5, 4e5
    output = Chain([effect("stiffening", knee_pa=knee, span_pa=span)], LAYOUT).forward()(LOAD, T_S)
    for place in ((0, 0, 0), (3, 7, 5), (20, 1, 9), (39, 27, 11)):
        load = LOAD[place]
        # P − knee = p_h·s/(s_max − s) with p_h = s_max = span: solved for s
        over = load - knee
        s = brentq(lambda s, over=over: span * s / (span - s) - over, 0, span * (1 - 1e-9), xtol=1e-9)
        assert output[place] == pytest.approx(load if load < knee else knee + s, abs=1e-6 * 3.4e5)


def test_stiffening_beyond_the_end_of_its_span_stays_finite() -> None:
    chain = Chain([effect("stiffening", knee_pa=1e5, span_pa=1e5)], LAYOUT)
    output = chain.inverse()(np.full((1, 28, 12), 3e5), [0.0])
    assert np.isfinite(output).all()
    assert (output > 1e9).all()


# ---- the capacitor

PLATES = {"area_mm2": 19.0, "gap_mm": 3.0, "stiffness_n_per_m": 6e3, "permittivity": 1.5, "ff_per_count": 0.96}
EPSILON_0 = 8.8541878128e-12


def test_plates_replace_the_curve_by_the_papers_capacitor() -> None:
    output = counts([effect("plates", **PLATES)])
    area, gap = 19e-6, 3e-3
    d = gap - LOAD * area / 6e3  # Hooke, F = A·P
    change = 1.5 * EPSILON_0 * area * (1 / d - 1 / gap)
    np.testing.assert_allclose(output, (REST - change / 0.96e-15)[..., PRESSURE_TAXELS], rtol=0, atol=1e-9 * 255)


def test_plates_apply_only_to_their_taxels() -> None:
    board = LAYOUT.identities[:, 0] == 6
    output = counts([effect("plates", Where("board", ((6,),)), **PLATES)])
    assert (output[:, board] == counts([effect("plates", **PLATES)])[:, board]).all()
    assert (output[:, ~board] == counts([])[:, ~board]).all()


def test_plates_never_touch_in_a_chain() -> None:
    chain = Chain([effect("plates", **PLATES)], LAYOUT, LINE)
    assert np.isfinite(chain.forward()(np.full((1, 28, 12), 1e12), [0.0])[..., PRESSURE_TAXELS]).all()
    assert np.isfinite(chain.inverse()(np.full((1, 28, 12), 1e9), [0.0])[..., PRESSURE_TAXELS]).all()


def test_permittivity_equals_a_capacitor_of_that_permittivity() -> None:
    gas, solid, share = 1.0, 2.5, 0.3
    at_rest = gas + (solid - gas) * share
    area, gap = 19e-6, 3e-3
    rest_f = at_rest * EPSILON_0 * area / gap
    made = [
        effect("plates", **(PLATES | {"permittivity": at_rest})),
        effect(
            "permittivity",
            gas_permittivity=gas,
            solid_permittivity=solid,
            solid_share=share,
            rest_count=rest_f / 0.96e-15,
        ),
    ]
    s = LOAD * area / 6e3 / gap
    relative = gas + (solid - gas) * share / (1 - s)
    change = relative * EPSILON_0 * area / (gap * (1 - s)) - rest_f
    expected = (REST - change / 0.96e-15)[..., PRESSURE_TAXELS]
    np.testing.assert_allclose(counts(made), expected, rtol=0, atol=1e-9 * 255)


def test_permittivity_is_constant_once_the_air_has_left() -> None:
    # c_0 of rest, of ε_r 1.45; solid it is 2.5, at 0.3 of the gap
    made = effect("permittivity", gas_permittivity=1.0, solid_permittivity=2.5, solid_share=0.3, rest_count=10.0)
    output = counts([made])[ACTIVATION[..., PRESSURE_TAXELS] > 10 * (1 / 0.3 - 1)]
    assert len(output)
    assert output == pytest.approx(REST - 10 * (2.5 / 0.3 / 1.45 - 1), abs=1e-9)


def test_a_solid_permittivity_below_the_gas_is_refused() -> None:
    with pytest.raises(
        EffectError, match="solid_permittivity: expected at least gas_permittivity, which is 3, found 2"
    ):
        effect("permittivity", gas_permittivity=3.0, solid_permittivity=2.0, solid_share=0.1, rest_count=100.0)


# ---- the firmware's compensation


@pytest.mark.parametrize(("skin_type", "generation"), [(0, 4), (0, 3), (8, 4)])
def test_compensation_equals_the_firmware_for_pad_6(skin_type: int, generation: int) -> None:
    warm = np.random.default_rng(5).uniform(10, 40, LOAD.shape)
    made = effect("compensation", skin_type=skin_type, generation=generation, count_per_k=2.5, t0_c=25.0)
    output = counts([made], temperature_c=warm)
    gains = {
        0: (70, 96, 83, 38, 38, 70, 0, 45, 77, 164, 0, 77),
        8: (58, 91, 39, 23, 35, 90, 0, 38, 68, 115, 0, 86),
    }[skin_type]
    for i, row in ((0, 0), (7, 13), (39, 27)):
        change = round(2.5 * 8 * (warm[i, row, 6] - 25.0))  # codes, at shift 3
        size = [(abs(change) // 4 * gain) / 32 for gain in gains]
        correction = [
            math.floor(x) if change > 0 else -(math.ceil(x) if generation == 4 else math.floor(x)) for x in size
        ]
        expected = REST - ACTIVATION[i, row] + np.array(correction) / 8
        np.testing.assert_allclose(output[i, row], expected[PRESSURE_TAXELS], rtol=0, atol=1e-9)


def test_compensation_cancels_temperature_up_to_rounding() -> None:
    warm = 20.0 + T_S * 5
    of_taxel = np.tile([70, 96, 83, 38, 38, 70, 128, 45, 77, 164, 128, 77], 28) / 128 * 2.0
    sensors = effect("temperature", count_per_k=-of_taxel, gain_per_k=0.0, t0_c=20.0)
    made = [sensors, effect("compensation", skin_type=0, generation=4, count_per_k=2.0, t0_c=20.0)]
    residual = REST - counts(made, temperature_c=warm) - ACTIVATION[..., PRESSURE_TAXELS]
    assert residual.min() >= -1 / 8
    assert residual.max() <= (4 * 164 / 128 + 1) / 8, "three codes of dT are shifted away, times the gain"
    assert residual.max() > 0.1


def test_compensation_reports_missing_inputs() -> None:
    made = effect("compensation", skin_type=0, generation=4, count_per_k=2.0, t0_c=20.0)
    with pytest.raises(EffectError, match="compensation needs temperature_c"):
        counts([made])
    with pytest.raises(EffectError, match="compensation needs the boards' settings"):
        Chain([made], LAYOUT, LINE).forward()
    with pytest.raises(EffectError, match="skin_type: expected 0 or 8, the types with a compensation, found 2"):
        effect("compensation", skin_type=2, generation=4, count_per_k=2.0, t0_c=20.0)


def test_a_rezero_applies_to_boards_only() -> None:
    for where in (Where(), Where("triangle", ((5, 0),)), Where("taxel", ((5, 0, 1),))):
        with pytest.raises(
            EffectError, match=f'where.scope: expected the scope "board" of rezero, found "{where.scope}"'
        ):
            effect("rezero", where, t_s=1.0, shift_count=2.0)


def test_a_board_law_has_one_value_for_all_taxels() -> None:
    with pytest.raises(EffectError, match="shift_count: expected a number from -255 to 255 count, found a list of 2"):
        effect("rezero", Where("board", ((5,),)), t_s=1.0, shift_count=[2.0, 3.0])


# ---- crosstalk


def by_distance(k: float) -> Array:
    """Return (28 · 12, 28 · 12) the matrix of q = matrix · P, computed taxel by taxel."""
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
    output = Chain([effect("crosstalk", k=0.3)], LAYOUT).forward()(LOAD, T_S)
    expected = LOAD.reshape(N, -1) @ by_distance(0.3).T
    np.testing.assert_allclose(output.reshape(N, -1), expected, rtol=0, atol=1e-9 * 3.4e5)


def test_crosstalk_does_not_change_a_uniform_load() -> None:
    uniform = np.full((1, 28, 12), 5e4)
    np.testing.assert_allclose(Chain([effect("crosstalk", k=0.4)], LAYOUT).forward()(uniform, [0.0]), uniform)


def test_neighbours_are_those_on_the_lattice_and_across_edges() -> None:
    centre = by_distance(0.3)[LAYOUT.rows[5, 0] * 12 + 3]
    assert (centre > 0).sum() == 1 + 6, "the middle of the lattice has six"
    assert centre[LAYOUT.rows[5, 0] * 12 + 6] == 0, "a thermal pad is none"


def test_crosstalk_applies_only_to_its_taxels() -> None:
    output = Chain([effect("crosstalk", Where("board", ((6,),)), k=0.3)], LAYOUT).forward()(LOAD, T_S)
    board = LAYOUT.identities[:, 0] == 6
    expected = (LOAD.reshape(N, -1) @ by_distance(0.3).T).reshape(LOAD.shape)
    np.testing.assert_allclose(output[:, board], expected[:, board], rtol=1e-12)
    assert (output[:, ~board] == LOAD[:, ~board]).all()


def test_neighbours_use_true_positions_of_swapped_triangles() -> None:
    first, second = LAYOUT.rows[5, 0], LAYOUT.rows[7, 0]
    swapped = effect("swapped_triangles", Where("triangle", ((5, 0), (7, 0))), pair=[[5, 0], [7, 0]])
    spread = effect("crosstalk", k=0.3)
    output = Chain([swapped, spread], LAYOUT).forward()(LOAD, T_S)
    expected = Chain([spread], LAYOUT).forward()(LOAD, T_S)
    expected[:, [first, second]] = expected[:, [second, first]]
    np.testing.assert_allclose(output, expected, rtol=1e-12)


# ---- places and identities


def test_swapped_triangles_report_each_others_load() -> None:
    made = effect("swapped_triangles", Where("triangle", ((5, 0), (7, 1))), pair=[[5, 0], [7, 1]])
    output = Chain([made], LAYOUT).forward()(LOAD, T_S)
    first, second = LAYOUT.rows[5, 0], LAYOUT.rows[7, 1]
    assert (output[:, first] == LOAD[:, second]).all()
    assert (output[:, second] == LOAD[:, first]).all()
    others = ~np.isin(np.arange(28), [first, second])
    assert (output[:, others] == LOAD[:, others]).all()


def test_map_transform_turns_and_scales_about_the_mean_of_the_centres_then_shifts() -> None:
    made = effect("map_transform", x_mm=4.0, y_mm=-2.0, rotation_deg=3.0, scale=1.05)
    chain = Chain([made], LAYOUT)
    plane = LAYOUT.xy_m @ np.array([1, 1j])
    centre = np.mean([t.x_mm + 1j * t.y_mm for t in LAYOUT.triangles]) * 1e-3
    expected = (plane - centre) * 1.05 * np.exp(1j * np.deg2rad(3.0)) + centre + (4 - 2j) * 1e-3
    np.testing.assert_allclose(chain.xy_m @ np.array([1, 1j]), expected, atol=1e-12)
    assert (chain.forward()(LOAD, T_S) == LOAD).all()
    assert (Chain([], LAYOUT).xy_m == LAYOUT.xy_m).all()


def test_clock_converts_can_times_to_reference_times() -> None:
    chain = Chain([effect("clock", offset_s=0.4, rate=1e-4)], LAYOUT)
    assert chain.reference_s(np.array([0.0, 1000.0])).tolist() == [0.4, pytest.approx(1000.5)]
    assert (chain.forward()(LOAD, T_S) == LOAD).all()


# ---- count to count


def test_a_wrong_shift_equals_the_firmware_on_the_same_codes() -> None:
    output = counts([effect("bit_shift", shift=5)])
    for place in ((0, 0, 0), (11, 4, 8), (39, 27, 9)):
        codes = round((240 - (REST - ACTIVATION[..., PRESSURE_TAXELS][place])) * 8 + 3.5)
        assert output[place] == min(255, max(0, 240 - math.floor(codes / 32)))


def test_the_right_shift_is_unbiased_on_average() -> None:
    load = np.random.default_rng(1).uniform(0, 8000 * 200, (2000, 28, 12))
    t_s = np.arange(2000) * 0.02
    exact = Chain([], LAYOUT, LINE).forward()(load, t_s)[..., PRESSURE_TAXELS]
    whole = Chain([effect("bit_shift", shift=3)], LAYOUT, LINE, BOARDS).forward()(load, t_s)[..., PRESSURE_TAXELS]
    assert (whole == np.rint(whole)).all()
    assert np.abs(whole - exact).max() <= 0.5 + 1 / 16
    assert abs((whole - exact).mean()) < 1e-3


@pytest.mark.parametrize("shift", [0, 2, 3, 4, 7])
def test_the_inverse_of_a_shift_is_accurate_to_half_a_step(shift: int) -> None:
    load = np.random.default_rng(2).uniform(0, 8000 * (25 if shift == 0 else 100), (50, 28, 12))
    t_s = np.arange(50) * 0.02
    chain = Chain([effect("bit_shift", shift=shift)], LAYOUT, LINE, BOARDS)
    output = chain.inverse()(chain.forward()(load, t_s), t_s)[..., PRESSURE_TAXELS]
    step = 8000 * 2.0 ** (shift - 3)
    assert np.abs(output - load[..., PRESSURE_TAXELS]).max() <= step / 2 + 8000 / 16


def test_a_shift_without_board_settings_is_refused() -> None:
    with pytest.raises(EffectError, match="bit_shift needs the boards' settings"):
        Chain([effect("bit_shift", shift=3)], LAYOUT, LINE, BOARDS[:2]).forward()


@pytest.mark.parametrize("delay_s", [0.0, 0.013, 0.05, 0.2, 5.0])
def test_delay_returns_the_earlier_signal(delay_s: float) -> None:
    rng = np.random.default_rng(3)
    t_s = np.cumsum(rng.uniform(0.002, 0.06, 200))
    load = rng.uniform(0, 3.4e5, (200, 28, 12))
    chain = Chain([effect("delay", delay_s=delay_s)], LAYOUT, LINE)
    output = chain.forward()(load, t_s)
    for row, taxel in ((0, 0), (13, 8), (27, 11)):
        expected = np.interp(t_s - delay_s, t_s, REST - load[:, row, taxel] / PA_PER_COUNT)
        np.testing.assert_allclose(output[:, row, taxel], expected, rtol=0, atol=1e-9)


def test_boards_may_have_different_delays() -> None:
    made = [effect("delay", Where("board", ((board,),)), delay_s=0.05 * i) for i, board in enumerate((5, 6, 7))]
    output = Chain(made, LAYOUT, LINE).forward()(LOAD, T_S)
    for i, board in enumerate((5, 6, 7)):
        rows = LAYOUT.identities[:, 0] == board
        expected = np.concatenate([np.repeat(LOAD[:1], i, axis=0), LOAD])[:N]
        np.testing.assert_allclose(
            output[:, rows][..., PRESSURE_TAXELS],
            (REST - expected / PA_PER_COUNT)[:, rows][..., PRESSURE_TAXELS],
            atol=1e-9,
        )


# ---- converters, jitter, losses


def test_sample_and_hold_returns_the_signal_of_each_conversion() -> None:
    rng = np.random.default_rng(6)
    t_s = np.cumsum(rng.uniform(0.002, 0.05, 300))
    load = rng.uniform(0, 3.4e5, (300, 28, 12))
    chain = Chain([effect("sample_and_hold", rate_hz=27.127)], LAYOUT, LINE, seed=4)
    output = chain.forward()(load, t_s)
    for row, taxel in ((0, 0), (13, 8), (27, 11)):
        board, triangle = LAYOUT.identities[row]
        phase_s = Draws(4, Drawn.CONVERTERS, board).uniform(16)[triangle] / 27.127
        through_s = phase_s + np.arange(-1, 400) / 27.127
        last = np.array([through_s[through_s <= t].max() for t in t_s])
        expected = np.interp(last, t_s, REST - load[:, row, taxel] / PA_PER_COUNT)
        np.testing.assert_allclose(output[:, row, taxel], expected, rtol=0, atol=1e-9 * 255)


def test_jitter_delays_all_taxels_of_a_board_alike() -> None:
    t_s = np.arange(2000) * 0.02
    ramp = np.tile((1000.0 * t_s)[:, None, None], (1, 28, 12))
    output = Chain([effect("jitter", std_s=0.003)], LAYOUT, LINE, seed=1).forward()(ramp, t_s)
    late_s = t_s[:, None] - (REST - output[..., 0]) * PA_PER_COUNT / 1000.0
    assert late_s.min() >= -1e-9
    assert np.sqrt((late_s[20:] ** 2).mean()) == pytest.approx(0.003, rel=0.03)
    for board in (5, 6, 7):
        of_board_s = late_s[:, LAYOUT.identities[:, 0] == board]
        assert np.ptp(of_board_s, axis=1).max() < 1e-9
    assert np.corrcoef(late_s[20:, 0], late_s[20:, -1])[0, 1] < 0.1, "boards have luck of their own"


def test_jitter_keeps_the_order_of_readings() -> None:
    t_s = np.arange(500) * 0.001
    ramp = np.tile((1e6 * t_s)[:, None, None], (1, 28, 12))
    output = Chain([effect("jitter", std_s=0.05)], LAYOUT, LINE).forward()(ramp, t_s)
    assert (np.diff(output[..., 0], axis=0) <= 1e-9).all()


def test_a_lost_half_repeats_its_last_values() -> None:
    load = np.cumsum(np.ones((4000, 28, 12)), axis=0)
    t_s = np.arange(4000) * 0.02
    made = effect("loss", Where("board", ((6,),)), share=0.2, run=4.0)
    exact = Chain([], LAYOUT, LINE).forward()(load, t_s)
    output = Chain([made], LAYOUT, LINE, seed=2).forward()(load, t_s)
    missing = (output != exact) & PRESSURE_TAXELS
    board = LAYOUT.identities[:, 0] == 6
    assert not missing[:, ~board].any()
    halves = np.stack([missing[:, board, 0], missing[:, board, 7]], axis=-1)
    pressure = np.array([k for k in range(12) if k not in (6, 10)])
    assert (missing[:, board][..., pressure] == np.repeat(halves, [6, 4], axis=-1)).all(), "a frame is lost as a whole"
    assert halves.mean() == pytest.approx(0.2, rel=0.1)
    frames = halves.ravel()  # in the order in which a board sends them
    assert frames.sum() / (frames[:-1] & ~frames[1:]).sum() == pytest.approx(4.0, rel=0.1)
    rows = np.flatnonzero(board)
    for tick in np.flatnonzero(missing[1:, rows[0], 0])[:50] + 1:
        assert output[tick, rows[0], 0] == output[tick - 1, rows[0], 0]


def test_random_effects_depend_on_the_seed_only() -> None:
    made = [effect("jitter", std_s=0.002), effect("loss", share=0.1, run=2.0), effect("sample_and_hold", rate_hz=27.0)]
    first, again, other = (Chain(made, LAYOUT, LINE, seed=seed).forward()(LOAD, T_S) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_impossible_losses_are_refused() -> None:
    with pytest.raises(EffectError, match=r"share: expected at most run/\(1 \+ run\), which is 0.5, found 0.7"):
        effect("loss", share=0.7, run=1.0)


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
        effect("rezero", Where("board", ((6,),)), t_s=1.0, shift_count=20.0),
        effect("compensation", skin_type=8, generation=3, count_per_k=2.0, t0_c=21.0),
        effect("permittivity", gas_permittivity=1.0, solid_permittivity=2.5, solid_share=0.3, rest_count=60.0),
        effect("permittivity", gas_permittivity=2.0, solid_permittivity=2.0, solid_share=0.0, rest_count=60.0),
        effect("plates", **PLATES),
        effect("plates", Where("taxel", ((5, 0, 1), (6, 4, 0))), **PLATES),
    ],
    ids=lambda made: made.law.word,
)
def test_inverses_are_exact(made: Effect) -> None:
    chain = Chain([made], LAYOUT, LINE, BOARDS)
    warm = 20.0 + T_S * 3
    output = chain.inverse()(chain.forward()(LOAD, T_S, warm), T_S, warm)
    np.testing.assert_allclose(output[..., PRESSURE_TAXELS], LOAD[..., PRESSURE_TAXELS], rtol=0, atol=1e-9 * 3.4e5)
    assert np.isnan(output[..., ~PRESSURE_TAXELS]).all()
