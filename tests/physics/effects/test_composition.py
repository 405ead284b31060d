"""Several effects with memory in sequence, at the simulator's rate, compared with small steps of all of them.

Each effect is exact for a signal that is linear between samples, but its output is not: plays and relays kink within a
step, and a lag bends. docs/simulator.md states the resulting errors.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from insole_daemon.physics.chain import Chain
from insole_daemon.physics.effect import Effect, effect
from insole_daemon.simulation.sensed import GRID_S
from insole_daemon.skin.layout import builtin

Array = NDArray[np.float64]

LAYOUT = builtin("left", (5, 6, 7))
FULL_SCALE_PA = 3.4e5
FINER = 200

HYSTERESIS = effect("hysteresis", r_pa=[500.0, 2000.0, 8000.0], w=[0.02, 0.02, 0.03])
SNAP = effect("snap", up_pa=35e3, down_pa=15e3, step_pa=2000.0)
LINEAR = [
    effect("viscoelasticity", a=0.08, tau_s=0.4),
    effect("creep", a=[0.01, 0.01, 0.02], tau_s=[2.0, 20.0, 200.0]),
    effect("lag", tau_s=0.015),
]


def steps() -> Array:
    """Return (n, 12) Pa every GRID_S: two steps with a different peak on each taxel."""
    t_s = np.arange(0.0, 2.2, GRID_S)[:, None]
    late_s, peak_pa = np.linspace(0.0, 0.3, 12), np.linspace(0.2, 1.0, 12) * FULL_SCALE_PA
    load: Array = peak_pa * np.maximum(np.sin(np.pi * ((t_s - late_s) % 1.1) / 0.6), 0.0) * ((t_s - late_s) % 1.1 < 0.6)
    return load * (t_s >= late_s)


def in_small_steps(load: Array, plays: bool, snaps: bool) -> Array:
    """Return (n, 12) the output of all effects, with each step of GRID_S divided in FINER; uses the middle of each
    step.
    """
    h = GRID_S / FINER
    sliders, on = np.zeros((3, 12)), np.zeros(12, bool)
    r, w = np.array([[500.0], [2000.0], [8000.0]]), np.array([[0.02], [0.02], [0.03]])
    a, tau = np.array([[0.08], [0.01], [0.01], [0.02]]), np.array([[0.4], [2.0], [20.0], [200.0]])
    z, lagged, before = np.tile(load[0], (4, 1)), load[0].copy(), load[0].copy()
    of_solid, of_creep, of_lag = -np.expm1(-h / tau[:1]), -np.expm1(-h / tau[1:]), -np.expm1(-h / 0.015)
    solid_before = bent_before = before
    lagged_steps = [lagged]
    for i in range(1, len(load)):
        for k in range(1, FINER + 1):
            bent = load[i - 1] + (load[i] - load[i - 1]) * (k / FINER)
            if plays:
                sliders = np.maximum(bent - r, np.minimum(bent + r, sliders))
                bent = 0.93 * bent + (w * sliders).sum(axis=0)
            if snaps:
                on = (on & (bent > 15e3)) | (bent >= 35e3)
                bent = bent + 2000.0 * on
            z[:1] += of_solid * ((bent_before + bent) / 2 - z[:1])
            solid = (1 - 0.08) * bent + 0.08 * z[0]
            z[1:] += of_creep * ((solid_before + solid) / 2 - z[1:])
            crept = (1 - 0.04) * solid + (a[1:] * z[1:]).sum(axis=0)
            lagged = lagged + of_lag * ((before + crept) / 2 - lagged)
            before, solid_before, bent_before = crept, solid, bent
        lagged_steps.append(lagged)
    return np.array(lagged_steps)


@pytest.mark.parametrize(
    ("memory", "of_full_scale"),
    [([], 3e-5), ([HYSTERESIS], 2e-4), ([HYSTERESIS, SNAP], 3e-3)],
    ids=["linear", "hysteresis", "hysteresis and snap"],
)
def test_a_chain_is_accurate_at_the_simulators_rate(memory: list[Effect], of_full_scale: float) -> None:
    load = steps()
    expected = in_small_steps(load, HYSTERESIS in memory, SNAP in memory)
    whole = np.zeros((len(load), 28, 12))
    whole[:, 3] = load
    on_grid = Chain([*memory, *LINEAR], LAYOUT).forward()(whole, np.arange(len(load)) * GRID_S)[:, 3]
    error = np.abs(on_grid - expected) / FULL_SCALE_PA
    assert error.max() < of_full_scale
    assert np.sqrt((error**2).mean()) < of_full_scale / 5
