"""Chains: order, memory between pieces, missing taxels, and problems; and completeness of the laws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from insole_daemon.config import Config
from insole_daemon.errors import EffectError
from insole_daemon.physics.calibration import Calibration, default
from insole_daemon.physics.chain import Chain
from insole_daemon.physics.effect import Effect, Where, effect
from insole_daemon.physics.effects import laws
from insole_daemon.physics.law import Law
from insole_daemon.physics.static_curve import StaticCurve
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.layout import builtin

Array = NDArray[np.float64]

LAYOUT = builtin("left", (5, 6, 7))
BOARDS = Config().insoles[0].boards
LINE = default(LAYOUT, BOARDS)
FULL_SCALE_PA = 3.4e5

PLATES = {"area_mm2": 19.0, "gap_mm": 3.0, "stiffness_n_per_m": 6e3, "permittivity": 1.5, "ff_per_count": 0.96}

EVERY = [
    effect("map_transform", x_mm=1.0, y_mm=2.0, rotation_deg=3.0, scale=1.01),
    effect("swapped_triangles", Where("triangle", ((5, 0), (6, 4))), pair=[[5, 0], [6, 4]]),
    effect("preload", p0_pa=5e3),
    effect("crosstalk", k=0.2),
    effect("hysteresis", r_pa=[2e3, 2e4], w=[0.05, 0.04]),
    effect("snap", Where("board", ((6,),)), up_pa=4e4, down_pa=2e4, step_pa=6e3),
    effect("viscoelasticity", a=0.1, tau_s=0.3),
    effect("creep", Where("triangle", ((5, 0), (7, 1))), a=[0.02, 0.03], tau_s=[1.0, 60.0]),
    effect("power_creep", a=0.05, exponent=0.2, t0_s=10.0),
    effect("lag", tau_s=0.03),
    effect("plates", Where("board", ((7,),)), **PLATES),
    effect("permittivity", gas_permittivity=1.0, solid_permittivity=2.5, solid_share=0.2, rest_count=300.0),
    effect("stiffening", knee_pa=2e5, span_pa=5e5),
    effect("gain", gain=1.2),
    effect("baseline", shift_count=3.0),
    effect("temperature", count_per_k=0.2, gain_per_k=0.005, t0_c=25.0),
    effect("compensation", skin_type=0, generation=4, count_per_k=0.5, t0_c=25.0),
    effect("drift", t_s=[0.0, 2.0], shift_count=[0.0, 4.0]),
    effect("rezero", Where("board", ((5,),)), t_s=1.0, shift_count=-7.0),
    effect("clock", offset_s=1.0, rate=0.0),
]
LOSSY = [
    effect("bit_shift", shift=4),
    effect("delay", delay_s=0.035),
    effect("sample_and_hold", rate_hz=27.127),
    effect("jitter", std_s=0.002),
    effect("loss", Where("board", ((6,), (7,))), share=0.1, run=3.0),
]


def cubic(usable: NDArray[np.bool_] | None = None) -> Calibration:
    """Return a calibration with the paper's kind of curve, slightly different for every taxel."""
    usable = LINE.usable if usable is None else usable
    rng = np.random.default_rng(4)
    coefficients = np.array([-300.0, 7900.0, 12.0, 0.11]) * rng.uniform(0.9, 1.1, (28, 12, 4))
    return Calibration(
        "left",
        np.where(usable, rng.uniform(236, 244, (28, 12)), np.nan),
        np.where(usable[..., None], coefficients, np.nan),
        None,
        usable,
        {},
    )


