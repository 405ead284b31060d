"""The dynamic model, cycle by cycle: what it finds, what it remembers, where it stops."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from insole_daemon.config import Config
from insole_daemon.physics.calibration import BEGAN, Calibration, default
from insole_daemon.physics.chain import Chain
from insole_daemon.physics.dynamic import DynamicModel, Undone
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
PAIR = tuple(tuple(each) for each in LAYOUT.identities[[0, -1]].tolist())
SWAP = effect("swapped_triangles", Where("triangle", PAIR), pair=PAIR)
EVERYTHING = (
    *MATERIAL, effect("creep", a=[0.03, 0.02], tau_s=[5.0, 60.0]), effect("lag", tau_s=0.04), effect("gain", gain=1.1),
    effect("crosstalk", k=0.1), effect("delay", delay_s=0.02),
    SWAP,
)  # fmt: skip


def calibration(*effects: Effect, **provenance: Any) -> Calibration:
    return replace(default(LAYOUT, BOARDS), effects=effects, provenance=provenance)


def walk(n: int = N) -> np.ndarray:
    """(n, 28, 12) Pa: steps of 1.1 s."""
    rng = np.random.default_rng(0)
    phase = T_S[:n, None, None] / 1.1 + 0.3 * rng.random((28, 12))
    load = np.maximum(np.sin(2 * np.pi * phase), 0.0) * rng.uniform(5e4, 3e5, (28, 12))
    load[..., ~PRESSURE_TAXELS] = np.nan
    return load


def counts_of(load_pa: np.ndarray, *effects: Effect, noise: float = 0.0) -> np.ndarray:
    read = Chain(effects, LAYOUT, calibration()).forward()(load_pa, T_S[: len(load_pa)])
    return read + noise * np.random.default_rng(1).normal(size=read.shape)


class Live:
    """The model and the static curve before it, as a foot has them."""

    def __init__(self, *effects: Effect, zeroed: bool = False, began_ns: int = 0, **provenance: Any) -> None:
        made = calibration(*effects, **provenance)
        self.model = DynamicModel(LAYOUT, made, BOARDS, began_ns, zeroed=zeroed)
        self._curve = StaticCurve(made, 0.0)

    def __call__(self, counts: np.ndarray, t_s: np.ndarray, valid: np.ndarray | None = None) -> Undone:
        usable = np.tile(PRESSURE_TAXELS, (len(counts), len(LAYOUT), 1))
        return self.model(self._curve.pressure_pa(counts), counts, usable if valid is None else valid, t_s)

    def one_by_one(self, counts: np.ndarray) -> np.ndarray:
        return np.concatenate([self(counts[i : i + 1], T_S[i : i + 1]).pressure_pa for i in range(len(counts))])


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(error**2)))


def test_cycle_by_cycle_it_is_what_it_is_offline() -> None:
    counts = counts_of(walk(), *MATERIAL, noise=1.0)
    at_once = Live(*EVERYTHING)(counts, T_S).pressure_pa
    live = Live(*EVERYTHING).one_by_one(counts)
    np.testing.assert_allclose(live, at_once, atol=1e-6 * FULL_SCALE_PA)
    offline = Chain(EVERYTHING, LAYOUT, calibration()).live()(counts, T_S)
    np.testing.assert_allclose(live, offline, atol=1e-6 * FULL_SCALE_PA)


def test_what_has_an_exact_inverse_is_undone_exactly() -> None:
    effects = (effect("viscoelasticity", a=0.15, tau_s=0.3), effect("creep", a=[0.05], tau_s=[20.0]))
    found = Live(*effects).one_by_one(counts_of(walk(), *effects))
    np.testing.assert_allclose(found, walk(), atol=1e-6 * FULL_SCALE_PA)


def test_noise_does_not_drag_plays_about() -> None:
    counts = counts_of(walk(), *MATERIAL, noise=1.0)
    insole = np.nanmean(walk(), axis=(1, 2))

    def error(pressure_pa: np.ndarray) -> float:
        return rms(np.nanmean(pressure_pa, axis=(1, 2)) - insole)

    live = error(Live(*MATERIAL)(counts, T_S).pressure_pa)
    assert live < 0.9 * error(Chain(MATERIAL, LAYOUT, calibration()).inverse()(counts, T_S))
    assert live < 0.3 * error(Live()(counts, T_S).pressure_pa)


@pytest.mark.parametrize("tau_s", [0.005, 0.02, 0.08])
def test_a_lag_is_undone_as_far_as_its_gain_allows(tau_s: float) -> None:
    lag = effect("lag", tau_s=tau_s)
    live = Live(lag)
    most = max(np.sqrt(tau_s / LATE_S), 1.0)
    assert live.model.late_ns == pytest.approx(tau_s / most * 1e9, abs=1)
    noise = Live(lag).one_by_one(counts_of(0.0 * walk(), noise=1.0))[50:]
    assert rms(noise) < 1.05 * most * 8e3, "8 kPa a count"
    later = np.stack([np.interp(T_S - tau_s / most, T_S, taxel) for taxel in walk()[:, 0].T], axis=1)
    found = live.one_by_one(counts_of(walk(), lag))[:, 0]
    assert rms((found - later)[20:]) < 0.05 * FULL_SCALE_PA
    assert rms((found - later)[20:]) < rms((Live()(counts_of(walk(), lag), T_S).pressure_pa[:, 0] - walk()[:, 0])[20:])


def test_what_is_late_is_stamped_and_never_looked_ahead_for() -> None:
    rear = Where("board", ((7,),))
    live = Live(effect("delay", delay_s=0.02), effect("delay", rear, delay_s=0.01))
    of_board = dict(zip(LAYOUT.identities[:, 0].tolist(), live.model.late_ns.tolist(), strict=True))
    assert of_board == {5: 20_000_000, 6: 20_000_000, 7: 30_000_000}
    counts = counts_of(walk())
    np.testing.assert_array_equal(live(counts, T_S).pressure_pa, Live()(counts, T_S).pressure_pa)


@pytest.mark.parametrize("at", [1, 57, N - 1])
def test_nothing_later_is_used(at: int) -> None:
    counts = counts_of(walk(), *MATERIAL)
    other = counts.copy()
    other[at:] = np.random.default_rng(2).uniform(0, 240, other[at:].shape)
    first, second = (Live(*EVERYTHING)(each, T_S).pressure_pa[:at] for each in (counts, other))
    np.testing.assert_array_equal(first, second)


def test_beyond_what_it_was_identified_to_the_static_curve_goes_on_and_it_is_marked() -> None:
    limited = [replace(each, valid_range={"pressure_pa": (0.0, 1e5)}) for each in MATERIAL]
    load = np.where(np.isnan(walk()), np.nan, 0.0)
    load[20:, 0, 0], load[20:, -1, 1] = 99e3, 300e3  # far apart: what a neighbour bears counts too
    counts = counts_of(load)
    found, free = Live(*limited)(counts, T_S), Live(*MATERIAL)(counts, T_S).pressure_pa
    assert found.beyond.sum() == N - 20
    assert found.beyond[20:, -1, 1].all()
    np.testing.assert_allclose(found.pressure_pa[:, 0, 0], free[:, 0, 0])
    np.testing.assert_allclose(found.pressure_pa[:, -1, 1] - 200e3 * (T_S[20] <= T_S), Live(*MATERIAL)(
        counts_of(np.minimum(load, 1e5)), T_S).pressure_pa[:, -1, 1])  # fmt: skip


def test_noise_about_nothing_is_not_beyond() -> None:
    limited = replace(MATERIAL[1], valid_range={"pressure_pa": (0.0, 1e5)})
    assert not Live(limited)(counts_of(0.0 * walk(), noise=1.0), T_S).beyond.any()


def test_a_gap_is_taken_for_what_was_last_said() -> None:
    counts = np.rint(counts_of(walk(), *MATERIAL))
    held, valid = counts.copy(), np.tile(PRESSURE_TAXELS, (N, len(LAYOUT), 1))
    held[100:130, 3] = held[99, 3]
    valid[100:130, 3] = False
    broken = counts.copy()
    broken[100:130, 3] = 0
    found, as_held = Live(*MATERIAL)(broken, T_S, valid), Live(*MATERIAL)(held, T_S)
    np.testing.assert_allclose(found.pressure_pa[valid], as_held.pressure_pa[valid])
    static = StaticCurve(calibration(), 0.0).pressure_pa(broken)
    np.testing.assert_array_equal(found.pressure_pa[100:130, 3], static[100:130, 3])
    assert not found.valid[100:130, 3].any()


def test_cycles_that_were_dropped_cost_what_was_between_and_no_more() -> None:
    counts = counts_of(walk(), *MATERIAL)
    kept = np.r_[0:150, 160:N]
    all_of_them, some = Live(*MATERIAL)(counts, T_S).pressure_pa, Live(*MATERIAL)(counts[kept], T_S[kept]).pressure_pa
    assert rms(some[150:155] - all_of_them[160:165]) < 0.02 * FULL_SCALE_PA
    assert rms(some[-50:] - all_of_them[-50:]) < 1e-3 * FULL_SCALE_PA


def test_a_pair_that_is_swapped_takes_its_marks_along() -> None:
    a, b = LAYOUT.rows[PAIR[0]], LAYOUT.rows[PAIR[1]]
    valid = np.tile(PRESSURE_TAXELS, (1, len(LAYOUT), 1))
    valid[0, a] = False
    counts = counts_of(walk(1))
    found = Live(SWAP)(counts, T_S[:1], valid)
    assert not found.valid[0, b].any()
    np.testing.assert_array_equal(found.valid[0, a], PRESSURE_TAXELS)
    np.testing.assert_allclose(found.pressure_pa[0, a][PRESSURE_TAXELS], walk(1)[0, b][PRESSURE_TAXELS])


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
def test_what_cannot_be_undone_is_left_out_and_says_why(one: Effect, options: dict[str, Any], why: str) -> None:
    live = Live(one, MATERIAL[1], **options)
    assert [each.law.word for each in live.model.effects] == ["viscoelasticity"]
    assert why in live.model.left_out[0].why


def test_a_drift_counts_from_where_its_recording_began() -> None:
    live = Live(DRIFT, began_ns=5 * 10**9, **{BEGAN: 0})
    found = live(np.full((1, 28, 12), 238.0), np.zeros(1)).pressure_pa[0, 0, 0]
    assert found == pytest.approx(StaticCurve(calibration(), 0.0).pressure_pa(np.full((28, 12), 236.0))[0, 0])


def test_an_hour_of_walking_ends_where_it_began() -> None:
    """Nothing builds up: the same step gives the same pressures after many as after some."""
    step = np.rint(counts_of(walk(), *MATERIAL))[:55]
    live = Live(*EVERYTHING[:2], EVERYTHING[3])
    seconds = 0.02 * np.arange(55)
    early = [live(step, seconds + 1.1 * k).pressure_pa for k in range(60)][-1]
    late = live(step, seconds + 3600.0)
    for k in range(1, 60):
        late = live(step, seconds + 3600.0 + 1.1 * k)
    np.testing.assert_allclose(late.pressure_pa, early, atol=1e-6 * FULL_SCALE_PA)
