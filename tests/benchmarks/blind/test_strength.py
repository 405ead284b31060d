"""k x the floor, computed once more from its definition."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind.case import UnsolvedError
from benchmarks.blind.chain import chain
from benchmarks.blind.chamber_case import chamber_case
from benchmarks.blind.effect import conceal
from benchmarks.blind.geometry import insole
from benchmarks.blind.loads import chamber
from benchmarks.blind.plan import Spec
from benchmarks.blind.sensor import sensors
from benchmarks.blind.strength import GRID_S, Measure, solve


@pytest.mark.parametrize(
    ("word", "scope", "own_clock"),
    [("viscoelasticity", "triangle", False), ("lag", "board", True), ("rezero", "board", True)],
)
def test_solved_strength_is_the_definition(word, scope, own_clock):
    rng = np.random.default_rng(4)
    geometry, these, load = insole("left", 5), sensors(rng), chamber(rng, "full", "plenum")
    effect = conceal(rng, geometry, load, word, scope)
    effect = solve(Measure(load, these, effect, own_clock), 3.0)
    seconds = np.arange(0, load.main_s, GRID_S)
    every = np.repeat(seconds[:, None], 28, 1)
    clean = chain(load, these, ()).mean_byte(every)[:, :, [k for k in range(12) if k not in (6, 10)]]
    with_it = chain(load, these, (effect,)).mean_byte(every)[:, :, [k for k in range(12) if k not in (6, 10)]]
    pressure = np.interp(seconds, load.seconds, load.pressure_pa) / load.span_pa
    static = np.stack([np.ones_like(pressure), pressure, pressure**2, pressure**3], 1)

    def off_static(x: np.ndarray) -> np.ndarray:
        flat = x.reshape(len(x), -1)
        return flat - static @ np.linalg.lstsq(static, flat, rcond=None)[0]

    left = off_static(with_it - clean)
    if own_clock:
        slope = np.gradient(clean, GRID_S, axis=0)
        clock = np.stack([off_static(slope).ravel(), off_static(slope * seconds[:, None, None]).ravel()], 1)
        left = (left.ravel() - clock @ np.linalg.lstsq(clock, left.ravel(), rcond=None)[0]).reshape(left.shape)
    affected = effect.place[:, [k for k in range(12) if k not in (6, 10)]].ravel()
    noise = np.sqrt(these.noise[:, [k for k in range(12) if k not in (6, 10)]].ravel()[affected] ** 2 + 1 / 12)
    found = np.sqrt(np.mean(left[:, affected] ** 2)) / np.sqrt(np.mean(noise**2))
    assert found == pytest.approx(3.0, rel=0.03)


def test_out_of_range_stays_at_the_limit():
    rng = np.random.default_rng(5)
    geometry, these, load = insole("left", 5), sensors(rng), chamber(rng, "full", "bag")
    effect = conceal(rng, geometry, load, "creep", "insole")
    assert solve(Measure(load, these, effect, False), 1000.0).amplitude == effect.limits[1]


@pytest.mark.parametrize("k", [np.nan, np.inf, 3.9e8])
def test_a_strength_that_is_none_is_refused(k):
    case = chamber_case(6, 0, Spec("null"))
    assert replace(case, k={"bit_shift": 70.0}).k
    with pytest.raises(UnsolvedError, match="expected a hysteresis of 0 x the floor"):
        replace(case, k={"hysteresis": k})