def signal(n: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """Return loads (n, 28, 12) with pads missing, irregular times and temperatures (n,)."""
    rng = np.random.default_rng(seed)
    load = rng.uniform(0, FULL_SCALE_PA, (n, 28, 12))
    load[..., ~PRESSURE_TAXELS] = np.nan
    return load, np.cumsum(rng.uniform(0.002, 0.05, n)), rng.uniform(20, 30, n)


# ---- laws

TABLE = {
    "map_transform": (1, ["x_mm", "y_mm", "rotation_deg", "scale"]),
    "swapped_triangles": (1, ["pair"]),
    "preload": (2, ["p0_pa"]),
    "crosstalk": (3, ["k"]),
    "hysteresis": (4, ["r_pa", "w", "half_pa"]),
    "snap": (4, ["up_pa", "down_pa", "step_pa", "together"]),
    "viscoelasticity": (5, ["a", "tau_s"]),
    "creep": (5, ["a", "tau_s", "scale_pa"]),
    "power_creep": (5, ["a", "exponent", "t0_s"]),
    "lag": (6, ["tau_s"]),
    "plates": (7, ["area_mm2", "gap_mm", "stiffness_n_per_m", "permittivity", "ff_per_count"]),
    "permittivity": (7, ["gas_permittivity", "solid_permittivity", "solid_share", "rest_count"]),
    "stiffening": (7, ["knee_pa", "span_pa"]),
    "gain": (7, ["gain"]),
    "baseline": (8, ["shift_count"]),
    "temperature": (8, ["count_per_k", "gain_per_k", "t0_c"]),
    "compensation": (8, ["skin_type", "generation", "count_per_k", "t0_c"]),
    "drift": (8, ["t_s", "shift_count"]),
    "rezero": (8, ["t_s", "shift_count"]),
    "bit_shift": (9, ["shift"]),
    "sample_and_hold": (9, ["rate_hz"]),
    "delay": (10, ["delay_s"]),
    "jitter": (10, ["std_s"]),
    "loss": (10, ["share", "run"]),
    "clock": (None, ["offset_s", "rate"]),
}


def test_words_orders_and_parameters_match_the_format() -> None:
    assert {word: (law.order, [p.name for p in law.parameters]) for word, law in laws().items()} == TABLE


@pytest.mark.parametrize("law", laws().values(), ids=laws())
def test_every_law_is_complete(law: Law) -> None:
    assert law.equation
    assert law.source
    assert law.inverse_is
    assert law.inverse is not None or law.inverse_is.startswith("none")
    for parameter in law.parameters:
        assert parameter.low <= parameter.prior[0] < parameter.prior[1] <= parameter.high
        assert parameter.unit
        assert parameter.meaning


# ---- order


def test_effects_run_in_the_order_of_the_signal_path_however_they_are_listed() -> None:
    words = [e.law.word for e in Chain([*LOSSY, *EVERY[::-1]], LAYOUT, LINE, BOARDS).effects]
    orders = [TABLE[word][0] for word in words if word not in ("bit_shift", "clock")]
    assert orders == sorted(orders, key=lambda order: order or 0)
    assert words[-2:] == ["bit_shift", "clock"], "what is late before the floor, with which it commutes"


def test_preload_comes_before_the_play_and_the_play_before_the_lag() -> None:
    load = np.full((3, 28, 12), 0.0)
    load[1:] = 1e5
    t_s = np.array([0.0, 0.1, 0.2])
    made = [effect("lag", tau_s=0.05), effect("hysteresis", r_pa=[1e4], w=[0.5]), effect("preload", p0_pa=3e4)]
    q = Chain(made, LAYOUT).forward()(load, t_s)[:, 0, 0]
    # by hand: 30 and 130 kPa; the play gives 20 and 120: 25 and 125 kPa; the lag over a line, then over a hold
    first = 25e3 + 1e5 * (1 - (1 - np.exp(-2.0)) / 2)
    assert q == pytest.approx([25e3, first, 125e3 - (125e3 - first) * np.exp(-2.0)], rel=1e-12)


def test_effects_of_equal_order_keep_the_order_of_the_file() -> None:
    snap, play = effect("snap", up_pa=4e4, down_pa=2e4, step_pa=1e4), effect("hysteresis", r_pa=[1e4], w=[0.5])
    load = np.full((1, 28, 12), 4.2e4)
    one, other = (Chain(made, LAYOUT).forward()(load, [0.0])[0, 0, 0] for made in ([snap, play], [play, snap]))
    assert one == pytest.approx(0.5 * 5.2e4 + 0.5 * 4.2e4), "it snaps, then the play"
    assert other == pytest.approx(0.5 * 4.2e4 + 0.5 * 3.2e4), "behind the play, it does not reach the relay"


# ---- forward and back


@pytest.mark.parametrize("calibration", [None, LINE, cubic()], ids=["no calibration", "line", "cubic"])
def test_all_invertible_effects_are_inverted(calibration: Calibration | None) -> None:
    load, t_s, warm = signal(200)
    chain = Chain(
        [e for e in EVERY if calibration or e.law.domain not in ("curve", "activation")], LAYOUT, calibration, BOARDS
    )
    result = chain.inverse()(chain.forward()(load, t_s, warm), t_s, warm)
    np.testing.assert_allclose(result, load, rtol=0, atol=1e-9 * FULL_SCALE_PA)


def test_without_effects_the_inverse_is_the_static_curve() -> None:
    calibration = cubic()
    counts = np.random.default_rng(0).integers(0, 256, (20, 28, 12)).astype(np.uint8)
    result = Chain([], LAYOUT, calibration).inverse()(counts, np.arange(20) * 0.02)
    np.testing.assert_allclose(result, StaticCurve(calibration, 0).pressure_pa(counts), rtol=1e-12)


@settings(max_examples=6, deadline=None)
@given(st.lists(st.integers(1, 70), min_size=1, max_size=6), st.integers(0, 1000))
def test_pieces_give_the_same_result_as_the_whole(lengths: list[int], seed: int) -> None:
    load, t_s, warm = signal(sum(lengths), seed)
    ends = np.cumsum(lengths)[:-1]
    chain = Chain([*EVERY, *LOSSY], LAYOUT, cubic(), BOARDS)
    undo = Chain(EVERY, LAYOUT, cubic(), BOARDS)
    counts = chain.forward()(load, t_s, warm)
    for run, whole_of, tolerance in ((chain.forward(), load, 0.0), (undo.inverse(), counts, 1e-9 * FULL_SCALE_PA)):
        whole = (chain.forward() if whole_of is load else undo.inverse())(whole_of, t_s, warm)
        pieces = [np.split(array, ends) for array in (whole_of, t_s, warm)]
        result = np.concatenate([run(*piece) for piece in zip(*pieces, strict=True)])
        np.testing.assert_allclose(result, whole, rtol=0, atol=tolerance)


def test_single_samples_give_the_same_result_as_the_whole() -> None:
    load, t_s, warm = signal(150, 5)
    chain = Chain([*EVERY, *LOSSY], LAYOUT, cubic(), BOARDS)
    whole, run = chain.forward()(load, t_s, warm), chain.forward()
    result = np.concatenate([run(load[i : i + 1], t_s[i : i + 1], warm[i : i + 1]) for i in range(150)])
    np.testing.assert_array_equal(result, whole)


def test_runs_of_a_chain_are_independent() -> None:
    load, t_s, _ = signal(20)
    chain = Chain([effect("creep", a=[0.2], tau_s=[5.0])], LAYOUT)
    first = chain.forward()(load, t_s)
    np.testing.assert_array_equal(chain.forward()(load, t_s), first)


def test_inputs_are_not_modified() -> None:
    load, t_s, warm = signal(30)
    kept = load.copy()
    Chain([*EVERY, *LOSSY], LAYOUT, cubic(), BOARDS).forward()(load, t_s, warm)
    np.testing.assert_array_equal(load, kept)


def test_entries_for_parts_equal_one_entry_with_per_taxel_values() -> None:
    load, t_s, _ = signal(60)
    boards, tau_s = (7, 5, 6), (0.1, 0.2, 0.3)
    parts = [effect("lag", Where("board", ((b,),)), tau_s=tau) for b, tau in zip(boards, tau_s, strict=True)]
    of_board = dict(zip(boards, tau_s, strict=True))
    values = np.repeat([of_board[int(b)] for b in LAYOUT.identities[:, 0]], 12)
    one = Chain([effect("lag", tau_s=values)], LAYOUT)
    np.testing.assert_array_equal(Chain(parts, LAYOUT).forward()(load, t_s), one.forward()(load, t_s))


def test_two_entries_on_the_same_taxels_run_in_sequence() -> None:
    load, t_s, _ = signal(10)
    some = Where("taxel", ((5, 0, 2), (5, 0, 1)))
    made = [effect("preload", some, p0_pa=[1e3, 2e3]), effect("preload", p0_pa=5e2)]
    row = LAYOUT.rows[5, 0]
    assert (Chain(made, LAYOUT).forward()(load, t_s) - load)[0, row, :4] == pytest.approx([500, 2500, 1500, 500])


# ---- silence


def test_a_missing_taxel_keeps_its_state_and_has_no_result() -> None:
    load, t_s, _ = signal(30)
    chain = Chain([effect("lag", tau_s=0.05)], LAYOUT)
    gap, stays = load.copy(), load.copy()
    gap[10:14, 2, 3] = np.nan
    stays[10:14, 2, 3] = load[9, 2, 3]
    result, expected = chain.forward()(gap, t_s), chain.forward()(stays, t_s)
    assert np.isnan(result[10:14, 2, 3]).all()
    np.testing.assert_array_equal(result[14:], expected[14:])
    run = chain.forward()
    pieces = np.concatenate([run(gap[i : i + 1], t_s[i : i + 1]) for i in range(30)])
    np.testing.assert_array_equal(pieces, result)


def test_an_unusable_taxel_has_no_result_and_affects_no_other() -> None:
    usable = LINE.usable.copy()
    usable[3, 4] = False
    load, t_s, warm = signal(20)
    chain = Chain(EVERY, LAYOUT, cubic(usable), BOARDS)
    counts = chain.forward()(load, t_s, warm)
    assert (np.isnan(counts) == ~usable).all()
    assert (np.isnan(chain.inverse()(counts, t_s, warm)) == ~usable).all()


def test_no_samples_give_an_empty_result() -> None:
    chain = Chain([*EVERY, *LOSSY], LAYOUT, cubic(), BOARDS)
    run = chain.forward()
    load, t_s, warm = signal(4)
    first = run(load[:2], t_s[:2], warm[:2])
    assert run(load[:0], t_s[:0], warm[:0]).shape == (0, 28, 12)
    result = np.concatenate([first, run(load[2:], t_s[2:], warm[2:])])
    np.testing.assert_array_equal(result, chain.forward()(load, t_s, warm))


# ---- refusals


def refused(message: str, effects: list[Effect], calibration: Calibration | None = LINE) -> None:
    with pytest.raises(EffectError, match=message):
        Chain(effects, LAYOUT, calibration).inverse()


def test_the_error_of_an_effect_without_inverse_names_a_remedy() -> None:
    refused("delay has no inverse: none: it would need future readings. Stamp the readings with t − delay_s", LOSSY[1:])


def test_effects_on_counts_without_a_calibration_are_refused() -> None:
    refused("gain: it acts on counts, expected a calibration", [effect("gain", gain=1.1)], None)


def test_ids_outside_the_layout_are_refused() -> None:
    refused("lag: board 9 is not in the layout", [effect("lag", Where("board", ((9,),)), tau_s=0.1)])


def test_a_wrong_number_of_per_taxel_values_is_refused() -> None:
    made = effect("lag", Where("triangle", ((5, 0),)), tau_s=[0.1, 0.2, 0.3])
    refused("lag: expected one value of tau_s, or 12, one for each of its taxels, found 3", [made])


def test_a_decreasing_curve_is_refused() -> None:
    falling = Calibration(
        "left", LINE.baseline_count, LINE.coefficients_pa * np.array([1.0, -1.0]), None, LINE.usable, {}
    )
    with pytest.raises(EffectError, match="does not rise"):
        Chain([], LAYOUT, falling).forward()


def test_samples_of_another_shape_are_refused() -> None:
    with pytest.raises(EffectError, match=r"shape \(2, 28, 12\), as many as there are times, found \(2, 27, 12\)"):
        Chain([], LAYOUT).forward()(np.zeros((2, 27, 12)), [0.0, 1.0])


def test_time_going_back_is_refused() -> None:
    run = Chain([], LAYOUT).forward()
    run(np.zeros((1, 28, 12)), [1.0])
    with pytest.raises(EffectError, match=r"time goes back at sample 1 \(t_s 1\.5\)"):
        run(np.zeros((2, 28, 12)), [2.0, 1.5])


# ---- the curve backwards


def test_a_curve_is_inverted_only_where_it_increases() -> None:
    # 8000·a − 20·a² rises to a = 200, where it is 800 kPa
    coefficients = np.where(LINE.usable[..., None], [0.0, 8000.0, -20.0], np.nan)
    chain = Chain([], LAYOUT, Calibration("left", LINE.baseline_count, coefficients, None, LINE.usable, {}))
    load = np.broadcast_to(np.array([-1e5, 0.0, 3e5, 7.999e5, 9e5])[:, None, None], (5, 28, 12))
    result = LINE.baseline_count[0, 0] - chain.forward()(load, np.arange(5.0))[:, 0, 0]
    expected = [200 - np.sqrt(200**2 - p / 20) for p in (-1e5, 0.0, 3e5, 7.999e5, 8e5)]
    assert result == pytest.approx(expected, abs=1e-5)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32))
def test_curve_and_inverse_agree(seed: int) -> None:
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(0, 1, (28, 12, 4)) * np.array([1e3, 0.0, 20.0, 0.2])
    coefficients[..., 1] = rng.uniform(4e3, 1.2e4, (28, 12))
    usable = LINE.usable
    calibration = Calibration(
        "left", LINE.baseline_count, np.where(usable[..., None], coefficients, np.nan), None, usable, {}
    )
    load = rng.uniform(0, 2e5, (3, 28, 12))
    counts = Chain([], LAYOUT, calibration).forward()(load, np.arange(3.0))
    back = LINE.baseline_count - counts
    again = sum(coefficients[..., k] * back**k for k in range(4))
    slope = sum(k * coefficients[..., k] * back ** (k - 1) for k in range(1, 4))
    reached = np.abs(again - load) < 1e-9 * FULL_SCALE_PA
    assert (reached | ~usable | (np.abs(slope) < 10) | (np.abs(back) > 509)).all(), "or the curve ends before"
