"""The dynamic model, cycle by cycle: its results, its memory and its limits."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from insole_daemon.config import Config
from insole_daemon.physics.calibration import BEGAN, Calibration, default
from insole_daemon.physics.chain import Chain
from insole_daemon.physics.dynamic import DynamicModel, InvertedCycles
from insole_daemon.physics.effect import Effect, Where, effect
from insole_daemon.physics.effects.lag import LATE_S
from insole_daemon.physics.static_curve import StaticCurve
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.layout import builtin

LAYOUT = builtin("left", (5, 6, 7))
BOARDS = Config().insoles[0].boards
FULL_SCALE_PA = 350e3
N = 400
T_S = 0.02 * np.arange(N) + 1e-4 * (np.arange(N) % 3)
MATERIAL = (effect("hysteresis", r_pa=[3e3, 1e4], w=[0.08, 0.06]), effect("viscoelasticity", a=0.15, tau_s=0.3))
PAIR = tuple(tuple(item) for item in LAYOUT.identities[[0, -1]].tolist())
SWAP = effect("swapped_triangles", Where("triangle", PAIR), pair=PAIR)
EVERYTHING = (
    *MATERIAL, effect("creep", a=[0.03, 0.02], tau_s=[5.0, 60.0]), effect("lag", tau_s=0.04), effect("gain", gain=1.1),
    effect("crosstalk", k=0.1), effect("delay", delay_s=0.02),
    SWAP,
)  # fmt: skip


def calibration(*effects: Effect, **provenance: Any) -> Calibration:
    return replace(default(LAYOUT, BOARDS), effects=effects, provenance=provenance)


def walk(n: int = N) -> np.ndarray:
    """Return (n, 28, 12) Pa of steps of 1.1 s."""
    rng = np.random.default_rng(0)
    phase = T_S[:n, None, None] / 1.1 + 0.3 * rng.random((28, 12))
    load = np.maximum(np.sin(2 * np.pi * phase), 0.0) * rng.uniform(5e4, 3e5, (28, 12))
    load[..., ~PRESSURE_TAXELS] = np.nan
    return load


def counts_of(load_pa: np.ndarray, *effects: Effect, noise: float = 0.0) -> np.ndarray:
    read = Chain(effects, LAYOUT, calibration()).forward()(load_pa, T_S[: len(load_pa)])
    return read + noise * np.random.default_rng(1).normal(size=read.shape)


class Live:
    """The model with the static curve before it, as in a foot's pipeline."""

    def __init__(self, *effects: Effect, zeroed: bool = False, began_ns: int = 0, **provenance: Any) -> None:
        made = calibration(*effects, **provenance)
        self.model = DynamicModel(LAYOUT, made, BOARDS, began_ns, zeroed=zeroed)
        self._curve = StaticCurve(made, 0.0)

    def __call__(self, counts: np.ndarray, t_s: np.ndarray, valid: np.ndarray | None = None) -> InvertedCycles:
        usable = np.tile(PRESSURE_TAXELS, (len(counts), len(LAYOUT), 1))
        return self.model(self._curve.pressure_pa(counts), counts, usable if valid is None else valid, t_s)

    def one_by_one(self, counts: np.ndarray) -> np.ndarray:
        return np.concatenate([self(counts[i : i + 1], T_S[i : i + 1]).pressure_pa for i in range(len(counts))])


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(error**2)))


def test_live_cycles_equal_the_offline_result() -> None:
    counts = counts_of(walk(), *MATERIAL, noise=1.0)
    at_once = Live(*EVERYTHING)(counts, T_S).pressure_pa
    live = Live(*EVERYTHING).one_by_one(counts)
    np.testing.assert_allclose(live, at_once, atol=1e-6 * FULL_SCALE_PA)
    offline = Chain(EVERYTHING, LAYOUT, calibration()).live()(counts, T_S)
    np.testing.assert_allclose(live, offline, atol=1e-6 * FULL_SCALE_PA)


def test_effects_with_an_exact_inverse_are_inverted_exactly() -> None:
    effects = (effect("viscoelasticity", a=0.15, tau_s=0.3), effect("creep", a=[0.05], tau_s=[20.0]))
    inverted_pa = Live(*effects).one_by_one(counts_of(walk(), *effects))
    np.testing.assert_allclose(inverted_pa, walk(), atol=1e-6 * FULL_SCALE_PA)


