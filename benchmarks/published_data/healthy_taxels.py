"""Taxels and samples of the published left insole that are fit to judge models, chosen by calibration data alone.

    python -m benchmarks.published_data.healthy_taxels [folder with the data, ../shared/data/belli2023]

A taxel is taken if, in `calibration_dataset`, it is never at 0 or 255, loses at least LEAST_COUNTS of its counts at the
top pressure, and is quiet: if its noise, smoothed as all models smooth it, would alone take a tenth of the samples
further than 0.15 bar from the truth, no model can be judged by it.

A sample is masked, causally,
- if within the last second the taxel read 0 or 255, or jumped further from one cycle to the next than AMPLE times what
  nine of ten of the chosen ones ever did in the calibration data;
- if it has said the same for AMPLE times as long as any of them ever did;
- while its board stands on a step. In the calibration data all triangles of the middle board go down by 22 counts
  within a tenth of a second at 0.35 bar, and back at 0.23 bar: no load, but a contact. In between their noise is three
  to five times what it was. A taxel that is masked most of the time is not taken.

Takes about half a minute.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.published_data.belli2023 import CALIBRATION, FOLDER, Trial, read, slots
from insole_daemon.calibration.follow_up import COUNT_SHARE, smooth_causally
from insole_daemon.skin.geometry import N_TAXELS

LEAST_COUNTS = 10.0
MOST_NOISE_BAR = 0.15 / 1.645  # 90 % of a normal distribution lie within 1.645 standard deviations
AMPLE = 2.0
MASKED_ROWS = 50  # a second
STEP_COUNTS = 8.0  # of a board's step, at least; the others change by 2 at the most
STEP_ROWS = 6  # that it takes
STEP_ALIKE, STEP_MOST = 0.4, 0.6  # of its size that a triangle may differ from it, and how many have to be so alike
_LOCAL_ROWS = 250  # of the mean that noise is counted from: slower than noise, faster than the chamber's steps


@dataclass(frozen=True, slots=True)
class Healthy:
    """What the calibration data say."""

    taxels: NDArray[np.intp]  # of the 280 columns
    most_step_count: float
    most_same_rows: int

    def valid(self, trial: Trial) -> NDArray[np.bool_]:
        """(n, m) samples of the taxels that may be judged."""
        counts = trial.counts[:, self.taxels]
        at = np.arange(len(counts))[:, None]
        change = np.abs(np.diff(counts, axis=0, prepend=counts[:1]))
        bad = (counts == 0) | (counts == 255) | (change > self.most_step_count)
        last = np.maximum.accumulate(np.where(bad, at, -MASKED_ROWS), axis=0)
        same = at - _changed(counts)
        return (at - last >= MASKED_ROWS) & (same <= self.most_same_rows) & ~stepped(trial)[:, self.taxels]


def stepped(trial: Trial) -> NDArray[np.bool_]:
    """(n, 280) whether a taxel's board stands on a step."""
    triangle = slots(trial.layout) // N_TAXELS
    boards = trial.layout.identities[:, 0]
    medians = np.stack([np.median(trial.counts[:, triangle == t], axis=1) for t in range(len(boards))], axis=1)
    change = medians[STEP_ROWS:] - medians[:-STEP_ROWS]
    on = np.zeros(medians.shape, np.bool_)
    for board in np.unique(boards):
        own = np.flatnonzero(boards == board)
        size = np.median(change[:, own], axis=1)
        alike = (np.abs(change[:, own] - size[:, None]) <= STEP_ALIKE * np.abs(size[:, None])).mean(axis=1)
        at = np.flatnonzero((alike >= STEP_MOST) & (np.abs(size) >= STEP_COUNTS))
        # The newest step says where the board stands now: down is on, back up is off, a second later.
        newest = np.searchsorted(at + STEP_ROWS, np.arange(len(on)), side="right") - 1
        down = np.concatenate([size[at] < 0, [False]])[newest]
        since = np.arange(len(on)) - np.concatenate([at + STEP_ROWS, [-MASKED_ROWS]])[newest]
        on[:, own] = (down | (since < MASKED_ROWS))[:, None]
    return on[:, triangle]


def _changed(counts: NDArray[np.float64]) -> NDArray[np.intp]:
    """(n, m) the row in which each taxel last said something new."""
    new = np.diff(counts, axis=0, prepend=counts[:1]) != 0
    return np.maximum.accumulate(np.where(new, np.arange(len(counts))[:, None], 0), axis=0)


def healthy(calibration: Trial) -> Healthy:
    """The taxels, and how far they may jump."""
    counts = calibration.counts
    activation = counts[:MASKED_ROWS].mean(axis=0) - smooth_causally(counts, COUNT_SHARE)
    top_pa = np.quantile(calibration.pressure_pa, 0.99)
    lost = np.quantile(activation, 0.99, axis=0)
    local = np.lib.stride_tricks.sliding_window_view(activation, _LOCAL_ROWS, axis=0)[::_LOCAL_ROWS]
    noise_bar = np.median(local.std(axis=2), axis=0) / np.maximum(lost, 1e-9) * top_pa / 1e5
    on_rails = ((counts == 0) | (counts == 255)).any(axis=0)
    taxels = np.flatnonzero(
        ~on_rails & ~(stepped(calibration).mean(axis=0) > 0.5) & (lost >= LEAST_COUNTS) & (noise_bar <= MOST_NOISE_BAR)
    )
    steps = np.abs(np.diff(counts[:, taxels], axis=0)).max(axis=0)
    same = np.arange(len(counts))[:, None] - _changed(counts[:, taxels])
    return Healthy(taxels, AMPLE * float(np.quantile(steps, 0.9)), int(AMPLE * same.max()))


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    trial = read(folder / CALIBRATION)
    found = healthy(trial)
    judged = found.valid(trial).mean()
    print(
        f"{len(found.taxels)} of {trial.counts.shape[1]} taxels, {judged:.2%} of their samples in the calibration data"
    )
    print(f"masked for a second: 0, 255, and steps of more than {found.most_step_count:g} counts")
    print(f"masked: what stays the same for more than {found.most_same_rows} cycles")
    print("columns:", *found.taxels)


if __name__ == "__main__":
    main()
