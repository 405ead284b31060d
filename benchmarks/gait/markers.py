"""Accuracy of clock alignment by markers: 1 000 series of 60 and of 12 markers with an offset of 0.8 s and 80 ppm.

    python -m benchmarks run gait.markers

Takes 20 seconds.

Moments are random in ten minutes; both clocks stamp them with 1 ms of jitter. One system misses two of them, the other
three, and has four that are false.
"""

from __future__ import annotations

import numpy as np

from insole_daemon.calibration.marker_clock import fit_marker_clock

SERIES, SECONDS, JITTER_S = 1000, 600.0, 0.001
OFFSET_S, RATE = 0.8, 80e-6
MOST_OFFSET_S, MOST_RATE = 0.002, 5e-6


def errors(n: int, seed: int) -> tuple[float, float]:
    """Return the errors of offset, in the middle of the series, in s and of the rate, with `n` moments."""
    random = np.random.default_rng(seed)
    true_s = np.sort(random.uniform(0, SECONDS, n))
    own_s, other_s = (true_s + JITTER_S * random.standard_normal(n) for _ in range(2))
    other_s = OFFSET_S + (1 + RATE) * other_s
    own_s = np.delete(own_s, random.choice(n, 2, replace=False))
    other_s = np.delete(other_s, random.choice(n, 3, replace=False))
    clock = fit_marker_clock(own_s, np.sort(np.append(other_s, random.uniform(0, SECONDS, 4))))
    middle_s = SECONDS / 2
    return float(clock.reference_s(np.array(middle_s)) - OFFSET_S - (1 + RATE) * middle_s), clock.rate - RATE


def main() -> None:
    print("| moments | offset, 95 % within | worst | rate, 95 % within | worst | within 2 ms and 5 ppm |")
    print("|---|---|---|---|---|---|")
    for n in (60, 12):
        offset_s, rate = np.abs(np.array([errors(n, seed) for seed in range(SERIES)])).T
        within = np.mean((offset_s < MOST_OFFSET_S) & (rate < MOST_RATE))
        cells = (
            f"{1e3 * np.percentile(offset_s, 95):.2f} ms | {1e3 * offset_s.max():.2f} ms",
            f"{1e6 * np.percentile(rate, 95):.1f} ppm | {1e6 * rate.max():.1f} ppm",
        )
        print(f"| {n} | {' | '.join(cells)} | {within:.1%} |", flush=True)


if __name__ == "__main__":
    main()