def test_noise_does_not_move_small_plays() -> None:
    counts = counts_of(walk(), *MATERIAL, noise=1.0)
    insole = np.nanmean(walk(), axis=(1, 2))

    def error(pressure_pa: np.ndarray) -> float:
        return rms(np.nanmean(pressure_pa, axis=(1, 2)) - insole)

    live = error(Live(*MATERIAL)(counts, T_S).pressure_pa)
    assert live < 0.9 * error(Chain(MATERIAL, LAYOUT, calibration()).inverse()(counts, T_S))
    assert live < 0.3 * error(Live()(counts, T_S).pressure_pa)


@pytest.mark.parametrize("tau_s", [0.005, 0.02, 0.08])
def test_a_lag_is_inverted_up_to_the_residual_delay(tau_s: float) -> None:
    lag = effect("lag", tau_s=tau_s)
    live = Live(lag)
    most = max(np.sqrt(tau_s / LATE_S), 1.0)
    assert live.model.late_ns == pytest.approx(tau_s / most * 1e9, abs=1)
    noise = Live(lag).one_by_one(counts_of(0.0 * walk(), noise=1.0))[50:]
    assert rms(noise) < 1.05 * most * 8e3, "8 kPa a count"
    later = np.stack([np.interp(T_S - tau_s / most, T_S, taxel) for taxel in walk()[:, 0].T], axis=1)
    inverted_pa = live.one_by_one(counts_of(walk(), lag))[:, 0]
    assert rms((inverted_pa - later)[20:]) < 0.05 * FULL_SCALE_PA
    assert rms((inverted_pa - later)[20:]) < rms(
        (Live()(counts_of(walk(), lag), T_S).pressure_pa[:, 0] - walk()[:, 0])[20:]
    )


def test_a_delay_is_corrected_by_the_stamp_without_future_readings() -> None:
    rear = Where("board", ((7,),))
    live = Live(effect("delay", delay_s=0.02), effect("delay", rear, delay_s=0.01))
    of_board = dict(zip(LAYOUT.identities[:, 0].tolist(), live.model.late_ns.tolist(), strict=True))
    assert of_board == {5: 20_000_000, 6: 20_000_000, 7: 30_000_000}
    counts = counts_of(walk())
    np.testing.assert_array_equal(live(counts, T_S).pressure_pa, Live()(counts, T_S).pressure_pa)


@pytest.mark.parametrize("at", [1, 57, N - 1])
def test_later_cycles_do_not_change_earlier_results(at: int) -> None:
    counts = counts_of(walk(), *MATERIAL)
    other = counts.copy()
    other[at:] = np.random.default_rng(2).uniform(0, 240, other[at:].shape)
    first, second = (Live(*EVERYTHING)(item, T_S).pressure_pa[:at] for item in (counts, other))
    np.testing.assert_array_equal(first, second)


def test_pressure_beyond_the_identified_range_is_static_and_marked() -> None:
    limited = [replace(item, valid_range={"pressure_pa": (0.0, 1e5)}) for item in MATERIAL]
    load = np.where(np.isnan(walk()), np.nan, 0.0)
    load[20:, 0, 0], load[20:, -1, 1] = 99e3, 300e3  # far apart: what a neighbour bears counts too
    counts = counts_of(load)
    limited_result, free = Live(*limited)(counts, T_S), Live(*MATERIAL)(counts, T_S).pressure_pa
    assert limited_result.beyond.sum() == N - 20
    assert limited_result.beyond[20:, -1, 1].all()
    np.testing.assert_allclose(limited_result.pressure_pa[:, 0, 0], free[:, 0, 0])
    np.testing.assert_allclose(limited_result.pressure_pa[:, -1, 1] - 200e3 * (T_S[20] <= T_S), Live(*MATERIAL)(
        counts_of(np.minimum(load, 1e5)), T_S).pressure_pa[:, -1, 1])  # fmt: skip


def test_noise_around_zero_is_not_marked_as_beyond() -> None:
    limited = replace(MATERIAL[1], valid_range={"pressure_pa": (0.0, 1e5)})
    assert not Live(limited)(counts_of(0.0 * walk(), noise=1.0), T_S).beyond.any()


