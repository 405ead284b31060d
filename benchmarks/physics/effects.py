"""Speed of the sensor model: the live compensator, and ten minutes of one foot with every effect.

    python -m benchmarks.physics.effects

The compensator is that of 28 triangles with 8 low-pass modes, 3 plays and 6 relays, undone frame by frame; the ten
minutes go from the load to counts and back, in one call each, as the lab does it.

Takes about half a minute.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from numpy.typing import NDArray

from insole_daemon.config import Config
from insole_daemon.physics.calibration import Calibration, default
from insole_daemon.physics.chain import Chain
from insole_daemon.physics.effect import Effect, Where, effect
from insole_daemon.physics.effects.creep import log_spaced_s
from insole_daemon.physics.sampling import CDC_HZ
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.layout import Layout, builtin

BOARDS = Config().insoles[0].boards

COMPENSATOR = [
    effect("creep", a=[0.01] * 8, tau_s=log_spaced_s(0.05, 500.0, 8)),
    effect("hysteresis", r_pa=[2e3, 8e3, 2e4], w=[0.05, 0.03, 0.02]),
    *(effect("snap", up_pa=2e4 + 1e4 * i, down_pa=1e4 + 5e3 * i, step_pa=2e3) for i in range(6)),
]

REAR = Where("board", ((7,),))

# What can be undone, and then what cannot.
EVERY: list[Effect] = [
    effect("map_transform", x_mm=2.0, y_mm=-1.0, rotation_deg=1.0, scale=1.01),
    effect("swapped_triangles", Where("triangle", ((5, 0), (5, 1))), pair=[[5, 0], [5, 1]]),
    effect("preload", p0_pa=5e3),
    effect("crosstalk", k=0.15),
    effect("hysteresis", r_pa=[2e3, 8e3, 2e4], w=[0.05, 0.03, 0.02]),
    effect("snap", Where("board", ((6,),)), up_pa=4e4, down_pa=2e4, step_pa=6e3),
    effect("viscoelasticity", a=0.1, tau_s=0.3),
    effect("creep", a=[0.01] * 6, tau_s=log_spaced_s(0.5, 500.0, 6)),
    effect("power_creep", a=0.03, exponent=0.2, t0_s=60.0),
    effect("lag", tau_s=0.03),
    effect("plates", REAR, area_mm2=19.0, gap_mm=2.0, stiffness_n_per_m=9000.0, permittivity=1.5, ff_per_count=0.96),
    effect("permittivity", gas_permittivity=1.0, solid_permittivity=2.5, solid_share=0.1, rest_count=300.0),
    effect("stiffening", knee_pa=3e5, span_pa=5e5),
    effect("gain", gain=1.1),
    effect("baseline", shift_count=2.0),
    effect("temperature", count_per_k=0.2, gain_per_k=0.005, t0_c=25.0),
    effect("compensation", skin_type=0, generation=4, count_per_k=0.2, t0_c=25.0),
    effect("drift", t_s=[0.0, 600.0], shift_count=[0.0, 3.0]),
    effect("rezero", REAR, t_s=300.0, shift_count=-5.0),
    effect("clock", offset_s=0.4, rate=2e-5),
]
LOSSY = [
    effect("bit_shift", shift=4),
    effect("sample_and_hold", rate_hz=CDC_HZ),
    effect("delay", delay_s=0.02),
    effect("jitter", std_s=0.001),
    effect("loss", share=0.001, run=5.0),
]


def cubic(layout: Layout) -> Calibration:
    """A calibration of third degree, as the paper's: `default` is a line, which is no work to invert."""
    line = default(layout, BOARDS)
    coefficients = np.where(line.usable[..., None], (0.0, 7900.0, 12.0, 0.11), np.nan)
    return Calibration(layout.foot, line.baseline_count, coefficients, None, line.usable, {})


def walk(n: int, rate_hz: float) -> NDArray[np.float64]:
    """(n, 28, 12) Pa: steps of 1.1 s, each taxel with a moment and a peak of its own."""
    rng = np.random.default_rng(0)
    phase = np.arange(n)[:, None, None] / rate_hz / 1.1 + rng.random((28, 12))
    load = np.maximum(np.sin(2 * np.pi * phase), 0.0) * rng.uniform(5e4, 3.5e5, (28, 12))
    load[..., ~PRESSURE_TAXELS] = np.nan
    return load


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--frames", type=int, default=5_000, help="of the compensator live")
    options = parser.parse_args()
    layout = builtin("left", (5, 6, 7))
    calibration = cubic(layout)

    compensate = Chain(COMPENSATOR, layout, calibration).inverse()
    frames = options.frames
    counts = np.rint(Chain([], layout, calibration).forward()(walk(frames, 50.0), np.arange(frames) / 50.0))
    spent_us = np.empty(frames)
    for i in range(frames):
        t_s = np.array([i * 0.02 + 1e-4 * (i % 3)])
        begin = time.perf_counter_ns()
        compensate(counts[i : i + 1], t_s)
        spent_us[i] = (time.perf_counter_ns() - begin) * 1e-3
    p50, p99 = np.percentile(spent_us, [50, 99])
    print(f"compensator, 28 triangles, frame by frame: {p50:.0f} µs p50, {p99:.0f} µs p99")

    for rate_hz in (50.0, 200.0):
        n = round(options.minutes * 60 * rate_hz)
        t_s, load = np.arange(n) / rate_hz, walk(n, rate_hz)
        warm_c = 25.0 + 5.0 * np.sin(t_s / 100)
        begin = time.process_time()
        Chain(EVERY + LOSSY, layout, calibration, BOARDS).forward()(load, t_s, warm_c)
        there = time.process_time()
        chain = Chain(EVERY, layout, calibration, BOARDS)
        counts = chain.forward()(load, t_s, warm_c)
        between = time.process_time()
        chain.inverse()(counts, t_s, warm_c)
        back = time.process_time()
        print(
            f"{options.minutes:g} min of one foot at {rate_hz:g} Hz, every effect: "
            f"{there - begin:.1f} s of CPU to counts, {back - between:.1f} s back"
        )


if __name__ == "__main__":
    main()
