"""Offset and rate of the gauge's clock in every published file, compared with pairing by row.

    python -m benchmarks.published_data.clocks [folder with the data, ../shared/data/belli2023]

From the mean of the middle half of the taxels that move, are never at 0 or 255, and whose board does not step; their
counts are not smoothed.

Takes about a minute.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from benchmarks.published_data.belli2023 import FOLDER, read
from benchmarks.published_data.healthy_taxels import stepped
from insole_daemon.calibration import clock as clocks
from insole_daemon.calibration import follow_up


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    print("| file | length | taxels | offset | rate | edges explained |\n|---|---|---|---|---|---|")
    for path in sorted(folder.glob("*_insole/*.mat")):
        trial = read(path)
        counts = trial.counts
        moves = ~((counts == 0) | (counts == 255)).any(axis=0) & (counts.std(axis=0) > 2.0)
        moves &= ~stepped(trial).any(axis=0)
        middle = np.sort(counts[:, moves], axis=1)[:, moves.sum() // 4 : -(moves.sum() // 4)]
        activation = -middle.mean(axis=1)
        activation -= activation[0]
        kept = follow_up.select_rows(trial.pressure_pa)
        reference_s = clocks.row_times_s(trial.t_s, len(trial.pressure_pa))[kept]
        found = clocks.fit_clock(
            trial.t_s, activation[:, None] ** np.arange(1, 4), reference_s, trial.pressure_pa[kept]
        )
        print(
            f"| {path.parent.name}/{path.stem} | {trial.t_s[-1]:.0f} s | {moves.sum()} "
            f"| {found.offset_s:+.2f} ± {found.offset_std_s:.2f} s "
            f"| {1e2 * found.rate:+.2f} ± {1e2 * found.rate_std:.2f} % | {found.explained:.0%} |"
        )


if __name__ == "__main__":
    main()