def test_a_gap_keeps_the_last_value() -> None:
    counts = np.rint(counts_of(walk(), *MATERIAL))
    held, valid = counts.copy(), np.tile(PRESSURE_TAXELS, (N, len(LAYOUT), 1))
    held[100:130, 3] = held[99, 3]
    valid[100:130, 3] = False
    broken = counts.copy()
    broken[100:130, 3] = 0
    with_gap, as_held = Live(*MATERIAL)(broken, T_S, valid), Live(*MATERIAL)(held, T_S)
    np.testing.assert_allclose(with_gap.pressure_pa[valid], as_held.pressure_pa[valid])
    static = StaticCurve(calibration(), 0.0).pressure_pa(broken)
    np.testing.assert_array_equal(with_gap.pressure_pa[100:130, 3], static[100:130, 3])
    assert not with_gap.valid[100:130, 3].any()


def test_dropped_cycles_affect_only_the_gap() -> None:
    counts = counts_of(walk(), *MATERIAL)
    kept = np.r_[0:150, 160:N]
    all_of_them, some = Live(*MATERIAL)(counts, T_S).pressure_pa, Live(*MATERIAL)(counts[kept], T_S[kept]).pressure_pa
    assert rms(some[150:155] - all_of_them[160:165]) < 0.02 * FULL_SCALE_PA
    assert rms(some[-50:] - all_of_them[-50:]) < 1e-3 * FULL_SCALE_PA


def test_validity_and_marks_follow_swapped_triangles() -> None:
    a, b = LAYOUT.rows[PAIR[0]], LAYOUT.rows[PAIR[1]]
    valid = np.tile(PRESSURE_TAXELS, (1, len(LAYOUT), 1))
    valid[0, a] = False
    counts = counts_of(walk(1))
    inverted = Live(SWAP)(counts, T_S[:1], valid)
    assert not inverted.valid[0, b].any()
    np.testing.assert_array_equal(inverted.valid[0, a], PRESSURE_TAXELS)
    np.testing.assert_allclose(inverted.pressure_pa[0, a][PRESSURE_TAXELS], walk(1)[0, b][PRESSURE_TAXELS])


DAY_NS = 86_400 * 10**9
DRIFT = effect("drift", t_s=[0.0, 10.0], shift_count=[0.0, 4.0])


@pytest.mark.parametrize(
    ("one", "options", "why"),
    [
        (effect("temperature", count_per_k=0.1, gain_per_k=0.0, t0_c=25.0), {}, "do not send their temperature"),
        (effect("preload", p0_pa=5e3), {"zeroed": True}, "the zero"),
        (effect("baseline", shift_count=5.0), {"zeroed": True}, "the zero"),
        (DRIFT, {"began_ns": 3 * DAY_NS}, "another day"),
        (effect("loss", share=0.01, run=3.0), {}, "no inverse"),
    ],
    ids=lambda value: value.law.word if isinstance(value, Effect) else "",
)
def test_effects_without_inverse_are_left_out_with_the_reason(one: Effect, options: dict[str, Any], why: str) -> None:
    live = Live(one, MATERIAL[1], **options)
    assert [item.law.word for item in live.model.effects] == ["viscoelasticity"]
    assert why in live.model.left_out[0].why


def test_drift_times_count_from_the_begin_of_its_recording() -> None:
    live = Live(DRIFT, began_ns=5 * 10**9, **{BEGAN: 0})
    inverted_pa = live(np.full((1, 28, 12), 238.0), np.zeros(1)).pressure_pa[0, 0, 0]
    assert inverted_pa == pytest.approx(StaticCurve(calibration(), 0.0).pressure_pa(np.full((28, 12), 236.0))[0, 0])


def test_an_hour_of_walking_ends_where_it_began() -> None:
    """Errors do not accumulate: the same step gives the same pressures after many steps as after a few."""
    step = np.rint(counts_of(walk(), *MATERIAL))[:55]
    live = Live(*EVERYTHING[:2], EVERYTHING[3])
    seconds = 0.02 * np.arange(55)
    early = [live(step, seconds + 1.1 * k).pressure_pa for k in range(60)][-1]
    late = live(step, seconds + 3600.0)
    for k in range(1, 60):
        late = live(step, seconds + 3600.0 + 1.1 * k)
    np.testing.assert_allclose(late.pressure_pa, early, atol=1e-6 * FULL_SCALE_PA)
