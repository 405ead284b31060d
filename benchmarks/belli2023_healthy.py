"""Which taxels of the published left insole are worth judging, and which of their samples: from calibration data alone.

    python benchmarks/belli2023_healthy.py [folder with the data, ../shared/data/belli2023]

A taxel is taken if, in `calibration_dataset`, it is never at 0 or 255, loses at least LEAST_COUNTS of its counts at the
top pressure, and is quiet: if its noise, smoothed as all models smooth it, would alone take a tenth of the samples
further than 0.15 bar from the truth, no model can be judged by it.

A sample is masked, causally, if within the last second the taxel read 0 or 255, or jumped further from one cycle to the
next than MOST_STEPS times what any of the chosen ones ever did in the calibration data.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from belli2023_data import CALIBRATION, FOLDER, Trial, read
from numpy.typing import NDArray

from insole_daemon.calibration.follow_up import COUNT_SHARE, smoothed

LEAST_COUNTS = 10.0
MOST_NOISE_BAR = 0.15 / 1.645  # 90 % of a normal distribution lie within 1.645 standard deviations
MOST_STEPS = 2.0
MASKED_ROWS = 50  # a second
_LOCAL_ROWS = 250  # of the mean that noise is counted from: slower than noise, faster than the chamber's steps


@dataclass(frozen=True, slots=True)
class Healthy:
    """What the calibration data say."""

    taxels: NDArray[np.intp]  # of the 280 columns
    most_step_count: float


def healthy(calibration: Trial) -> Healthy:
    """The taxels, and how far they may jump."""
    counts = calibration.counts
    activation = counts[:MASKED_ROWS].mean(axis=0) - smoothed(counts, COUNT_SHARE)
    top_pa = np.quantile(calibration.pressure_pa, 0.99)
    lost = np.quantile(activation, 0.99, axis=0)
    local = np.lib.stride_tricks.sliding_window_view(activation, _LOCAL_ROWS, axis=0)[::_LOCAL_ROWS]
    noise_bar = np.median(local.std(axis=2), axis=0) / np.maximum(lost, 1e-9) * top_pa / 1e5
    on_rails = ((counts == 0) | (counts == 255)).any(axis=0)
    taxels = np.flatnonzero(~on_rails & (lost >= LEAST_COUNTS) & (noise_bar <= MOST_NOISE_BAR))
    steps = np.abs(np.diff(counts[:, taxels], axis=0)).max(axis=0)
    return Healthy(taxels, MOST_STEPS * float(np.quantile(steps, 0.9)))


def valid(counts: NDArray[np.float64], most_step_count: float) -> NDArray[np.bool_]:
    """(n, m) samples that may be judged."""
    bad = (counts == 0) | (counts == 255)
    bad[1:] |= np.abs(np.diff(counts, axis=0)) > most_step_count
    last = np.maximum.accumulate(np.where(bad, np.arange(len(counts))[:, None], -MASKED_ROWS), axis=0)
    return np.arange(len(counts))[:, None] - last >= MASKED_ROWS


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    trial = read(folder / CALIBRATION)
    found = healthy(trial)
    judged = valid(trial.counts[:, found.taxels], found.most_step_count).mean()
    print(
        f"{len(found.taxels)} of {trial.counts.shape[1]} taxels, {judged:.2%} of their samples in the calibration data"
    )
    print(f"masked for a second: 0, 255, and steps of more than {found.most_step_count:g} counts")
    print("columns:", *found.taxels)


if __name__ == "__main__":
    main()
